// Scenes with blended surfaces, for the tests of the CPU and the GPU.
#pragma once

#include <span>

#include "kernels/blend.h"
#include "tests/kernels/raster/mask_cases.h"

namespace scree::tests {

/// Adds blended, masked and opaque meshes with small and large triangles: alpha by a factor, by a texture, by vertex
/// colours, and by all of them. Several lie in one place, and some are mirrored. `clustered_alone`: as
/// add_masked_meshes().
inline void add_blended_meshes(SceneBuilder& builder, bool clustered_alone) {
  const kernels::MaskView texture = mask_view(61, 37, 4, 0);
  std::vector<uint8_t> levels = noisy_levels(61, 37, 4, 5);
  for (size_t i = 0; i < levels.size(); ++i)
    if (i % 5 != 0) levels[i] = i % 3 == 0 ? 0 : 255;  // many texels are transparent, and many opaque
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

/// The layers of a picture: samples and alphas of each.
struct DrawnLayers {
  std::vector<std::vector<uint64_t>> samples;
  std::vector<std::vector<float>> alphas;  // 0 for samples without a surface
  kernels::BlendCounts counts;

  bool operator==(const DrawnLayers& other) const {
    return samples == other.samples && alphas == other.alphas && counts.layers == other.counts.layers &&
           counts.samples_left_out == other.counts.samples_left_out;
  }
  void add(std::span<const uint64_t> layer, std::span<const float> alpha) {
    samples.emplace_back(layer.begin(), layer.end());
    alphas.emplace_back(alpha.begin(), alpha.end());
    for (size_t i = 0; i < layer.size(); ++i)
      if (layer[i] == kernels::kBackground) alphas.back()[i] = 0;
  }
};

inline DrawnLayers draw_layers(const kernels::SceneView& scene, const kernels::View& view, uint32_t most = 64,
                               uint32_t threads = 2) {
  const std::vector<uint64_t> opaque = draw(scene, view, threads);
  const kernels::SceneView blended = kernels::blended_view(scene);
  DrawnLayers layers;
  const kernels::LayerSource source{[&](const kernels::BlendTargets& at, const uint64_t* peeled) {
                                      return kernels::draw_layer_cpu(blended, view, at, peeled, threads);
                                    },
                                    [&](const kernels::BlendTargets& at) {
                                      const Result<void> shaded =
                                          kernels::shade_layer_cpu(blended, view, at, at.layer, {}, threads);
                                      layers.add({at.layer, at.sample_count}, {at.alphas, at.sample_count});
                                      return shaded;
                                    }};
  REQUIRE(kernels::blend_cpu(view, opaque, most, source, threads, layers.counts));
  return layers;
}

}  // namespace scree::tests
