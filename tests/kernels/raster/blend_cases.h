// Scenes with blended surfaces, for the tests of the CPU and the GPU.
#pragma once

#include <span>
#include <utility>
#include <vector>

#include "kernels/blend.h"
#include "tests/kernels/raster/mask_cases.h"

namespace scree::tests {

/// Adds blended, masked and opaque meshes with small and large triangles: alpha by a factor, a texture, vertex colours,
/// and all of them; several lie in one place, and some are mirrored. `clustered_alone`: as add_masked_meshes().
inline void add_blended_meshes(SceneBuilder& builder, bool clustered_alone) {
  const kernels::MaskView texture = mask_view(61, 37, 4, 0);
  std::vector<uint8_t> levels = noisy_levels(61, 37, 4, 5);
  for (size_t i = 0; i < levels.size(); ++i)
    if (i % 5 != 0) levels[i] = i % 3 == 0 ? 0 : 255;  // much is clear, and much opaque
  const uint32_t glass = builder.blended_material(0.4f);
  const uint32_t leaf = builder.blended_material(1, texture, levels);
  const uint32_t film = builder.blended_material(0.8f, texture, levels);
  const uint32_t paint = builder.blended_material(1);
  const uint32_t masked = builder.masked_material(format::kMaterialDoubleSided, mask_view(61, 37, 4, 110 * 65536),
                                                  noisy_levels(61, 37, 4, 1));
  builder.materials[glass].base_color[0] = 0.1f;
  builder.materials[film].base_color[1] = 0.3f;
  const auto [clustered, second, third] = encodings_of_scene(clustered_alone);
  const uint32_t meshes[] = {builder.mesh(grid(12, 0.2), with(clustered, glass)),
                             builder.mesh(with_uvs(grid(17, 0.3), 5), with(second, leaf)),
                             builder.mesh(with_uvs(grid(1, 0), 3), with(third, film)),
                             builder.mesh(with_colors(grid(9, 0.1)), with(clustered, paint)),
                             builder.mesh(with_colors(with_uvs(grid(6, 0.1), 2)), with(second, film)),
                             builder.mesh(grid(3, 0.1), with(second, leaf)),  // no texture coordinates: opaque
                             builder.mesh(with_uvs(grid(5, 0.1), 4), with(third, masked)),
                             builder.mesh(grid(9, 0.1), clustered)};
  const uint32_t matrices[] = {builder.identity(), builder.matrix({0.5, 0, 0.1, 0.6, 0, 0.5, 0, 0.3, 0, 0, 0.5, -0.2}),
                               builder.matrix({-0.3, 0, 0, -0.6, 0, 0.3, 0, 0.1, 0, 0, 0.3, 0.4})};
  for (const uint32_t mesh : meshes)
    for (const uint32_t matrix : matrices) builder.instance(mesh, matrix);
  builder.instance(meshes[0], matrices[0]);  // twice in one place: the ids decide
  builder.instance(meshes[2], builder.matrix({1, 0, 0, 0, 0, 1, 0, 0.5, 0, 0, 1, 0}));
}

/// What a picture's layers are.
struct DrawnLayers {
  // Of each: words, kBackground where a sample has none, and alphas, 0 there. Only where a pass draws one layer.
  std::vector<std::vector<uint64_t>> samples;
  std::vector<std::vector<float>> alphas;
  std::vector<float> over;  // BlendTargets::over
  kernels::BlendCounts counts;

