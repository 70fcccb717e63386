// Streams a glTF 2.0 asset to disk: a .gltf with a .bin (and image files) beside it, or one .glb. Buffer data are
// written at once and the document last, so memory grows only with the number of nodes, meshes and accessors.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "format/container/part_file.h"
#include "format/layout.h"
#include "format/result.h"

namespace scree::tools {

/// The codes of glTF 2.0. Below, indices into the document are uint32_t, format::kNone for none. Numbers are written in
/// the shortest form that reads back as the same double, so floats read back bit for bit.
enum class GltfComponent : uint16_t { kInt8 = 5120, kUint8, kInt16, kUint16, kUint32 = 5125, kFloat32 = 5126 };
enum class GltfType : uint8_t { kScalar, kVec2, kVec3, kVec4 };
enum class GltfTarget : uint16_t { kNone = 0, kVertices = 34962, kIndices = 34963 };

/// EXT_meshopt_compression of a buffer view: a stream in the current buffer.
struct GltfMeshopt {
  enum class Mode : uint8_t { kAttributes, kTriangles };
  uint64_t offset = 0;  // bytes in the buffer, as append() returns it
  uint64_t bytes = 0;
  Mode mode = Mode::kAttributes;
  uint64_t count = 0;   // elements
  uint32_t stride = 0;  // bytes of an element, unpacked
};

struct GltfBufferView {
  uint64_t offset = 0;  // bytes in the current buffer, as reserve() and append() return it; with `meshopt`: ignored
  uint64_t bytes = 0;   // >= 1, unpacked
  uint32_t stride = 0;  // bytes, 4 to 252; 0: tightly packed
  GltfTarget target = GltfTarget::kNone;
  std::optional<GltfMeshopt> meshopt = {};
};

struct GltfAccessor {
  uint32_t buffer_view = format::kNone;
  uint64_t offset = 0;  // in the view
  GltfComponent component = GltfComponent::kFloat32;
  GltfType type = GltfType::kVec3;
  bool normalized = false;
  uint64_t count = 0;            // >= 1
  std::vector<double> min, max;  // required for POSITION; empty: not written
};

struct GltfPrimitive {
  std::vector<std::pair<std::string, uint32_t>> attributes;  // "POSITION" -> accessor
  uint32_t indices = format::kNone;
  uint32_t material = format::kNone;
};

struct GltfMesh {
  std::string name;
  std::vector<GltfPrimitive> primitives;
};

struct GltfNode {
  std::string name;
  uint32_t mesh = format::kNone;
  uint32_t camera = format::kNone;
  uint32_t light = format::kNone;
  bool has_matrix = false;
  /// As format::NodeRecord::local: a column-major matrix, or translation 3, rotation xyzw 4, scale 3. Parts that are
  /// the identity are not written.
  std::array<double, 16> local{0, 0, 0, 0, 0, 0, 1, 1, 1, 1};
  std::vector<uint32_t> children;
  /// EXT_mesh_gpu_instancing: "TRANSLATION", "ROTATION", "SCALE" -> accessor.
  std::vector<std::pair<std::string, uint32_t>> instancing;
};

struct GltfCamera {
  std::string name;
  format::CameraKind kind = format::CameraKind::kPerspective;
  double y = 1.0;  // perspective: vertical field of view in radians; orthographic: half height
  double x = 0.0;  // perspective: aspect ratio, or 0 for none; orthographic: half width
  double z_near = 0.1;
  double z_far = 0.0;  // 0: infinite (perspective only)
};

/// KHR_lights_punctual. `record.name` and `record.node` are ignored.
struct GltfLight {
  std::string name;
  format::LightRecord record{};
};

/// KHR_texture_transform; not written if it is the identity.
struct GltfTextureTransform {
  double offset[2] = {0, 0};
  double scale[2] = {1, 1};
  double rotation = 0;  // radians, counter-clockwise
};

enum class GltfAlpha : uint8_t { kOpaque, kMask, kBlend };

struct GltfMaterial {
  std::string name;
  double base_color[4] = {1, 1, 1, 1};  // linear
  uint32_t texture = format::kNone;
  uint32_t tex_coord = 0;  // n of its textures' TEXCOORD_n; textures of SurfaceRecord::second_uv use n + 1
  GltfTextureTransform transform;
  GltfAlpha alpha = GltfAlpha::kOpaque;
  double alpha_cutoff = 0.5;
  bool double_sided = false;
  bool unlit = false;                            // KHR_materials_unlit
  double transmission = 0;                       // KHR_materials_transmission
  std::optional<format::SurfaceRecord> surface;  // textures numbered by add_texture(); none: not metallic, fully rough
};

struct GltfTexture {
  std::string name;
  uint32_t image = format::kNone;
  format::Wrap wrap_s = format::Wrap::kRepeat;
  format::Wrap wrap_t = format::Wrap::kRepeat;
  uint16_t mag_filter = 0;  // glTF's numbers; 0: not written
  uint16_t min_filter = 0;
};

struct GltfScene {
  std::string name;
  std::vector<uint32_t> nodes;
};

/// Note for users about a .glb of version 3; follows its name.
inline constexpr const char* kVersion3Note =
    ": passes 4 GiB and is a GLB of version 3 (glTF 2.1, a draft), which few programs read; name it .gltf for others";

/// Writes to files with ".part" after their names, and finish() renames them. Without finish(), or if it fails, no file
/// is left behind. Every Result is kFile with the file and the system's message. A .glb above 4 GiB has version 3 (the
/// draft of glTF 2.1, with lengths of 64 bits). Only write_at() may be called from several threads at once.
class GltfWriter {
 public:
  /// `path` must end in .gltf or .glb (else kUsage). "city.gltf" gets "city.bin" beside it. `copyright` may be empty.
  /// `existing`: for all files of the output.
  static Result<GltfWriter> create(const std::string& path, std::string_view copyright = {},
                                   format::Existing existing = format::Existing::kReplace);

