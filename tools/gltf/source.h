// A glTF document after import: every index, range, stride and count checked, buffers still on disk. Import never holds
// a buffer in memory: the JSON is read whole, its "buffers" and "images" are parsed apart (docs/design.md, import),
// accessors are read in windows.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "format/layout.h"
#include "format/result.h"
#include "tools/gltf/box.h"

namespace scree::convert {

/// Bytes that can be read anywhere: a .bin file, the binary chunk of a .glb, or a decoded data: URI. Reads are
/// pread()s, so that nothing stays resident. Thread-safe.
class ByteSource {
 public:
  virtual ~ByteSource() = default;
  virtual uint64_t size() const = 0;
  /// Fills `out` from `offset`. Errors kFile (I/O error), kTruncated (the file shrank).
  virtual Result<void> read(uint64_t offset, std::span<std::byte> out) const = 0;
  /// Says that bytes will be read soon; the range may pass the end. Nothing need come of it.
  virtual void will_need(uint64_t /*offset*/, uint64_t /*bytes*/) const {}
  /// The file the bytes come from; empty where they are held in memory.
  virtual const std::string& path() const;
};

enum class ComponentType : uint16_t { kInt8 = 5120, kUint8, kInt16, kUint16, kUint32 = 5125, kFloat32 = 5126 };
/// Bytes of a component, 1, 2 or 4.
uint64_t component_bytes(ComponentType type);

/// A checked accessor: every element lies inside its buffer, sparse indices ascend and lie below count.
struct Accessor {
  struct Sparse {
    uint64_t count = 0;
    ComponentType index_type = ComponentType::kUint32;
    std::shared_ptr<const ByteSource> index_source;
    uint64_t index_offset = 0;
    std::shared_ptr<const ByteSource> value_source;
    uint64_t value_offset = 0;  // tightly packed
  };
  std::shared_ptr<const ByteSource> source;  // null: zeros
  uint64_t offset = 0;                       // bytes of element 0
  uint64_t stride = 0;                       // bytes
  uint64_t count = 0;
  ComponentType type = ComponentType::kFloat32;
  uint32_t components = 3;
  bool normalized = false;
  std::optional<Sparse> sparse;
  uint32_t index = 0;  // in the document, for messages and for counting each accessor once

  uint64_t element_bytes() const;
};

/// What read_floats() makes of a component of this value.
float float_of(const Accessor& accessor, float component);

/// Reads elements [first, first + count) as floats (normalised integers scaled as glTF says), components * count
/// values.
Result<void> read_floats(const Accessor& accessor, uint64_t first, uint64_t count, std::span<float> out);

/// Reads the elements of an ascending list of numbers, each below accessor.count. Neighbouring elements are fetched
/// with one read.
Result<void> gather_floats(const Accessor& accessor, std::span<const uint32_t> ascending, std::span<float> out);

/// Copies elements [first, first + count) as they are, without gaps: count * element_bytes() bytes. Errors kFile.
Result<void> read_elements(const Accessor& accessor, uint64_t first, uint64_t count, std::span<std::byte> out);

enum class PrimitiveMode : uint8_t { kTriangles = 4, kStrip = 5, kFan = 6 };

/// What the triangles and vertices of a sorted copy are in the primitive it is of (sort_primitive.h).
struct SourceNumbers {
  Accessor triangles;  // 32 bits, scalar: the source's number of each triangle
  Accessor vertices;   // likewise of each vertex, less first_vertex
  uint32_t first_vertex = 0;
};

/// A primitive that is kept: triangles, strips or fans.
struct Primitive {
  uint32_t group = 0;  // glTF mesh, in SourceScene::groups
  uint32_t place = 0;  // of the primitive within its glTF mesh
  uint32_t mesh = 0;   // the glTF mesh's number in the document, for messages
  PrimitiveMode mode = PrimitiveMode::kTriangles;
  std::optional<Accessor> indices;  // 8, 16 or 32 bits, scalar
  Accessor positions;
  std::optional<Accessor> uv;     // the set its material's textures use; present only where a texture needs it
  std::optional<Accessor> color;  // COLOR_0, 3 or 4 components
  std::optional<Accessor> normal;
  uint32_t material = format::kNone;
  std::shared_ptr<const SourceNumbers> numbers;  // of a sorted copy; else null: counted from 0
  std::optional<Box> stated_box;  // of many positions that are its own, as the document says; nothing holds them to it

  uint64_t vertex_count() const { return positions.count; }
  uint64_t triangle_count() const;  // degenerate triangles of strips included
};

/// Reads the vertex numbers of triangles [first, first + count) of a primitive, 3 a triangle, counter-clockwise (every
/// other strip triangle is turned). Errors kFile, kRange: an index at or past vertex_count, named with its place in the
/// index accessor: "mesh 3 primitive 0: index 70211 at place 17, but the mesh has 65536 vertices" (glTF's numbers; the
/// caller puts the file name before it).
Result<void> read_triangles(const Primitive& primitive, uint64_t first, uint64_t count, std::span<uint32_t> out);

/// The instances of a node (EXT_mesh_gpu_instancing): checked, and left in their buffers, of which there may be more
/// than fits into memory.
struct SourceInstances {
  uint64_t count = 0;                   // at least 1
  std::optional<Accessor> translation;  // absent: 0
  std::optional<Accessor> rotation;     // absent: none
  std::optional<Accessor> scale;        // absent: 1
};

/// Reads instances [first, first + out.size()), rotations scaled to unit length. Errors kFile, kTruncated, kRange (not
/// finite, no rotation), the accessor and the instance named.
Result<void> read_instances(const SourceInstances& instances, uint64_t first,
                            std::span<format::NodeInstanceRecord> out);

/// A node's own transform, as NodeRecord::local. One that says nothing, as a node of ten bytes of JSON has it, takes no
/// memory of its own.
class LocalTransform {
 public:
  using Values = std::array<double, 16>;