  bool operator==(const DrawnLayers& other) const {
    return samples == other.samples && alphas == other.alphas && is_as_deep(other);
  }
  /// As many layers, which let the same light through, to the bit.
  bool is_as_deep(const DrawnLayers& other) const {
    bool same = counts.layers == other.counts.layers && counts.samples_left_out == other.counts.samples_left_out &&
                over.size() == other.over.size();
    for (size_t i = 3; same && i < over.size(); i += 4) same = over[i] == other.over[i];
    return same;
  }
  void add(std::span<const uint64_t> drawn, std::span<const uint64_t> opaque, std::span<const float> shaded) {
    std::vector<uint64_t>& words = samples.emplace_back(drawn.begin(), drawn.end());
    std::vector<float>& own = alphas.emplace_back(drawn.size());
    for (size_t i = 0; i < words.size(); ++i) {
      if (words[i] == 0 || words[i] == opaque[i])
        words[i] = kernels::kBackground;
      else
        own[i] = shaded[4 * i + 3];
    }
  }
  /// A last pass may have drawn what is not shown.
  void end() {
    samples.resize(counts.layers);
    alphas.resize(counts.layers);
  }
  /// Whether a pass has drawn the words of these layers. `drawn`, `further`: of BlendTargets.
  bool has_drawn(std::span<const uint64_t> drawn, std::span<const uint32_t> further, uint32_t before,
                 uint32_t width) const {
    const size_t count = over.size() / 4;
    for (size_t l = 0; l < drawn.size() / count && before + l < samples.size(); ++l) {
      for (size_t i = 0; i < count; ++i) {
        const size_t x = i % width;
        const size_t y = i / width;
        const bool is_open = (further[y / 4 * ((width + 7) / 8) + x / 8] >> (y % 4 * 8 + x % 8) & 1) != 0;
        const uint64_t word = samples[before + l][i];
        if (word != kernels::kBackground && (!is_open || drawn[l * count + i] != word)) return false;
      }
    }
    return true;
  }
};

/// Layer by layer, each of which is drawn and shaded before it is laid.
inline DrawnLayers draw_layers(const kernels::SceneView& scene, const kernels::View& view, uint32_t most = 64,
                               uint32_t threads = 2) {
  const std::vector<uint64_t> opaque = draw(scene, view, threads);
  const kernels::SceneView blended = kernels::blended_view(scene);
  DrawnLayers layers;
  const kernels::LayerSource source{
      [&](const kernels::BlendTargets& at, const uint64_t* peeled) {
        Result<void> done = kernels::draw_layers_cpu(blended, view, at, peeled, threads);
        if (done) done = kernels::shade_layers_cpu(blended, view, at, nullptr, {}, threads);
        layers.add({at.drawn, at.sample_count}, opaque, {at.shaded, 4 * size_t{at.sample_count}});
        return done;
      },
      {}};
  Result<std::vector<float>> over = kernels::blend_cpu(view, opaque, most, source, threads, layers.counts);
  REQUIRE(over);
  layers.over = std::move(*over);
  layers.end();
  return layers;
}

/// `per_pass` of them at once, compared with `expected` as they are drawn. Returns `over` and the counts.
inline DrawnLayers draw_layers_together(const kernels::SceneView& scene, const kernels::View& view, uint32_t per_pass,
                                        const DrawnLayers& expected, uint32_t most = 64, uint32_t threads = 2) {
  const std::vector<uint64_t> opaque = draw(scene, view, threads);
  const kernels::SceneView blended = kernels::blended_view(scene);
  DrawnLayers layers;
  kernels::LayerSource source{
      [&](const kernels::BlendTargets& at, const uint64_t* peeled) {
        return kernels::draw_layers_cpu(blended, view, at, peeled, threads);
      },
      [&](const kernels::BlendTargets& at, const kernels::BlendPass& pass) {
        CHECK(expected.has_drawn({at.drawn, size_t{at.layers} * at.sample_count},
                                 {at.further, size_t{(view.width + 7) / 8} * ((view.height + 3) / 4)}, pass.before,
                                 view.width));
        return kernels::shade_layers_cpu(blended, view, at, &pass, {}, threads);
      }};
  source.layers_per_pass = per_pass;
  Result<std::vector<float>> over = kernels::blend_cpu(view, opaque, most, source, threads, layers.counts);
  REQUIRE(over);
  layers.over = std::move(*over);
  return layers;
}

}  // namespace scree::tests
