// The textures of a material at a sample, and the values that they give it.
#pragma once

#include "kernels/shade/surface_light.h"
#include "kernels/shade/texture_place.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

/// As LinearCodes; with a null table the values are the codes.
struct SurfaceCodes {
  const float* linear;
  SCREE_HD void read(const uint32_t texels[4], float values[3][4]) const {
    if (linear != nullptr) return LinearCodes{linear}.read(texels, values);
    for (uint32_t c = 0; c < 3; ++c)
      for (uint32_t i = 0; i < 4; ++i) values[c][i] = static_cast<float>(texels[i] >> 8 * c & 255u);
  }
};

/// Whether a texture of a surface uses the mesh's second texture coordinates.
SCREE_HD inline bool uses_second(const format::SurfaceRecord& surface, uint32_t use) {
  return (surface.second_uv >> use & 1u) != 0;
}

/// One bit per use of a texture, as in MaterialView.
SCREE_HD constexpr uint32_t use_bit(format::SurfaceUse use) {
  return 1u << static_cast<uint32_t>(use);
}
inline constexpr uint32_t kBaseUse = MaterialView::kBaseUse;
inline constexpr uint32_t kCameraUses = use_bit(format::SurfaceUse::kNormalMap) |
                                        use_bit(format::SurfaceUse::kOcclusion) |
                                        use_bit(format::SurfaceUse::kEmission);  // visible in the camera's light
inline constexpr uint32_t kColorUses = [] {
  uint32_t bits = 1u << kBaseUse;
  for (uint32_t i = 0; i < format::kSurfaceUses; ++i)
    if (format::is_color(static_cast<format::SurfaceUse>(i))) bits |= 1u << i;
  return bits;
}();

/// The texels of a sample's textures, three channels by use: linear colours, and the 8-bit codes of numbers. Kept in
/// memory, and filled in only for the textures that the sample has.
inline constexpr uint32_t kTint = MaterialView::kMostBundles;  // the vertex colours
struct alignas(16) TextureCodes {
  float of[kTint + 1][4];
};

/// The textures that a sample reads.
struct MaterialTextures {
  // Numbers, because a GPU keeps pointers in two registers.
  uint32_t material = format::kNone;
  uint32_t surface = format::kNone;  // kNone: there is only a base colour
  uint32_t uses = 0;                 // bits of the textures
  uint32_t first = 0;                // the first bundle that is read

  SCREE_HD const MaterialView& view_in(const SceneView& scene) const { return scene.material_views[material]; }
  SCREE_HD uint32_t number_of(const SceneView& scene, uint32_t use) const {
    return use == kBaseUse ? scene.materials[material].texture : scene.surfaces[surface].textures[use].texture;
  }
  SCREE_HD const float* transform_of(const SceneView& scene, uint32_t use) const {
    return use == kBaseUse ? uv_transform(scene.materials[material])
                           : uv_transform(scene.surfaces[surface].textures[use]);
  }
  SCREE_HD bool is_second_of(const SceneView& scene, uint32_t use) const {
    return use != kBaseUse && uses_second(scene.surfaces[surface], use);
  }
  SCREE_HD bool has(uint32_t use) const { return (uses >> use & 1u) != 0; }
  SCREE_HD bool has(format::SurfaceUse use) const { return has(static_cast<uint32_t>(use)); }
};

SCREE_HD inline MaterialTextures textures_of(const ShadeInputs& in, const format::MeshRecord& mesh) {
  using Use = format::SurfaceUse;
  if (mesh.material == format::kNone) return {};
  const format::MaterialRecord& material = in.scene.materials[mesh.material];
  const MaterialView& view = in.scene.material_views[mesh.material];
  MaterialTextures out{mesh.material};
  constexpr uint32_t kBaseBit = 1u << kBaseUse;
  uint32_t uses = kBaseBit;
  if ((material.flags & format::kMaterialUnlit) == 0 && view.surface != format::kNone) {
    const format::SurfaceRecord& surface = in.scene.surfaces[view.surface];
    out.surface = view.surface;
    uses |= in.light.lighting == Lighting::kCamera ? kCameraUses : kBaseBit - 1u;
    const float* const emission = surface.emission;
    if (!(max_of(emission[0], max_of(emission[1], emission[2])) > 0)) uses &= ~use_bit(Use::kEmission);
    if ((mesh.attributes & format::kHasSecondUv) == 0) uses &= ~surface.second_uv | kBaseBit;
  }
  uses &= (mesh.attributes & format::kHasUv) != 0 ? view.uses : 0u;
  // A packed occlusion is read with metalness and roughness.
  const bool is_packed = view.is_packed && (uses & use_bit(Use::kMetallicRoughness)) != 0;
  out.uses = is_packed ? uses & ~use_bit(Use::kOcclusion) : uses;
  while (out.uses != 0 && (view.bundles[out.first] & out.uses) == 0) ++out.first;
  return out;
}

