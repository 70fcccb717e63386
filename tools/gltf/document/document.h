// A glTF document as plain records, read by tinygltf. Types and number ranges are checked (schema.h); references
// between records are not yet.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "format/result.h"
#include "tools/gltf/document/json.h"
#include "tools/gltf/source.h"

namespace scree::convert {

inline constexpr int32_t kAbsent = -1;  // no such reference

struct DocBuffer {
  std::string uri;       // empty if there is none, or for a data: URI, which stays in the text
  bool is_data = false;  // the URI is data:; data_uri() decodes it
  bool meshopt_fallback = false;
  int32_t chunk = kAbsent;  // chunk of the .glb (glTF 2.1)
  uint64_t bytes = 0;
  JsonRange json;
};

/// EXT_meshopt_compression or KHR_meshopt_compression of a buffer view.
struct DocMeshopt {
  enum class Mode : uint8_t { kAttributes, kTriangles, kIndices };
  enum class Filter : uint8_t { kNone, kOctahedral, kQuaternion, kExponential, kColor };

  uint64_t view = 0;  // the view that is compressed
  bool is_khr = false;
  Mode mode = Mode::kAttributes;
  Filter filter = Filter::kNone;
  std::optional<std::string> unknown_mode;  // as in the document
  std::optional<std::string> unknown_filter;
  int32_t buffer = kAbsent;
  uint64_t offset = 0;  // of the stream
  uint64_t bytes = 0;
  uint64_t stride = 0;  // of the unpacked elements
  uint64_t count = 0;

