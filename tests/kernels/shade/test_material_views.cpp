#include "kernels/shade/material_views.h"

#include <array>
#include <vector>

#include "tests/catch.h"

using namespace scree;
using namespace kernels;

namespace {

enum : uint32_t { kRough, kNormal, kOcclusion, kEmission, kSpecular, kSpecularColor, kBase };
static_assert(kBase == MaterialView::kBaseUse);

/// A material whose textures are all alike until a test changes them.
struct Material {
  Material() {
    for (TextureView& texture : textures) {
      texture.width = texture.height = 64;
      texture.level_count = 7;
    }
    material.texture = kBase;
    material.uv_scale[0] = material.uv_scale[1] = 1;
    for (uint32_t use = 0; use < format::kSurfaceUses; ++use) surface.textures[use] = {use, {0, 0}, {1, 1}, 0};
  }

  MaterialView view() const {
    kernels::SceneView scene{};
    scene.materials = &material;
    scene.material_count = 1;
    scene.surfaces = &surface;
    scene.surface_count = 1;
    scene.textures = textures.data();
    scene.texture_count = textures.size();
    MaterialView out{.surface = 0};
    kernels::bundle_textures(scene, {&out, 1});
    return out;
  }
  std::vector<uint32_t> bundles() const {
    std::vector<uint32_t> out;
    for (const uint8_t uses : view().bundles)
      if (uses != 0) out.push_back(uses);
    return out;
  }

  format::MaterialRecord material{};
  format::SurfaceRecord surface{};
  std::array<TextureView, MaterialView::kMostBundles> textures{};
};

constexpr uint32_t bit(uint32_t use) {
  return 1u << use;
}
using Bundles = std::vector<uint32_t>;
constexpr uint32_t kAll = bit(kBase + 1) - 1;

}  // namespace

TEST_CASE("material views: textures with the same layout and place are one bundle", "[material_views]") {
  Material all;
  CHECK(all.bundles() == Bundles{kAll});
  CHECK(all.view().uses == kAll);

  Material second;
  second.surface.second_uv = bit(kOcclusion) | bit(kEmission);
  CHECK(second.bundles() == Bundles{kAll & ~second.surface.second_uv, second.surface.second_uv});

  Material moved;
  moved.surface.textures[kNormal].uv_offset[1] = 0.5f;
  moved.material.uv_scale[0] = 2;
  CHECK(moved.bundles() == Bundles{kAll & ~bit(kNormal) & ~bit(kBase), bit(kNormal), bit(kBase)});

  Material plain;
  plain.surface.textures[kSpecular].texture = plain.surface.textures[kSpecularColor].texture = format::kNone;
  plain.textures[kEmission].level_count = 0;
  CHECK(plain.bundles() == Bundles{bit(kRough) | bit(kNormal) | bit(kOcclusion) | bit(kBase)});
}

TEST_CASE("material views: other samplers or levels share the point but not the bundle", "[material_views]") {
  constexpr uint32_t kSame = MaterialView::kSamePoint;
  const auto changed = [](const auto& change) {
    Material made;
    change(made.textures[kNormal]);
    return made.bundles();
  };
  const Bundles apart{kAll & ~bit(kNormal), bit(kNormal) | kSame};
  CHECK(changed([](TextureView& t) { t.wrap_s = format::Wrap::kClamp; }) == apart);
  CHECK(changed([](TextureView& t) { t.wrap_t = format::Wrap::kMirror; }) == apart);
  CHECK(changed([](TextureView& t) { t.magnified_nearest = true; }) == apart);
  CHECK(changed([](TextureView& t) { t.minified_nearest = true; }) == apart);
  CHECK(changed([](TextureView& t) { t.one_level = true; }) == apart);
  CHECK(changed([](TextureView& t) { t.finest_level = true; }) == apart);
  CHECK(changed([](TextureView& t) { t.level_count = 3; }) == apart);
  CHECK(changed([](TextureView& t) { t.block_level_count = 2; }) == apart);
  CHECK(changed([](TextureView& t) { t.height = 32; }) == Bundles{kAll & ~bit(kNormal), bit(kNormal)});
}

TEST_CASE("material views: JPEGs share a bundle if their MCUs and groups are alike", "[material_views]") {
  std::array<JpegLevel, 2> levels{};
  for (JpegLevel& level : levels) {
    level.picture.mcu_width = level.picture.mcu_height = 8;
    level.picture.view.group_mcus = 4;
    level.picture.view.mcus_across = 8;
    level.picture.view.mcu_count = 64;
    level.group_count = 16;
  }
  Material made;
  made.surface.textures[kSpecular].texture = made.surface.textures[kSpecularColor].texture = format::kNone;
  constexpr uint32_t kUses = kAll & ~bit(kSpecular) & ~bit(kSpecularColor);
  for (uint32_t i = 0; i < made.textures.size(); ++i) {
    made.textures[i].jpeg = &levels[i == kEmission ? 1 : 0];
    made.textures[i].jpeg_level_count = 1;
  }
  CHECK(made.bundles() == Bundles{kUses});
  const Bundles apart{kUses & ~bit(kEmission), bit(kEmission) | MaterialView::kSamePoint};
  levels[1].picture.mcu_width = 16;
  CHECK(made.bundles() == apart);
  levels[1].picture.mcu_width = 8;
  levels[1].group_count = 15;
  CHECK(made.bundles() == apart);
  levels[1].group_count = 16;
  levels[1].page = 3;  // unknown until the page is read
  CHECK(made.bundles() == apart);
  levels[1].page = JpegLevel::kNotPaged;
  made.surface.textures[kSpecular].texture = kRough;  // a JPEG has no alpha
  CHECK(made.bundles() == Bundles{kUses});
}

TEST_CASE("material views: a picture with occlusion, roughness and metalness is read once", "[material_views]") {
  Material made;
  CHECK_FALSE(made.view().is_packed);
  made.surface.textures[kOcclusion].texture = kRough;
  CHECK(made.view().is_packed);
  made.textures[kRough].paged_level_count = 1;  // the same pages
  CHECK(made.view().is_packed);
  made.surface.textures[kOcclusion].uv_rotation = 1;
  CHECK_FALSE(made.view().is_packed);
}
