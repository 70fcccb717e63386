// Triangles without order, so that chunks lie all over the picture.
#pragma once

#include <cstdint>
#include <random>
#include <utility>
#include <vector>

#include "tests/kernels/scene_builder.h"

namespace scree::tests {

/// Adds a triangle whose corners lie within `reach` of `place`, along each axis.
inline void add_triangle(Soup& soup, const double (&place)[3], double reach, std::mt19937& random) {
  std::uniform_real_distribution<double> unit(-1, 1);
  uint32_t corner[3];
  for (uint32_t& c : corner)
    c = soup.add(place[0] + reach * unit(random), place[1] + reach * unit(random), place[2] + reach * unit(random));
  soup.triangle(corner[0], corner[1], corner[2]);
}

inline Soup triangles_around(uint32_t count, std::mt19937& random) {
  std::uniform_real_distribution<double> unit(-1, 1);
  Soup soup;
  for (uint32_t i = 0; i < count; ++i) {
    const double place[3] = {unit(random), unit(random), 3 * unit(random)};
    add_triangle(soup, place, 0.2, random);
  }
  return soup;
}

/// In turn: floats, clusters, and indexed chunks on a lattice.
inline Encoding encoding_of(int number) {
  if (number % 3 == 0) return {.float32 = true};
  return {.clusters = number % 3 == 1 ? Clusters::kClustered : Clusters::kNone};
}

/// Meshes of `triangles` each, in all encodings.
inline std::vector<std::pair<Soup, Encoding>> mixed_soups(int count, uint32_t triangles, uint32_t seed) {
  std::mt19937 random(seed);
  std::vector<std::pair<Soup, Encoding>> meshes;
  for (int i = 0; i < count; ++i) meshes.emplace_back(triangles_around(triangles, random), encoding_of(i));
  return meshes;
}

/// Meshes of clusters, one of them with colours behind them, and one of indexed chunks. `side`: of the first one's
/// grid.
inline std::vector<std::pair<Soup, Encoding>> clustered_meshes(uint32_t side) {
  constexpr Encoding kClusters{.clusters = Clusters::kClustered};
  Soup colored = sphere(20, 0.1);
  for (size_t i = 0; i < colored.positions.size() / 3; ++i)
    colored.colors.insert(colored.colors.end(), {0.25f, static_cast<float>(i % 7) / 7, 0.5f, 1});
  return {{grid(side, 0.2), kClusters}, {colored, kClusters}, {grid(25, 0), {}}, {sphere(30, 0.1), kClusters}};
}

}  // namespace scree::tests