  /// From now on writing fails with kFile "interrupted" once `stop` is raised.
  void stop_on(const std::atomic<bool>* stop);

  /// Checks that no file of the output is `source`, which is read. Also checks whether the files of these images, in
  /// the order of their add_image(), exist already, with Existing::kRefuse; add_image() would find them only later.
  /// Errors kUsage, kFile.
  struct PlannedImage {
    std::string_view name;
    format::ImageCodec codec;
  };
  Result<void> check_files(std::span<const PlannedImage> planned, const std::string& source) const;
  GltfWriter(GltfWriter&&) noexcept;
  GltfWriter& operator=(GltfWriter&&) noexcept;
  ~GltfWriter();

  /// Reserves the next `bytes` of the buffer, aligned (a power of two); returns their offset. They are zero until
  /// written.
  Result<uint64_t> reserve(uint64_t bytes, uint64_t alignment = 4);
  /// Writes within a reserved range. Thread-safe for ranges that do not overlap.
  Result<void> write_at(uint64_t offset, std::span<const std::byte> bytes) const;
  /// reserve() and write_at().
  Result<uint64_t> append(std::span<const std::byte> bytes, uint64_t alignment = 4);
  uint64_t buffer_bytes() const;
  /// Ends the current buffer. Later data are written to a new one, the file "city_NAME.bin" (NAME is made safe and
  /// unique). Error kUsage for a .glb.
  Result<void> next_buffer(std::string_view name);

  /// A view with `meshopt` gets a range of a fallback buffer without a file, the document's last buffer; the extension
  /// is then required.
  uint32_t add_buffer_view(const GltfBufferView& view);
  uint32_t add_accessor(GltfAccessor accessor);
  uint32_t add_mesh(GltfMesh mesh);
  uint32_t add_node(GltfNode node);
  /// Nodes may be filled in after their children are known.
  GltfNode& node(uint32_t index);
  uint32_t add_camera(GltfCamera camera);
  uint32_t add_light(GltfLight light);
  uint32_t add_material(GltfMaterial material);
  uint32_t add_texture(GltfTexture texture);
  /// Stores an encoded JPEG or PNG, or a KTX2 file (kBlocks): inside a .glb, otherwise as a file "city_NAME.jpg" beside
  /// the .gltf (NAME is made safe and unique). `mime_type`: the type in the document; empty: that of `codec`.
  Result<uint32_t> add_image(std::string_view name, format::ImageCodec codec, std::span<const std::byte> bytes,
                             std::string_view mime_type = {});
  /// The first scene added is the default scene unless set_default_scene() names another.
  uint32_t add_scene(GltfScene scene);
  void set_default_scene(uint32_t scene);
  /// Declares extensions that this writer does not declare by itself. It declares EXT_mesh_gpu_instancing as required,
  /// and those of lights, texture transforms and materials as used, if they occur.
  void use_extension(std::string_view name, bool required);

  /// Writes the document, closes and renames. Data files get their names first, the named file last. Must be called
  /// once, as the last call.
  Result<void> finish();

  /// The most bytes of a .glb of version 2: 2^32 - 1, or fewer in a test.
  void set_most_version_2_bytes(uint64_t bytes);
  /// Whether finish() wrote a .glb of version 3.
  bool is_version_3() const;

  /// Sizes on disk after finish(): all files together.
  uint64_t total_bytes() const;

 private:
  struct State;
  explicit GltfWriter(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace scree::tools
