#include "tools/gltf/write/write_parts.h"

#include <algorithm>
#include <array>
#include <iterator>
#include <numbers>
#include <utility>

namespace scree::tools {
namespace {

constexpr const char* kTypeNames[] = {"SCALAR", "VEC2", "VEC3", "VEC4"};  // by GltfType

bool is_identity(const std::array<double, 16>& matrix) {
  for (size_t i = 0; i < 16; ++i)
    if (matrix[i] != (i % 5 == 0 ? 1.0 : 0.0)) return false;
  return true;
}

void write_attributes(JsonWriter& json, const std::vector<std::pair<std::string, uint32_t>>& attributes) {
  json.object("attributes", [&] {
    for (const auto& [semantic, accessor] : attributes) json.member(semantic, accessor);
  });
}

bool is_moved(const GltfTextureTransform& transform) {
  return transform.offset[0] != 0 || transform.offset[1] != 0 || transform.scale[0] != 1 || transform.scale[1] != 1 ||
         transform.rotation != 0;
}

GltfTextureTransform transform_of(const format::SurfaceTexture& use) {
  return {{static_cast<double>(use.uv_offset[0]), static_cast<double>(use.uv_offset[1])},
          {static_cast<double>(use.uv_scale[0]), static_cast<double>(use.uv_scale[1])},
          static_cast<double>(use.uv_rotation)};
}

/// Writes a texture of a material. Its JSON object also has a member `name` with `value`, unless `value` is 1.
void write_texture_use(JsonWriter& json, const char* key, uint32_t texture, uint32_t tex_coord,
                       const GltfTextureTransform& transform, const char* name = nullptr, float value = 1) {
  if (texture == format::kNone) return;
  json.object(key, [&] {
    json.member("index", texture);
    if (tex_coord != 0) json.member("texCoord", tex_coord);
    if (name != nullptr && value != 1) json.member(name, static_cast<double>(value));
    if (!is_moved(transform)) return;
    write_extension(json, "KHR_texture_transform", [&] {
      json.array("offset", transform.offset);
      if (transform.rotation != 0) json.member("rotation", transform.rotation);
      json.array("scale", transform.scale);
    });
  });
}

void write_color(JsonWriter& json, const char* key, const float color[3], float scale, float plain) {
  if (color[0] == plain && color[1] == plain && color[2] == plain) return;
  const double wide[3] = {static_cast<double>(color[0] / scale), static_cast<double>(color[1] / scale),
                          static_cast<double>(color[2] / scale)};
  json.array(key, wide);
}

/// Emission is limited to 1. KHR_materials_emissive_strength stores a factor above that.
float emissive_strength(const format::SurfaceRecord& surface) {
  return std::max({surface.emission[0], surface.emission[1], surface.emission[2], 1.0f});
}

bool has_specular(const format::SurfaceRecord& surface) {
  const auto* const color = surface.specular_color;
  return surface.specular != 1 || color[0] != 1 || color[1] != 1 || color[2] != 1 ||
         surface.textures[static_cast<size_t>(format::SurfaceUse::kSpecular)].texture != format::kNone ||
         surface.textures[static_cast<size_t>(format::SurfaceUse::kSpecularColor)].texture != format::kNone;
}

}  // namespace

void write_name(JsonWriter& json, const std::string& name) {
  if (!name.empty()) json.member("name", name);
}

void write_buffer_view(JsonWriter& json, const PlacedView& placed, uint64_t fallback) {
  const GltfBufferView& view = placed.view;
  json.member("buffer", view.meshopt ? fallback : uint64_t{placed.buffer});
  if (view.offset != 0) json.member("byteOffset", view.offset);
  json.member("byteLength", view.bytes);
  if (view.stride != 0) json.member("byteStride", view.stride);
  if (view.target != GltfTarget::kNone) json.member("target", static_cast<uint64_t>(view.target));
  if (!view.meshopt) return;
  write_extension(json, kMeshopt, [&] {
    json.member("buffer", placed.buffer);
    if (view.meshopt->offset != 0) json.member("byteOffset", view.meshopt->offset);
    json.member("byteLength", view.meshopt->bytes);
    json.member("byteStride", view.meshopt->stride);
    json.member("mode", view.meshopt->mode == GltfMeshopt::Mode::kAttributes ? "ATTRIBUTES" : "TRIANGLES");
    json.member("count", view.meshopt->count);
  });
}

void write_accessor(JsonWriter& json, const GltfAccessor& accessor) {
  if (accessor.buffer_view != format::kNone) json.member("bufferView", accessor.buffer_view);
  if (accessor.offset != 0) json.member("byteOffset", accessor.offset);
  json.member("componentType", static_cast<uint64_t>(accessor.component));
  if (accessor.normalized) json.member("normalized", true);
  json.member("count", accessor.count);
  json.member("type", kTypeNames[static_cast<size_t>(accessor.type)]);
  if (!accessor.min.empty()) json.array("min", accessor.min);
  if (!accessor.max.empty()) json.array("max", accessor.max);
}

void write_mesh(JsonWriter& json, const GltfMesh& mesh) {
  write_name(json, mesh.name);
  json.objects("primitives", mesh.primitives, [&](const GltfPrimitive& primitive) {
    write_attributes(json, primitive.attributes);
    if (primitive.indices != format::kNone) json.member("indices", primitive.indices);
    if (primitive.material != format::kNone) json.member("material", primitive.material);
  });
}

void write_node(JsonWriter& json, const GltfNode& node) {
  write_name(json, node.name);
  if (node.mesh != format::kNone) json.member("mesh", node.mesh);
  if (node.camera != format::kNone) json.member("camera", node.camera);
  const std::span<const double, 16> local(node.local);
  if (node.has_matrix) {
    if (!is_identity(node.local)) json.array("matrix", local);
  } else {
    if (local[0] != 0 || local[1] != 0 || local[2] != 0) json.array("translation", local.subspan(0, 3));
    if (local[3] != 0 || local[4] != 0 || local[5] != 0 || local[6] != 1) json.array("rotation", local.subspan(3, 4));
    if (local[7] != 1 || local[8] != 1 || local[9] != 1) json.array("scale", local.subspan(7, 3));
  }
  if (!node.children.empty()) json.array("children", node.children);
  if (node.instancing.empty() && node.light == format::kNone) return;
  json.object("extensions", [&] {
    if (!node.instancing.empty())
      json.object("EXT_mesh_gpu_instancing", [&] { write_attributes(json, node.instancing); });
    if (node.light != format::kNone) json.object(kLights, [&] { json.member("light", node.light); });
  });
}

void write_camera(JsonWriter& json, const GltfCamera& camera) {
  const bool perspective = camera.kind == format::CameraKind::kPerspective;
  const char* const type = perspective ? "perspective" : "orthographic";
  write_name(json, camera.name);
  json.member("type", type);
  json.object(type, [&] {
    json.member(perspective ? "yfov" : "ymag", camera.y);
    if (!perspective || camera.x != 0) json.member(perspective ? "aspectRatio" : "xmag", camera.x);
    json.member("znear", camera.z_near);
    if (!perspective || camera.z_far != 0) json.member("zfar", camera.z_far);
  });
}

void write_light(JsonWriter& json, const GltfLight& light) {
  const format::LightRecord& record = light.record;
  // KHR_lights_punctual limits colours to 1, so a brighter one is a brighter light.
  const double brightest = static_cast<double>(std::max({record.color[0], record.color[1], record.color[2], 1.0f}));
  write_name(json, light.name);
  json.member("type", record.kind == format::LightKind::kDirectional ? "directional"
                      : record.kind == format::LightKind::kPoint     ? "point"
                                                                     : "spot");
  write_color(json, "color", record.color, static_cast<float>(brightest), 1);
  json.member("intensity", static_cast<double>(record.intensity) * brightest);
  if (record.range != 0) json.member("range", static_cast<double>(record.range));
  if (record.kind != format::LightKind::kSpot) return;
  json.object("spot", [&] {
    json.member("innerConeAngle", static_cast<double>(record.inner_cone));
    // pi / 2 as a float is above pi / 2, which is the most in a document.
    json.member("outerConeAngle", std::min(static_cast<double>(record.outer_cone), std::numbers::pi / 2));
  });
}

bool has_transform(const GltfMaterial& material) {
  if (material.texture != format::kNone && is_moved(material.transform)) return true;
  if (!material.surface) return false;
  return std::any_of(
      std::begin(material.surface->textures), std::end(material.surface->textures),
      [](const format::SurfaceTexture& use) { return use.texture != format::kNone && is_moved(transform_of(use)); });
}

std::vector<const char*> material_extensions(const GltfMaterial& material) {
  std::vector<const char*> names;
  if (material.unlit) names.push_back("KHR_materials_unlit");
  if (material.transmission != 0) names.push_back("KHR_materials_transmission");
  if (!material.surface) return names;
  if (emissive_strength(*material.surface) != 1) names.push_back("KHR_materials_emissive_strength");
  if (material.surface->ior != 1.5f) names.push_back("KHR_materials_ior");
  if (has_specular(*material.surface)) names.push_back("KHR_materials_specular");
  return names;
}

void write_material(JsonWriter& json, const GltfMaterial& material) {
  const format::SurfaceRecord* const surface = material.surface ? &*material.surface : nullptr;
  const auto write_use = [&](const char* key, format::SurfaceUse which, const char* name = nullptr, float value = 1) {
    if (surface == nullptr) return;
    const format::SurfaceTexture& use = surface->textures[static_cast<size_t>(which)];
    const uint32_t set = material.tex_coord + (surface->second_uv >> static_cast<uint32_t>(which) & 1u);
    write_texture_use(json, key, use.texture, set, transform_of(use), name, value);
  };
  write_name(json, material.name);
  json.object("pbrMetallicRoughness", [&] {
    const auto& color = material.base_color;
    if (color[0] != 1 || color[1] != 1 || color[2] != 1 || color[3] != 1) json.array("baseColorFactor", color);
    write_texture_use(json, "baseColorTexture", material.texture, material.tex_coord, material.transform);
    write_use("metallicRoughnessTexture", format::SurfaceUse::kMetallicRoughness);
    json.member("metallicFactor", surface != nullptr ? static_cast<double>(surface->metallic) : 0.0);
    if (surface != nullptr && surface->roughness != 1)
      json.member("roughnessFactor", static_cast<double>(surface->roughness));
  });
  if (surface != nullptr) {
    write_use("normalTexture", format::SurfaceUse::kNormalMap, "scale", surface->normal_scale);
    write_use("occlusionTexture", format::SurfaceUse::kOcclusion, "strength", surface->occlusion_strength);
    write_use("emissiveTexture", format::SurfaceUse::kEmission);
    write_color(json, "emissiveFactor", surface->emission, emissive_strength(*surface), 0);
  }
  if (material.alpha != GltfAlpha::kOpaque)
    json.member("alphaMode", material.alpha == GltfAlpha::kMask ? "MASK" : "BLEND");
  if (material.alpha == GltfAlpha::kMask && material.alpha_cutoff != 0.5)
    json.member("alphaCutoff", material.alpha_cutoff);
  if (material.double_sided) json.member("doubleSided", true);
  const std::vector<const char*> extensions = material_extensions(material);
  if (extensions.empty()) return;
  const auto write_members = [&](std::string_view name) {
    if (name == "KHR_materials_emissive_strength")
      json.member("emissiveStrength", static_cast<double>(emissive_strength(*surface)));
    if (name == "KHR_materials_transmission") json.member("transmissionFactor", material.transmission);
    if (name == "KHR_materials_ior") json.member("ior", static_cast<double>(surface->ior));
    if (name != "KHR_materials_specular") return;
    if (surface->specular != 1) json.member("specularFactor", static_cast<double>(surface->specular));
    write_use("specularTexture", format::SurfaceUse::kSpecular);
    write_color(json, "specularColorFactor", surface->specular_color, 1, 1);
    write_use("specularColorTexture", format::SurfaceUse::kSpecularColor);
  };
  json.object("extensions", [&] {
    for (const char* const name : extensions) json.object(name, [&] { write_members(name); });
  });
}

}  // namespace scree::tools
