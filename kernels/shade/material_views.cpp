#include "kernels/shade/material_views.h"

#include <algorithm>
#include <bit>
#include <tuple>

namespace scree::kernels {
namespace {

using Use = format::SurfaceUse;

bool same_levels(const JpegLevel& a, const JpegLevel& b) {
  // A paged level is coded in a way that is known only once its page is read.
  if (a.page != JpegLevel::kNotPaged || b.page != JpegLevel::kNotPaged) return false;
  const format::JpegPicture &p = a.picture, &q = b.picture;
  return a.group_count == b.group_count && p.mcu_width == q.mcu_width && p.mcu_height == q.mcu_height &&
         p.view.group_mcus == q.view.group_mcus && p.view.mcus_across == q.view.mcus_across &&
         p.view.mcu_count == q.view.mcu_count;
}

/// Whether all samplers and levels are alike, so that equal points lead to texels at equal TexelPlaces.
bool same_layout(const TextureView& a, const TextureView& b) {
  const auto samplers = [](const TextureView& t) {
    return std::tuple(t.width, t.height, t.level_count, t.wrap_s, t.wrap_t, t.magnified_nearest, t.minified_nearest,
                      t.one_level, t.finest_level);
  };
  const auto levels = [](const TextureView& t) {
    return std::tuple(t.jpeg_level_count, t.block_level_count, t.paged_level_count, t.block_format);
  };
  return samplers(a) == samplers(b) && levels(a) == levels(b) && a.paged_level_count == 0 &&
         std::equal(a.jpeg, a.jpeg + a.jpeg_level_count, b.jpeg, same_levels);
}

/// A use of a texture by a material.
struct TextureUse {
  uint32_t texture;        // or kNone
  const float* transform;  // five floats: offset, scale and rotation
  bool is_second;
};

bool same_point(const TextureView& a, const TextureView& b, const TextureUse& of_a, const TextureUse& of_b) {
  return a.width == b.width && a.height == b.height && of_a.is_second == of_b.is_second &&
         std::equal(of_a.transform, of_a.transform + 5, of_b.transform);
}

void bundle_textures(const SceneView& scene, const format::MaterialRecord& material,
                     const format::SurfaceRecord* surface, MaterialView& out) {
  TextureUse of[MaterialView::kMostBundles];
  of[MaterialView::kBaseUse] = {material.texture, material.uv_offset, false};
  for (uint32_t use = 0; use < format::kSurfaceUses; ++use) {
    if (surface == nullptr) {
      of[use] = {format::kNone, nullptr, false};
    } else {
      const format::SurfaceTexture& texture = surface->textures[use];
      of[use] = {texture.texture, texture.uv_offset, (surface->second_uv >> use & 1u) != 0};
    }
  }
  const auto texture_of = [&](uint32_t use) -> const TextureView& { return scene.textures[of[use].texture]; };

  uint32_t left = 0;
  for (uint32_t use = 0; use < MaterialView::kMostBundles; ++use) {
    if (of[use].texture == format::kNone || texture_of(use).level_count == 0) continue;
    if (use == static_cast<uint32_t>(Use::kSpecular) && texture_of(use).jpeg_level_count != 0) continue;  // no alpha
    left |= 1u << use;
  }
  uint32_t count = 0;
  while (left != 0) {
    const auto first = static_cast<uint32_t>(std::countr_zero(left));
    uint32_t at_point = 0;
    for (uint32_t use = first; use < MaterialView::kMostBundles; ++use)
      if ((left >> use & 1u) != 0 && same_point(texture_of(first), texture_of(use), of[first], of[use]))
        at_point |= 1u << use;
    left &= ~at_point;
    for (uint32_t mark = 0; at_point != 0; mark = MaterialView::kSamePoint) {
      const auto begin = static_cast<uint32_t>(std::countr_zero(at_point));
      uint32_t bundle = 0;
      for (uint32_t use = begin; use < MaterialView::kMostBundles; ++use)
        if ((at_point >> use & 1u) != 0 &&
            (of[begin].texture == of[use].texture || same_layout(texture_of(begin), texture_of(use))))
          bundle |= 1u << use;
      at_point &= ~bundle;
      out.bundles[count++] = static_cast<uint8_t>(bundle | mark);
      out.uses = static_cast<uint8_t>(out.uses | bundle);
    }
  }
  constexpr auto kRough = static_cast<uint32_t>(Use::kMetallicRoughness);
  constexpr auto kOcclusion = static_cast<uint32_t>(Use::kOcclusion);
  constexpr uint32_t kBoth = 1u << kRough | 1u << kOcclusion;
  out.is_packed = of[kRough].texture == of[kOcclusion].texture &&
                  std::ranges::any_of(out.bundles, [](uint32_t uses) { return (uses & kBoth) == kBoth; });
}

}  // namespace

void bundle_textures(const SceneView& scene, std::span<MaterialView> materials) {
  for (size_t m = 0; m < materials.size(); ++m) {
    const uint32_t surface = materials[m].surface;
    bundle_textures(scene, scene.materials[m], surface != format::kNone ? scene.surfaces + surface : nullptr,
                    materials[m]);
  }
}

}  // namespace scree::kernels
