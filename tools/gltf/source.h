// A glTF document after import: every index, range, stride and count is checked, and buffers are still on disk. Import
// reads the JSON whole, parses its "buffers" and "images" separately (docs/import.md), and reads accessors
// in windows. It never holds a whole buffer in memory.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "format/layout.h"
#include "format/result.h"
#include "tools/common/jobs/stop_flag.h"
#include "tools/gltf/box.h"

namespace scree::convert {

/// Bytes that can be read at any offset: a .bin file, the binary chunk of a .glb, or a decoded data: URI. Reads are
/// pread()s, so that no data stay in memory. Thread-safe.
class ByteSource {
 public:
  virtual ~ByteSource() = default;
  virtual uint64_t size() const = 0;
  /// Fills `out` from `offset`. Errors kFile (I/O error), kTruncated (the file shrank).
  virtual Result<void> read(uint64_t offset, std::span<std::byte> out) const = 0;
  /// The same for bytes that are read alone, such as a file's head: the system reads no further ones ahead.
  virtual Result<void> read_alone(uint64_t offset, std::span<std::byte> out) const { return read(offset, out); }
  /// A hint that bytes will be read soon. The range may pass the end. It may have no effect.
  virtual void will_need(uint64_t /*offset*/, uint64_t /*bytes*/) const {}
  /// Unpacks bytes of a compressed source that will be read soon, as far as only one thread at a time can do that. The
  /// range may pass the end. Errors are left to the read. May throw std::bad_alloc.
  virtual void unpack_ahead(uint64_t /*offset*/, uint64_t /*bytes*/) const {}
  /// The file of the bytes; empty if they are in memory.
  virtual const std::string& path() const;
};

enum class ComponentType : uint16_t { kInt8 = 5120, kUint8, kInt16, kUint16, kUint32 = 5125, kFloat32 = 5126 };
/// Returns visit(T{}) with the type T of the components.
template <class Visit>
auto visit_component(ComponentType type, const Visit& visit) {
  if (type == ComponentType::kInt8) return visit(int8_t{});
  if (type == ComponentType::kUint8) return visit(uint8_t{});
  if (type == ComponentType::kInt16) return visit(int16_t{});
  if (type == ComponentType::kUint16) return visit(uint16_t{});
  return type == ComponentType::kUint32 ? visit(uint32_t{}) : visit(float{});
}
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

/// The float that read_floats() makes of a component of this value.
float float_of(const Accessor& accessor, float component);

/// Reads elements [first, first + count) as floats, components * count values. Normalised integers are scaled as in
/// glTF.
Result<void> read_floats(const Accessor& accessor, uint64_t first, uint64_t count, std::span<float> out);

/// Reads the elements of an ascending list of numbers, each below accessor.count. Adjacent elements share one read.
Result<void> gather_floats(const Accessor& accessor, std::span<const uint32_t> ascending, std::span<float> out);

/// Copies elements [first, first + count) unchanged, without gaps: count * element_bytes() bytes. Errors kFile.
Result<void> read_elements(const Accessor& accessor, uint64_t first, uint64_t count, std::span<std::byte> out);

enum class PrimitiveMode : uint8_t { kTriangles = 4, kStrip = 5, kFan = 6 };

/// The source's numbers of the triangles and vertices of a sorted copy of a primitive (sort_primitive.h).
struct SourceNumbers {
  Accessor triangles;  // 32 bits, scalar: the source's number of each triangle
  Accessor vertices;   // likewise of each vertex, minus first_vertex
  uint32_t first_vertex = 0;
};

/// Attributes that few primitives have.
struct SurfaceAttributes {
  std::optional<Accessor> second_uv;  // if a texture of the material uses another set than Primitive::uv
  std::optional<Accessor> tangent;    // if the material has a normal map, and the primitive normals
};

/// A primitive that is kept: triangles, strips or fans.
struct Primitive {
  uint32_t group = 0;  // index in SourceScene::groups of its glTF mesh
  uint32_t place = 0;  // number of the primitive in its glTF mesh
  uint32_t mesh = 0;   // the glTF mesh's number in the document, for messages
  PrimitiveMode mode = PrimitiveMode::kTriangles;
  std::optional<Accessor> indices;  // 8, 16 or 32 bits, scalar
  Accessor positions;
  std::optional<Accessor> uv;     // the set that its material's first texture uses; only if a texture needs it
  std::optional<Accessor> color;  // COLOR_0, 3 or 4 components
  std::optional<Accessor> normal;
  std::shared_ptr<const SurfaceAttributes> surface;  // null: none
  uint32_t material = format::kNone;
  std::shared_ptr<const SourceNumbers> numbers;  // of a sorted copy; null otherwise, and numbers then count from 0
  std::optional<Box> stated_box;  // of many positions used by no other primitive; stated by the document, unchecked

