#include "tools/gltf/document/tinygltf_model.h"

#include <algorithm>
#include <exception>
#include <new>
#include <nlohmann/json.hpp>
#include <span>
#include <utility>

#include "format/fail.h"
#include "tools/gltf/document/schema.h"

// The only translation unit with tinygltf's code. It never decodes images and never reads files.
#define TINYGLTF_IMPLEMENTATION
#define TINYGLTF_NO_STB_IMAGE
#define TINYGLTF_NO_STB_IMAGE_WRITE
#define TINYGLTF_NO_EXTERNAL_IMAGE
#define TINYGLTF_NO_INCLUDE_JSON
#include <tiny_gltf.h>

namespace scree::convert {
namespace {

// Parses one batch document. Text is read in pieces because tinygltf keeps everything it reads in memory twice.
Result<tinygltf::Model> parse(const std::string& batch) {
  tinygltf::TinyGLTF loader;
  tinygltf::Model model;
  std::string error;
  std::string warning;
  bool loaded = false;
  try {
    loaded = loader.LoadASCIIFromString(&model, &error, &warning, batch.data(), static_cast<unsigned int>(batch.size()),
                                        "", tinygltf::NO_REQUIRE);
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception& exception) {
    error = exception.what();
  }
  // The parser catches bad_alloc and returns only its name as a message. Lack of memory is not an error of the
  // document.
  if (!loaded && error.find(std::bad_alloc().what()) != std::string::npos) throw std::bad_alloc();
  if (!loaded) return Error{ErrorCode::kFormat, one_line(error.empty() ? "refused by the parser" : error)};
  return model;
}

const tinygltf::Value* member(const tinygltf::Value& value, const char* key) {
  if (!value.IsObject() || !value.Has(key)) return nullptr;
  return &value.Get(key);
}

const tinygltf::Value* member(const tinygltf::ExtensionMap& extensions, const char* key) {
  const auto found = extensions.find(key);
  return found == extensions.end() ? nullptr : &found->second;
}

int32_t index_member(const tinygltf::Value* value, const char* key) {
  const tinygltf::Value* found = value == nullptr ? nullptr : member(*value, key);
  return found == nullptr || !found->IsInt() ? kAbsent : found->GetNumberAsInt();
}

void read_numbers(const tinygltf::Value* value, const char* key, std::span<double> out) {
  const tinygltf::Value* found = value == nullptr ? nullptr : member(*value, key);
  if (found == nullptr || !found->IsArray() || found->ArrayLen() != out.size()) return;
  for (size_t i = 0; i < out.size(); ++i) out[i] = found->Get(static_cast<int>(i)).GetNumberAsDouble();
}

/// 0 for MAT2: no accessor that is read here may have this type.
uint32_t component_count(int type) {
  const int32_t count = tinygltf::GetNumComponentsInType(static_cast<uint32_t>(type));
  return type == TINYGLTF_TYPE_MAT2 || count < 0 ? 0 : static_cast<uint32_t>(count);
}

DocTextureUse texture_use(int index, int uv_set, const tinygltf::Value* transform) {
  DocTextureUse use{.texture = index, .uv_set = static_cast<uint32_t>(std::max(uv_set, 0))};
  if (transform == nullptr) return use;
  read_numbers(transform, "offset", use.offset);
  read_numbers(transform, "scale", use.scale);
  if (const tinygltf::Value* rotation = member(*transform, "rotation")) use.rotation = rotation->GetNumberAsDouble();
  if (const int32_t set = index_member(transform, "texCoord"); set != kAbsent) use.uv_set = static_cast<uint32_t>(set);
  return use;
}

const tinygltf::Value* transform_of(const tinygltf::Value* info) {
  const tinygltf::Value* extensions = info == nullptr ? nullptr : member(*info, "extensions");
  return extensions == nullptr ? nullptr : member(*extensions, "KHR_texture_transform");
}

/// A texture of an extension.
DocTextureUse texture_use(const tinygltf::Value* info) {
  return texture_use(index_member(info, "index"), index_member(info, "texCoord"), transform_of(info));
}

/// A texture that tinygltf reads.
template <class Info>
DocTextureUse texture_use(const Info& info) {
  return texture_use(info.index, info.texCoord, member(info.extensions, "KHR_texture_transform"));
}

double number_member(const tinygltf::Value* value, const char* key, double otherwise) {
  const tinygltf::Value* found = value == nullptr ? nullptr : member(*value, key);
  return found == nullptr || !found->IsNumber() ? otherwise : found->GetNumberAsDouble();
}

void read_surface(const tinygltf::Material& source, DocMaterial& material) {
  const auto use = [&](format::SurfaceUse which) -> DocTextureUse& {
    return material.textures[static_cast<size_t>(which)];
  };
  const tinygltf::PbrMetallicRoughness& pbr = source.pbrMetallicRoughness;
  material.metallic = pbr.metallicFactor;
  material.roughness = pbr.roughnessFactor;
  material.normal_scale = source.normalTexture.scale;
  material.occlusion_strength = source.occlusionTexture.strength;
  use(format::SurfaceUse::kMetallicRoughness) = texture_use(pbr.metallicRoughnessTexture);
  use(format::SurfaceUse::kNormalMap) = texture_use(source.normalTexture);
  use(format::SurfaceUse::kOcclusion) = texture_use(source.occlusionTexture);
  use(format::SurfaceUse::kEmission) = texture_use(source.emissiveTexture);
  const double strength =
      number_member(member(source.extensions, "KHR_materials_emissive_strength"), "emissiveStrength", 1);
  for (size_t c = 0; c < 3 && source.emissiveFactor.size() == 3; ++c)
    material.emission[c] = source.emissiveFactor[c] * strength;
  material.ior = number_member(member(source.extensions, "KHR_materials_ior"), "ior", 1.5);
  if (const tinygltf::Value* specular = member(source.extensions, "KHR_materials_specular")) {
    material.specular = number_member(specular, "specularFactor", 1);
    read_numbers(specular, "specularColorFactor", material.specular_color);
    use(format::SurfaceUse::kSpecular) = texture_use(member(*specular, "specularTexture"));
    use(format::SurfaceUse::kSpecularColor) = texture_use(member(*specular, "specularColorTexture"));
  }
}

DocMaterial read_material(const tinygltf::Material& source) {
  DocMaterial material{.name = source.name};
  const tinygltf::PbrMetallicRoughness& pbr = source.pbrMetallicRoughness;
  if (pbr.baseColorFactor.size() == 4) std::copy_n(pbr.baseColorFactor.begin(), 4, material.base_color.begin());
  material.base_texture = texture_use(pbr.baseColorTexture);
  read_surface(source, material);
  // This older workflow stores the base colour as the diffuse colour.
  if (const tinygltf::Value* older = member(source.extensions, "KHR_materials_pbrSpecularGlossiness")) {
    material.base_color = {1, 1, 1, 1};
    read_numbers(older, "diffuseFactor", material.base_color);
    material.base_texture = texture_use(member(*older, "diffuseTexture"));
    // Here the reflectance at normal incidence is the specular factor; in KHR_materials_specular it is 0.04 times the
    // specular colour.
    material.metallic = 0;
    material.roughness = 1 - number_member(older, "glossinessFactor", 1);
    // The texture belongs to the fallback for programs without this extension.
    material.textures[static_cast<size_t>(format::SurfaceUse::kMetallicRoughness)] = {};
    std::array<double, 3> reflectance{1, 1, 1};
    read_numbers(older, "specularFactor", reflectance);
    for (size_t c = 0; c < 3; ++c) material.specular_color[c] = reflectance[c] / 0.04;
  }
  material.alpha_cutoff = source.alphaCutoff;
  material.alpha_mask = source.alphaMode == "MASK";
  material.alpha_blend = source.alphaMode == "BLEND";
  // A transmissive surface is drawn as a blended one. At least a quarter of its opacity stays, so that it remains
  // visible.
  const double transmission =
      number_member(member(source.extensions, "KHR_materials_transmission"), "transmissionFactor", 0);
  if (transmission > 0 && !material.alpha_mask && !material.alpha_blend) {
    material.alpha_blend = true;
    material.base_color[3] = 1 - 0.75 * std::min(transmission, 1.0);
  }
  material.double_sided = source.doubleSided;
  material.unlit = source.extensions.count("KHR_materials_unlit") != 0;
  return material;
}

DocTexture read_texture(const tinygltf::Texture& source) {
  DocTexture texture{.name = source.name, .sampler = source.sampler};
  const auto of = [&](const char* extension) { return index_member(member(source.extensions, extension), "source"); };
  texture.sources = {of("KHR_texture_basisu"), of("MSFT_texture_dds"), source.source, of("EXT_texture_webp")};
  return texture;
}

DocNode read_node(const tinygltf::Node& source) {
  DocNode node{.name = source.name,
               .mesh = source.mesh,
               .camera = source.camera,
               .skin = source.skin,
               .has_matrix = source.matrix.size() == 16};
  if (node.has_matrix || !source.translation.empty() || !source.rotation.empty() || !source.scale.empty()) {
    LocalTransform::Values local{};
    if (node.has_matrix) {
      std::copy_n(source.matrix.begin(), 16, local.begin());
    } else {
      local = LocalTransform().values();
      if (source.translation.size() == 3) std::copy_n(source.translation.begin(), 3, local.begin());
      if (source.rotation.size() == 4) std::copy_n(source.rotation.begin(), 4, local.begin() + 3);
      if (source.scale.size() == 3) std::copy_n(source.scale.begin(), 3, local.begin() + 7);
    }
    node.local = LocalTransform(local);
  }
  node.children.assign(source.children.begin(), source.children.end());
  node.light = index_member(member(source.extensions, "KHR_lights_punctual"), "light");
  if (const tinygltf::Value* instancing = member(source.extensions, "EXT_mesh_gpu_instancing")) {
    node.has_instancing = true;
    if (const tinygltf::Value* attributes = member(*instancing, "attributes")) {
      for (const std::string& key : attributes->Keys())
        node.instancing.emplace_back(key, index_member(attributes, key.c_str()));
    }
  }
  return node;
}

DocMesh read_mesh(const tinygltf::Mesh& source, std::span<const int32_t> indices, GltfDocument& document) {
  DocMesh mesh{.name = source.name};
  for (size_t i = 0; i < source.primitives.size(); ++i) {
    const tinygltf::Primitive& from = source.primitives[i];
    DocPrimitive primitive{.mode = from.mode, .indices = indices[i], .material = from.material};
    if (const tinygltf::Value* packed = member(from.extensions, "KHR_draco_mesh_compression")) {
      primitive.draco = static_cast<int32_t>(document.draco.size());
      DocDraco& draco = document.draco.emplace_back();
      draco.view = index_member(packed, "bufferView");
      if (const tinygltf::Value* attributes = member(*packed, "attributes"))
        for (const std::string& key : attributes->Keys())  // in sorted order
          draco.attributes.emplace_back(key, index_member(attributes, key.c_str()));
    }
    primitive.attributes.assign(from.attributes.begin(), from.attributes.end());
    primitive.targets = static_cast<uint32_t>(from.targets.size());
    for (const auto& target : from.targets) {
      for (const auto& [name, accessor] : target) primitive.target_accessors.push_back(accessor);
    }
    mesh.primitives.push_back(std::move(primitive));
  }
  return mesh;
}

void read_bounds(const tinygltf::Accessor& source, GltfDocument& document) {
  if (source.count < kLeastBounded || source.minValues.size() != 3 || source.maxValues.size() != 3) return;
  DocBounds bounds{.accessor = static_cast<uint32_t>(document.accessors.size())};
  for (size_t axis = 0; axis < 3; ++axis) {
    for (const double value : {source.minValues[axis], source.maxValues[axis]})
      if (!(std::abs(value) <= static_cast<double>(std::numeric_limits<float>::max()))) return;
    bounds.min[axis] = static_cast<float>(source.minValues[axis]);
    bounds.max[axis] = static_cast<float>(source.maxValues[axis]);
  }
  document.bounds.push_back(bounds);
}

void read_accessor(const tinygltf::Accessor& source, GltfDocument& document) {
  read_bounds(source, document);
  DocAccessor accessor{.view = source.bufferView,
                       .type = source.componentType,
                       .components = component_count(source.type),
                       .normalized = source.normalized,
                       .offset = source.byteOffset,
                       .count = source.count};
  if (source.sparse.isSparse) {
    accessor.sparse = static_cast<int32_t>(document.sparse.size());
    DocSparse sparse;
    sparse.accessor = static_cast<uint32_t>(document.accessors.size());
    sparse.count = static_cast<uint32_t>(source.sparse.count);
    sparse.index_view = source.sparse.indices.bufferView;
    sparse.index_offset = static_cast<uint32_t>(source.sparse.indices.byteOffset);
    sparse.index_type = source.sparse.indices.componentType;
    sparse.value_view = source.sparse.values.bufferView;
    sparse.value_offset = static_cast<uint32_t>(source.sparse.values.byteOffset);
    document.sparse.push_back(sparse);
  }
  document.accessors.push_back(accessor);
}

DocCamera read_camera(const tinygltf::Camera& source) {
  DocCamera camera;
  camera.name = source.name;
  camera.orthographic = source.type == "orthographic";
  camera.y = camera.orthographic ? source.orthographic.ymag : source.perspective.yfov;
  camera.x = camera.orthographic ? source.orthographic.xmag : source.perspective.aspectRatio;
  camera.z_near = camera.orthographic ? source.orthographic.znear : source.perspective.znear;
  camera.z_far = camera.orthographic ? source.orthographic.zfar : source.perspective.zfar;
  return camera;
}

void take_model(const tinygltf::Model& model, std::span<const int32_t> primitive_indices, GltfDocument& document) {
  for (const auto& view : model.bufferViews)
    document.views.push_back({view.buffer, kAbsent, view.byteOffset, view.byteLength, view.byteStride});
  for (const auto& accessor : model.accessors) read_accessor(accessor, document);
  for (const auto& mesh : model.meshes) {
    document.meshes.push_back(read_mesh(mesh, primitive_indices, document));
    primitive_indices = primitive_indices.subspan(mesh.primitives.size());
  }
  for (const auto& node : model.nodes) document.nodes.push_back(read_node(node));
  for (const auto& scene : model.scenes)
    document.scenes.push_back({scene.name, {scene.nodes.begin(), scene.nodes.end()}});
  for (const auto& material : model.materials) document.materials.push_back(read_material(material));
  for (const auto& texture : model.textures) document.textures.push_back(read_texture(texture));
  for (const auto& sampler : model.samplers) {
    document.samplers.push_back(
        {std::max(sampler.magFilter, 0), std::max(sampler.minFilter, 0), sampler.wrapS, sampler.wrapT});
  }
  for (const auto& camera : model.cameras) document.cameras.push_back(read_camera(camera));
  for (const auto& skin : model.skins) {
    ++document.skins;
    if (skin.inverseBindMatrices != kAbsent) document.skin_accessors.push_back(skin.inverseBindMatrices);
  }
  for (const auto& animation : model.animations) {
    ++document.animations;
    for (const auto& sampler : animation.samplers) {
      document.animation_accessors.push_back(sampler.input);
      document.animation_accessors.push_back(sampler.output);
    }
  }
  for (const auto& name : model.extensionsUsed) document.extensions_used.push_back(name);
  for (const auto& name : model.extensionsRequired) document.extensions_required.push_back(name);
}

}  // namespace

std::string one_line(std::string text) {
  for (char& c : text) c = static_cast<unsigned char>(c) < 0x20 ? ' ' : c;
  while (!text.empty() && (text.back() == ' ' || text.back() == '.')) text.pop_back();
  return text.substr(0, 300);
}

struct ParsedElements::Impl {
  tinygltf::Model model;
  std::vector<int32_t> primitive_indices;
};

Result<ParsedElements> ParsedElements::parse(const std::string& batch, std::vector<int32_t> primitive_indices) {
  tinygltf::Model model = SCREE_TRY(convert::parse(batch));
  size_t primitives = 0;
  for (const auto& mesh : model.meshes) primitives += mesh.primitives.size();
  if (primitives != primitive_indices.size())
    return fail(ErrorCode::kFormat, "the parser read ", primitives, " primitives of ", primitive_indices.size());
  ParsedElements elements;
  elements.impl_ = std::make_shared<const Impl>(Impl{std::move(model), std::move(primitive_indices)});
  return elements;
}

void ParsedElements::add_to(GltfDocument& document) const {
  take_model(impl_->model, impl_->primitive_indices, document);
}

Result<void> read_asset(GltfDocument& document, JsonRange range) {
  const std::span<const char> text = document.text;
  const std::string json =
      "{\"asset\":" + std::string(text.data() + range.begin, static_cast<size_t>(range.end - range.begin)) + "}";
  SCREE_TRY(check_schema("asset", json, 0, range.begin));
  auto model = SCREE_TRY_AT("asset", parse(json));
  const std::string& version = model.asset.version;
  if (version.substr(0, 2) != "2.")
    return Error{ErrorCode::kVersion, "asset: version is \"" + one_line(version.substr(0, 20)) + "\", expected 2.0"};
  if (!model.asset.minVersion.empty() && model.asset.minVersion != "2.0")
    return Error{ErrorCode::kVersion,
                 "asset: minVersion is \"" + one_line(model.asset.minVersion.substr(0, 20)) + "\", expected 2.0"};
  document.copyright = model.asset.copyright;
  return {};
}

}  // namespace scree::convert