  LocalTransform() = default;
  explicit LocalTransform(const Values& values) : values_(std::make_shared<Values>(values)) {}

  bool is_set() const { return values_ != nullptr; }
  const Values& values() const {
    static constexpr Values kIdentity{0, 0, 0, 0, 0, 0, 1, 1, 1, 1};
    return values_ ? *values_ : kIdentity;
  }
  double operator[](size_t i) const { return values()[i]; }

 private:
  std::shared_ptr<const Values> values_;
};

struct SourceNode {
  std::string name;
  uint32_t parent = format::kNone;
  uint32_t group = format::kNone;
  uint32_t camera = format::kNone;
  bool has_matrix = false;
  LocalTransform local;
  std::shared_ptr<const SourceInstances> instances;  // null: drawn once
};

struct SourceImage {
  std::string name;
  format::ImageCodec codec = format::ImageCodec::kPng;  // of a WebP too
  bool is_webp = false;
  std::shared_ptr<const ByteSource> source;
  uint64_t offset = 0;
  uint64_t bytes = 0;
  bool is_color = false;  // some texture shows it as colour; else it has numbers
};

struct SourceGroup {
  std::string name;
};

struct NamedMaterial {
  std::string name;
  format::MaterialRecord record{};               // name unset; texture is an index into SourceScene::textures
  std::optional<format::SurfaceRecord> surface;  // material unset; textures as in the record
};

/// Calls `take` for every texture of a material, which it may change.
template <class Material, class Take>
void visit_textures(Material& material, const Take& take) {
  if (material.record.texture != format::kNone) take(material.record.texture);
  if (!material.surface) return;
  for (auto& use : material.surface->textures)
    if (use.texture != format::kNone) take(use.texture);
}

struct NamedTexture {
  std::string name;
  format::TextureRecord record{};  // name unset; image is an index into SourceScene::images
};

/// KHR_lights_punctual; `record.node` is an index into SourceScene::nodes.
struct NamedLight {
  std::string name;
  format::LightRecord record{};  // name unset
};

struct NamedCamera {
  std::string name;
  format::CameraRecord record{};
};

struct SourceSceneRoots {
  std::string name;
  bool is_default = false;
  std::vector<uint32_t> roots;
};

/// Something the document has and the import leaves out. Attributes are named as in glTF ("TANGENT", "TEXCOORD_1");
/// "NORMAL" is among them although Primitive::normal offers it: whoever stores normals takes that entry out. Each
/// accessor's bytes count once.
struct LeftOut {
  std::string what;
  uint64_t count = 0;
  uint64_t source_bytes = 0;
  uint64_t elements = 0;  // of its accessors, each once
};

/// What compressed buffer views (meshopt_source.h) take and hold.
struct PackedViewMemory {
  uint64_t reader_bytes = 0;  // of each thread that reads any of them
  uint64_t place_bytes = 0;   // of all, as long as the scene is there
  uint64_t kept_bytes = 0;    // of all, were all of their windows kept
};

/// Nodes are in an order in which parents come before children; every index below is checked.
struct SourceScene {
  std::string file_name;
  std::string copyright;
  std::vector<SourceGroup> groups;
  std::vector<Primitive> primitives;  // ordered by group, then place
  std::vector<SourceNode> nodes;
  std::vector<NamedMaterial> materials;
  std::vector<NamedTexture> textures;
  std::vector<SourceImage> images;
  std::vector<NamedCamera> cameras;
  std::vector<NamedLight> lights;
  std::vector<SourceSceneRoots> scenes;
  std::vector<LeftOut> left_out;
  std::vector<std::string> warnings;  // one line each, without the program's name
  uint64_t json_bytes = 0;
  uint64_t buffer_bytes = 0;  // declared lengths of buffers, external and embedded
  PackedViewMemory view_memory;
};

struct ImportOptions {
  std::string
      exclude;  // regular expression (ECMAScript) searched in node names; matching nodes and those below are left out
  uint64_t max_json_bytes = uint64_t{1} << 31;
  uint64_t kept_view_bytes = uint64_t{1} << 30;  // memory for compressed buffer views that were unpacked
  bool allow_outside = false;    // reads files that URIs name by "../" or symbolic links outside the scene's folder
  bool keep_going = false;       // a texture whose image file cannot be opened is left out, with a warning
  uint64_t memory = UINT64_MAX;  // bytes that the process may take while the document is read
};

/// Opens a .gltf or .glb. Errors kFile, kFormat, kTruncated, kRange, kUnsupported (a required extension that scree does
/// not do), kUsage (a bad regular expression, more than `memory`), each with file and place: "city.gltf: mesh 12: ...".
Result<SourceScene> import_gltf(const std::string& path, const ImportOptions& options);

}  // namespace scree::convert