/// Reads a material's textures. `place`: of the first bundle. The textures of a bundle share the places of their
/// texels. They are read in a loop, so that the kernel contains one sampler; with seven, nvcc took minutes to compile
/// it. The loop over the textures is the inner one, so that a GPU keeps the places on one level in registers.
template <class Shader>
SCREE_HD inline void read_textures(const Shader& shader, const PlacedChunk& at, const MaterialTextures& textures,
                                   TexturePlace place, float x, float y, typename Shader::Texels::Lane& lane,
                                   TextureCodes& out) {
  const ShadeInputs& in = shader.in;
  bool is_placed = true;
  uint32_t rest = textures.uses;
#if defined(__CUDA_ARCH__)
#pragma unroll 1
#endif
  for (uint32_t b = textures.first; rest != 0; ++b) {
    const uint32_t bundle = textures.view_in(in.scene).bundles[b];
    if (b != textures.first && (bundle & MaterialView::kSamePoint) == 0) is_placed = false;
    const uint32_t uses = bundle & rest;
    rest &= ~bundle;
    if (uses == 0) continue;
    const uint32_t first = lowest_bit(uses);
    const TextureView& layout = in.scene.textures[textures.number_of(in.scene, first)];
    if (!is_placed) [[unlikely]]
      place =
          shader.find_place_again(at, textures.transform_of(in.scene, first), textures.is_second_of(in.scene, first),
                                  static_cast<float>(layout.width), static_cast<float>(layout.height), x, y);
    is_placed = true;
    const SampledLevels levels = sampled_levels(layout, place.footprint);
    const uint32_t u = wrap_point(place.u, layout.wrap_s);
    const uint32_t v = wrap_point(place.v, layout.wrap_t);
#if defined(__CUDA_ARCH__)
#pragma unroll 1
#endif
    for (uint32_t i = 0; i < levels.count(); ++i) {
      LevelPoint point;
      place_level(shader.texels, lane, layout, levels.fine + i, u, v, levels.nearest, point);
#if defined(__CUDA_ARCH__)
#pragma unroll 1
#endif
      for (uint32_t left = uses; left != 0; left &= left - 1) {
        const uint32_t use = lowest_bit(left);
        const TextureView& texture = in.scene.textures[textures.number_of(in.scene, use)];
        const bool is_color = (kColorUses >> use & 1u) != 0;
        const uint32_t first_bit = use == static_cast<uint32_t>(format::SurfaceUse::kSpecular) ? 24 : 0;
        float some[3];
        sample_level(shader.texels, lane, texture, SurfaceCodes{is_color ? in.srgb->linear : nullptr}, first_bit, point,
                     some);
        mix_level(i, some, levels.between, out.of[use]);
      }
    }
  }
}

SCREE_HD inline Float3 color_of(const TextureCodes& codes, uint32_t use) {
  const float* const code = codes.of[use];
  return {code[0], code[1], code[2]};
}
SCREE_HD inline Float3 color_of(const TextureCodes& codes, format::SurfaceUse use) {
  return color_of(codes, static_cast<uint32_t>(use));
}
/// The texel of a texture of numbers, from 0 to 1.
SCREE_HD inline Float3 numbers_of(const TextureCodes& codes, format::SurfaceUse use) {
  return color_of(codes, use) * (1.0f / 255.0f);
}
SCREE_HD inline float occluded(const format::SurfaceRecord& surface, float code) {
  return 1.0f + surface.occlusion_strength * (code - 1.0f);
}

/// The values of a material at a sample: its factors times its textures.
SCREE_HD inline SurfaceValues surface_values(const ShadeInputs& in, const MaterialTextures& textures,
                                             const TextureCodes& codes) {
  using Use = format::SurfaceUse;
  SurfaceValues out;
  if (textures.has(kBaseUse)) out.base = color_of(codes, kBaseUse);
  if (textures.material != format::kNone) {
    const float* const color = in.scene.materials[textures.material].base_color;
    out.base = out.base * Float3{color[0], color[1], color[2]};
  }
  if (textures.surface == format::kNone) return out;
  const format::SurfaceRecord& surface = in.scene.surfaces[textures.surface];
  out.metallic = surface.metallic;
  out.roughness = surface.roughness;
  out.emission = {surface.emission[0], surface.emission[1], surface.emission[2]};
  out.specular = surface.specular;
  out.specular_color = {surface.specular_color[0], surface.specular_color[1], surface.specular_color[2]};
  if (textures.has(Use::kMetallicRoughness)) {
    const Float3 code = numbers_of(codes, Use::kMetallicRoughness);
    out.roughness *= code.y;
    out.metallic *= code.z;
    // An occlusion in the red of the same picture is read with it.
    if (textures.view_in(in.scene).is_packed) out.occlusion = occluded(surface, code.x);
  }
  if (textures.has(Use::kOcclusion)) out.occlusion = occluded(surface, numbers_of(codes, Use::kOcclusion).x);
  if (textures.has(Use::kEmission)) out.emission = out.emission * color_of(codes, Use::kEmission);
  if (textures.has(Use::kSpecular)) out.specular *= numbers_of(codes, Use::kSpecular).x;  // the alpha
  if (textures.has(Use::kSpecularColor)) out.specular_color = out.specular_color * color_of(codes, Use::kSpecularColor);
  return out;
}

/// Whether a use of a texture has the point of the first bundle.
SCREE_HD inline bool has_first_point(const ShadeInputs& in, const MaterialTextures& textures, uint32_t use) {
  const uint8_t* const bundles = textures.view_in(in.scene).bundles;
  uint32_t b = textures.first;
  while ((bundles[b] >> use & 1u) == 0 && (bundles[b + 1] & MaterialView::kSamePoint) != 0) ++b;
  return (bundles[b] >> use & 1u) != 0;
}

}  // namespace SCREE_ISA
}  // namespace scree::kernels
