// Scenes with alpha masks, for the tests of the CPU and the GPU.
#pragma once

#include <array>
#include <cmath>
#include <random>
#include <span>
#include <vector>

#include "format/container/mip_levels.h"
#include "kernels/raster/mask.h"
#include "tests/kernels/scene_builder.h"

namespace scree::tests {

/// Levels of 8-bit noise with some runs of equal values.
inline std::vector<uint8_t> noisy_levels(uint32_t width, uint32_t height, uint32_t levels, uint32_t seed) {
  std::mt19937 random(seed);
  std::vector<uint8_t> alpha(format::mask_bytes(width, height, levels));
  for (size_t i = 0; i < alpha.size(); ++i)
    alpha[i] = i % 7 < 3 && i > 0 ? alpha[i - 1] : static_cast<uint8_t>(random() % 256);
  return alpha;
}

inline kernels::MaskView mask_view(uint32_t width, uint32_t height, uint32_t levels, uint32_t threshold) {
  kernels::MaskView mask{};
  mask.width = width;
  mask.height = height;
  mask.level_count = levels;
  mask.threshold = threshold;
  mask.needs = format::kHasUv;
  mask.place[0][0] = mask.place[1][1] = 1;
  mask.complete();
  return mask;
}

/// Adds texture coordinates to a soup: the texture along x and z, rotated a little, `repeats` times as often.
inline Soup with_uvs(Soup soup, double repeats) {
  for (size_t v = 0; v < soup.positions.size() / 3; ++v) {
    const double x = soup.positions[3 * v], z = soup.positions[3 * v + 2];
    soup.uvs.push_back(static_cast<float>(repeats * (0.4 * x + 0.1 * z) + 0.3));
    soup.uvs.push_back(static_cast<float>(repeats * (0.5 * z - 0.07 * x) - 1.7));
  }
  return soup;
}

/// Adds colours whose alpha differs from vertex to vertex.
inline Soup with_colors(Soup soup) {
  for (size_t v = 0; v < soup.positions.size() / 3; ++v)
    soup.colors.insert(soup.colors.end(), {1.0f, 0.5f, 0.2f, static_cast<float>(v % 7) / 6.0f});
  return soup;
}

struct SceneEncodings {
  Encoding clustered, second, third;
};

/// Clusters, a lattice and floats. `clustered_alone`: clusters instead of the other two.
inline SceneEncodings encodings_of_scene(bool clustered_alone) {
  const Encoding lattice{.chunk_triangles = 700};
  Encoding clustered = lattice;
  clustered.clusters = Clusters::kClustered;
  Encoding floats = float32();
  floats.chunk_triangles = 333;
  return {clustered, clustered_alone ? clustered : lattice, clustered_alone ? clustered : floats};
}

inline Encoding with(Encoding encoding, uint32_t material) {
  encoding.material = material;
  return encoding;
}

/// Places each mesh four times: as it is, smaller, mirrored, and by `more`.
inline void place_all(SceneBuilder& builder, std::span<const uint32_t> meshes, const std::array<double, 12>& more) {
  const uint32_t matrices[] = {builder.identity(), builder.matrix({0.5, 0, 0.1, 0.6, 0, 0.5, 0, 0.3, 0, 0, 0.5, -0.2}),
                               builder.matrix({-0.3, 0, 0, -0.6, 0, 0.3, 0, 0.1, 0, 0, 0.3, 0.4}),
                               builder.matrix(more)};
  for (const uint32_t mesh : meshes)
    for (const uint32_t matrix : matrices) builder.instance(mesh, matrix);
}

/// Adds masked and opaque meshes with small and large triangles and every wrap mode. Some hide parts of others, and
/// some instances are mirrored. `clustered_alone`: all encodings are clustered.
inline void add_masked_meshes(SceneBuilder& builder, bool clustered_alone) {
  using format::Wrap;
  kernels::MaskView wraps[3];
  for (uint32_t i = 0; i < 3; ++i) {
    wraps[i] = mask_view(61 + 40 * i, 37, i == 2 ? 1 : 4, 110 * 65536);
    wraps[i].wrap_s = static_cast<Wrap>(i);
    wraps[i].wrap_t = static_cast<Wrap>((i + 1) % 3);
    wraps[i].magnified_nearest = i == 1;
    wraps[i].minified_nearest = i != 2;
  }
  // KHR_texture_transform: a rotation by 180 degrees, a scale of 1.25 and an offset.
  wraps[0].place[0][0] = wraps[0].place[1][1] = -1.25;
  wraps[0].place[0][2] = 0.3;
  uint32_t materials[3];
  for (uint32_t i = 0; i < 3; ++i)
    materials[i] = builder.masked_material(i == 1 ? 0 : uint32_t{format::kMaterialDoubleSided}, wraps[i],
                                           noisy_levels(wraps[i].width, 37, wraps[i].level_count, i));
  const auto [clustered, second, third] = encodings_of_scene(clustered_alone);
  const uint32_t meshes[] = {builder.mesh(with_uvs(grid(40, 0.2), 3), with(clustered, materials[0])),
                             builder.mesh(with_uvs(grid(31, 0.3), 40), with(second, materials[1])),
                             builder.mesh(with_uvs(grid(1, 0), 2), with(third, materials[2])),
                             builder.mesh(with_uvs(grid(2, 0.1), 5), with(clustered, materials[0])),
                             builder.mesh(with_colors(with_uvs(grid(23, 0.3), 2)), with(clustered, materials[0])),
                             builder.mesh(with_colors(with_uvs(grid(1, 0), 1)), with(third, materials[2])),
                             builder.mesh(with_colors(with_uvs(grid(3, 0.2), 1)), with(second, materials[0])),
                             builder.mesh(grid(12, 0.1), with(second, materials[0])),  // no texture coordinates: opaque
                             builder.mesh(with_uvs(grid(9, 0.1), 1), clustered)};      // no material
  place_all(builder, meshes, {1, 0, 0, 0.2, 0, 1, 0, -0.7, 0, 0, 1, 0.3});             // behind others
}

/// Views from far, near (the near plane cuts triangles), inside and above, and two orthographic ones. They are 1 /
/// `share` as wide and high.
inline std::vector<kernels::View> masked_views(uint32_t share = 1) {
  const kernels::View far = look_at({2.5, 2, 3}, {0, 0, 0}, 321 / share, 203 / share);
  const kernels::View near = look_at({0.4, 0.25, 0.5}, {0, 0.1, 0}, 200 / share, 333 / share, 0.3);
  const kernels::View above = look_at({0, 3, 0}, {0, 0, 0}, 256 / share, 256 / share);
  return {far,
          near,
          look_at({0.1, 0.35, 0.9}, {0, 0.2, -1}, 150 / share, 90 / share, 0.001),
          above,
          orthographic(far, 1.6, 0.1, 20),
          orthographic(near, 0.3, 0.01, 9)};
}

/// Views along a walk around the scene, in which each frame can reuse the visibility of the previous one. `turn`:
/// radians per step.
inline std::vector<kernels::View> walk(int steps, double turn, uint32_t width, uint32_t height) {
  std::vector<kernels::View> views;
  for (int step = 0; step < steps; ++step) {
    const double angle = turn * step;
    views.push_back(
        look_at({2 * std::cos(angle), 0.3 + 0.01 * step, 2 * std::sin(angle)}, {0, 0, 0}, width, height, 0.2));
  }
  return views;
}

}  // namespace scree::tests
