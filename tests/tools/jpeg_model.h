// A scene of JPEG textures of every kind, for the tests that draw them.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "tests/format/jpeg/jpeg_maker.h"
#include "tests/runtime/load_scene.h"
#include "tests/tools/model_maker.h"

namespace scree::tests {

inline JpegRecipe jpeg_recipe(int width, int height, std::vector<std::pair<int, int>> factors) {
  return {.width = width, .height = height, .factors = std::move(factors)};
}

/// Grids of `side` quads per side, side by side, each with another JPEG, wrapping, filter and transform. Some have many
/// repeats, and some are close up. `alpha`: below 1 the grids blend, and each is drawn twice, one above the other.
inline void make_jpeg_model(const std::string& path, uint32_t side = 4, double alpha = 1) {
  ModelMaker maker(path);
  const std::vector<JpegRecipe> recipes = {
      jpeg_recipe(517, 389, {{2, 2}, {1, 1}, {1, 1}}),  jpeg_recipe(300, 300, {{1, 1}, {1, 1}, {1, 1}}),
      jpeg_recipe(256, 1000, {{2, 1}, {1, 1}, {1, 1}}), jpeg_recipe(640, 200, {{1, 1}}),
      jpeg_recipe(333, 201, {{4, 1}, {1, 1}, {1, 1}}),  jpeg_recipe(90, 40, {{2, 2}, {1, 1}, {1, 1}})};
  using format::Wrap;
  constexpr Wrap kWraps[3] = {Wrap::kRepeat, Wrap::kMirror, Wrap::kClamp};
  for (size_t i = 0; i < recipes.size(); ++i) {
    JpegRecipe jpeg = recipes[i];
    jpeg.is_rgb = i == 1;
    jpeg.restart = i == 2 ? 7 : 0;
    tools::GltfTexture texture = maker.texture("i" + std::to_string(i), format::ImageCodec::kJpeg, make_jpeg(jpeg));
    texture.wrap_s = kWraps[i % 3];
    texture.wrap_t = kWraps[(i + 1) % 3];
    texture.mag_filter = i == 4 ? 9728 : 9729;
    tools::GltfMaterial material{.texture = maker.writer().add_texture(texture), .unlit = i % 2 == 0};
    material.double_sided = true;
    material.base_color[3] = alpha;
    if (alpha < 1) material.alpha = tools::GltfAlpha::kBlend;
    material.transform.scale[0] = i == 3 ? 9 : 0.4;
    material.transform.scale[1] = i == 2 ? 0.05 : 1.3;
    material.transform.offset[0] = -0.37 * static_cast<double>(i);
    material.transform.rotation = 0.3 * static_cast<double>(i);
    const GridSpec spec{.columns = side,
                        .rows = side,
                        .origin = {1.05f * static_cast<float>(i % 3), 0, 1.05f * static_cast<float>(i / 3)},
                        .uv = true};
    const uint32_t mesh =
        maker.mesh("m" + std::to_string(i), {maker.grid(spec, maker.writer().add_material(material))});
    maker.node("n" + std::to_string(i), mesh);
    if (alpha < 1) maker.node("a" + std::to_string(i), mesh, {0, 0.2, 0});
  }
  maker.finish();
}

/// Loads the scene with SceneOptions of these names. A GPU gets the same `texture_memory`.
inline runtime::Scene load_cached(const std::string& path, uint64_t texture_cache, uint64_t texture_memory = 0) {
  return must_load(path, {.threads = 2,
                          .texture_cache = texture_cache,
                          .texture_memory = texture_memory,
                          .device_texture_memory = texture_memory});
}

}  // namespace scree::tests