  uint64_t vertex_count() const { return positions.count; }
  uint64_t triangle_count() const;  // includes degenerate triangles of strips
  const Accessor* second_uv() const { return surface && surface->second_uv ? &*surface->second_uv : nullptr; }
  const Accessor* tangent() const { return surface && surface->tangent ? &*surface->tangent : nullptr; }
};

/// Calls `take(accessor)` for every vertex attribute except the positions. `directions`: includes normals and tangents.
template <class Take>
void visit_attributes(const Primitive& primitive, bool directions, const Take& take) {
  if (primitive.uv) take(*primitive.uv);
  if (primitive.color) take(*primitive.color);
  if (primitive.second_uv() != nullptr) take(*primitive.second_uv());
  if (directions && primitive.normal) take(*primitive.normal);
  if (directions && primitive.tangent() != nullptr) take(*primitive.tangent());
}

/// Reads the vertex numbers of triangles [first, first + count) of a primitive, 3 per triangle, counter-clockwise
/// (every other strip triangle is turned). Errors kFile, kRange: an index of vertex_count or more, with its position in
/// the index accessor: "mesh 3 primitive 0: index 70211 at element 17, but the mesh has 65536 vertices". These are
/// glTF's numbers; the caller prepends the file name.
Result<void> read_triangles(const Primitive& primitive, uint64_t first, uint64_t count, std::span<uint32_t> out);

/// The instances of a node (EXT_mesh_gpu_instancing): checked, but left in their buffers, because there may be more
/// than fit into memory.
struct SourceInstances {
  uint64_t count = 0;                   // at least 1
  std::optional<Accessor> translation;  // absent: 0
  std::optional<Accessor> rotation;     // absent: none
  std::optional<Accessor> scale;        // absent: 1
};

/// Reads instances [first, first + out.size()), with rotations scaled to unit length. Errors kFile, kTruncated, kRange
/// (not finite, a rotation of length 0); they name the accessor and the instance.
Result<void> read_instances(const SourceInstances& instances, uint64_t first,
                            std::span<format::NodeInstanceRecord> out);

/// A node's own transform, as NodeRecord::local. An identity allocates no memory, because a node without a transform
/// takes only ten bytes of JSON.
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
  format::ImageCodec codec = format::ImageCodec::kPng;  // a WebP has kPng, too
  bool is_webp = false;
  std::shared_ptr<const ByteSource> source;
  uint64_t offset = 0;
  uint64_t bytes = 0;
  bool is_color = false;  // some texture shows it as colour; otherwise it holds numbers
};

struct SourceGroup {
  std::string name;
};

struct NamedMaterial {
  std::string name;
  format::MaterialRecord record{};               // name unset; texture is an index into SourceScene::textures
  std::optional<format::SurfaceRecord> surface;  // material unset; textures as in the record
};

/// Calls `take` for every texture of a material. `take` may change it.
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

/// Something in the document that the import leaves out. Attributes are named as in glTF ("TANGENT", "TEXCOORD_1").
/// "NORMAL" is among them although Primitive::normal offers it: a caller that stores normals removes that entry.
/// Tangents that a primitive offers are not listed. Each accessor's bytes count once.
struct LeftOut {
  std::string what;
  uint64_t count = 0;
  uint64_t source_bytes = 0;
  uint64_t elements = 0;  // of its accessors, each counted once
};

/// Memory of compressed buffer views (meshopt_source.h).
struct PackedViewMemory {
  uint64_t reader_bytes = 0;  // per thread that reads any of them
  uint64_t place_bytes = 0;   // of all views, for the scene's lifetime
  uint64_t kept_bytes = 0;    // of all windows that may be kept
};

/// Nodes are ordered with parents before children. Every index below is checked.
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
  std::string exclude;  // regular expression (ECMAScript) searched in node names; matching nodes and their descendants
                        // are left out
  uint64_t max_json_bytes = uint64_t{1} << 31;
  uint64_t kept_view_bytes = uint64_t{1} << 30;  // memory for unpacked compressed buffer views
  bool allow_outside = false;    // reads files that URIs name by "../" or symbolic links outside the scene's folder
  bool keep_going = false;       // a texture whose image file cannot be opened is left out, with a warning
  uint64_t memory = UINT64_MAX;  // the most bytes that the process may take while it reads the document
  uint32_t threads = 1;
  const std::atomic<bool>* stop = nullptr;  // if set, the import ends with kFile "interrupted"

  /// The import tests this between its steps.
  Result<void> check_stop() const { return tools::check_stop(stop); }
};

/// Opens a .gltf or .glb. Errors kFile, kFormat, kTruncated, kRange, kUnsupported (an unsupported required extension),
/// kUsage (a bad regular expression, more than `memory`). Each error names the file and the part of it: "city.gltf:
/// mesh 12: ...".
Result<SourceScene> import_gltf(const std::string& path, const ImportOptions& options);

}  // namespace scree::convert