  const char* extension() const { return is_khr ? "KHR_meshopt_compression" : "EXT_meshopt_compression"; }
};

struct DocBufferView {
  int32_t buffer = kAbsent;
  int32_t meshopt = kAbsent;  // index in GltfDocument::meshopt
  uint64_t offset = 0;
  uint64_t bytes = 0;
  uint64_t stride = 0;  // 0: tightly packed
};

struct DocSparse {
  uint32_t accessor = 0;
  uint32_t count = 0;
  int32_t index_view = kAbsent;
  int32_t value_view = kAbsent;
  uint32_t index_offset = 0;
  uint32_t value_offset = 0;
  int32_t index_type = 0;
};

struct DocAccessor {
  int32_t view = kAbsent;
  int32_t type = 0;          // component type, glTF's number
  uint32_t components = 0;   // 1 to 4; 9 and 16 for matrices (0 for MAT2, because 4 is taken)
  int32_t sparse = kAbsent;  // index in GltfDocument::sparse
  bool normalized = false;
  bool is_draco = false;  // a primitive that is compressed by Draco uses it, too
  uint64_t offset = 0;
  uint64_t count = 0;
};

/// "min" and "max" of an accessor of three components. They are not checked against the data.
struct DocBounds {
  uint32_t accessor = 0;
  std::array<float, 3> min{};
  std::array<float, 3> max{};
};

/// Bounds are kept only for accessors of at least this many elements, so that a million small ones take no memory.
inline constexpr uint64_t kLeastBounded = 65536;

using DocAttribute = std::pair<std::string, int32_t>;  // name, accessor

/// KHR_draco_mesh_compression of a primitive.
struct DocDraco {
  int32_t view = kAbsent;
  std::vector<DocAttribute> attributes;  // name, number of the attribute in the stream; sorted by name
};

struct DocPrimitive {
  int32_t mode = 4;
  int32_t indices = kAbsent;
  int32_t material = kAbsent;
  int32_t draco = kAbsent;                // index in GltfDocument::draco
  std::vector<DocAttribute> attributes;   // sorted by name
  std::vector<int32_t> target_accessors;  // of morph targets
  uint32_t targets = 0;
};

struct DocMesh {
  std::string name;
  std::vector<DocPrimitive> primitives;
};

/// KHR_lights_punctual.
struct DocLight {
  std::string name;
  std::string type;
  std::array<double, 3> color{1, 1, 1};
  double intensity = 1;
  double range = 0;  // 0: unlimited
  double inner_cone = 0;
  double outer_cone = 0.78539816339744831;  // pi / 4
};

struct DocNode {
  std::string name;
  int32_t mesh = kAbsent;
  int32_t camera = kAbsent;
  int32_t skin = kAbsent;
  int32_t light = kAbsent;  // KHR_lights_punctual
  bool has_matrix = false;
  bool has_instancing = false;
  LocalTransform local;
  std::vector<uint32_t> children;
  std::vector<DocAttribute> instancing;  // EXT_mesh_gpu_instancing
};

struct DocTextureUse {
  int32_t texture = kAbsent;
  uint32_t uv_set = 0;
  std::array<double, 2> offset{0, 0};
  std::array<double, 2> scale{1, 1};
  double rotation = 0;
};

/// A material as in the document, with glTF's defaults.
struct DocMaterial {
  std::string name;
  std::array<double, 4> base_color{1, 1, 1, 1};
  DocTextureUse base_texture;
  double metallic = 1;
  double roughness = 1;
  double normal_scale = 1;
  double occlusion_strength = 1;
  std::array<double, 3> emission{0, 0, 0};  // includes KHR_materials_emissive_strength
  double ior = 1.5;
  double specular = 1;
  std::array<double, 3> specular_color{1, 1, 1};
  std::array<DocTextureUse, format::kSurfaceUses> textures;  // by format::SurfaceUse
  double alpha_cutoff = 0.5;
  bool alpha_mask = false;
  bool alpha_blend = false;
  bool double_sided = false;
  bool unlit = false;
};

struct DocTexture {
  std::string name;
  int32_t sampler = kAbsent;
  /// Alternative images: the source of KHR_texture_basisu, that of MSFT_texture_dds, the texture's own source, and that
  /// of EXT_texture_webp.
  std::array<int32_t, 4> sources{kAbsent, kAbsent, kAbsent, kAbsent};
};

struct DocSampler {
  int32_t mag_filter = 0;
  int32_t min_filter = 0;
  int32_t wrap_s = 10497;
  int32_t wrap_t = 10497;
};

struct DocImage {
  std::string name;
  std::string uri;  // as in DocBuffer
  bool is_data = false;
  int32_t view = kAbsent;
  JsonRange json;
};

struct DocCamera {
  std::string name;
  bool orthographic = false;
  double y = 0;  // yfov, ymag
  double x = 0;  // aspectRatio, xmag
  double z_near = 0;
  double z_far = 0;
};

struct DocScene {
  std::string name;
  std::vector<uint32_t> roots;
};

struct GltfDocument {
  std::vector<char> text;
  std::string copyright;
  int32_t scene = kAbsent;
  std::vector<std::string> extensions_used;
  std::vector<std::string> extensions_required;
  std::vector<DocBuffer> buffers;
  std::vector<DocBufferView> views;
  std::vector<DocMeshopt> meshopt;
  std::vector<DocDraco> draco;
  std::vector<DocAccessor> accessors;
  std::vector<DocSparse> sparse;
  std::vector<DocBounds> bounds;  // sorted by accessor
  std::vector<DocMesh> meshes;
  std::vector<DocNode> nodes;
  std::vector<DocMaterial> materials;
  std::vector<DocTexture> textures;
  std::vector<DocSampler> samplers;
  std::vector<DocImage> images;
  std::vector<DocCamera> cameras;
  std::vector<DocLight> lights;
  std::vector<DocScene> scenes;
  uint64_t skins = 0;
  uint64_t animations = 0;
  std::vector<int32_t> skin_accessors;       // ascending, each once
  std::vector<int32_t> animation_accessors;  // ascending, each once

  bool uses(const std::string& extension) const;

  /// The kept "min" and "max" of an accessor, or null.
  const DocBounds* bounds_of(uint32_t accessor) const;
};

/// The memory of the process is checked once per this many bytes of text.
inline constexpr uint64_t kLargeDocument = 1 << 20;

/// The kUsage error for a document of `json_bytes` that does not fit into `memory`. `estimate` precedes `needed_bytes`
/// in the message, such as "about".
Error document_too_large(uint64_t memory, uint64_t json_bytes, const char* estimate, uint64_t needed_bytes);

/// Reads a document on up to `options.threads` threads. Memory: the records plus a few MiB per thread, however long the
/// text is; fewer threads are used if `options.memory` is small. Errors kFormat, kRange, kVersion (not glTF 2.x), each
/// with its position in the document; kUsage if the process takes more than `options.memory` bytes, with an estimate of
/// its need; kFile: stopped. The memory is checked every kLargeDocument bytes of text, and before longer parts are
/// copied.
Result<GltfDocument> read_document(std::vector<char> text, const ImportOptions& options);

/// The bytes of the data: URI of a buffer or image. `json`: its element. Errors kFormat, and kUsage as read_document().
Result<std::vector<std::byte>> data_uri(const GltfDocument& document, JsonRange json, uint64_t memory);

}  // namespace scree::convert
