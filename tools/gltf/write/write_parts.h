// The JSON of a glTF document's parts, for GltfWriter.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tools/common/output/json_writer.h"
#include "tools/gltf/write/writer.h"

namespace scree::tools {

inline constexpr const char* kMeshopt = "EXT_meshopt_compression";
inline constexpr const char* kLights = "KHR_lights_punctual";

/// A buffer view and its buffer; one with meshopt is in the fallback buffer.
struct PlacedView {
  GltfBufferView view;
  uint32_t buffer;
};

/// Writes a member "extensions" with one extension; `members()` writes the members of it.
template <class Members>
void write_extension(JsonWriter& json, const char* name, const Members& members) {
  json.object("extensions", [&] { json.object(name, members); });
}

/// These write the members of a part. write_name(): nothing if there is no name.
void write_name(JsonWriter& json, const std::string& name);
/// `fallback`: the buffer of views with meshopt.
void write_buffer_view(JsonWriter& json, const PlacedView& placed, uint64_t fallback);
void write_accessor(JsonWriter& json, const GltfAccessor& accessor);
void write_mesh(JsonWriter& json, const GltfMesh& mesh);
void write_node(JsonWriter& json, const GltfNode& node);
void write_camera(JsonWriter& json, const GltfCamera& camera);
void write_light(JsonWriter& json, const GltfLight& light);
void write_material(JsonWriter& json, const GltfMaterial& material);

/// Whether a texture of the material has a transform.
bool has_transform(const GltfMaterial& material);

/// The other extensions that a material uses, by name.
std::vector<const char*> material_extensions(const GltfMaterial& material);

}  // namespace scree::tools
