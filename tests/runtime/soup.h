// Triangles without order, so that chunks lie all over the picture.
#pragma once

#include <cstdint>
#include <random>

#include "tests/kernels/scene_builder.h"

namespace scree::tests {

inline Soup triangles_around(uint32_t count, std::mt19937& random) {
  std::uniform_real_distribution<double> unit(-1, 1);
  Soup soup;
  for (uint32_t i = 0; i < count; ++i) {
    const double place[3] = {unit(random), unit(random), 3 * unit(random)};
    uint32_t corner[3];
    for (uint32_t& c : corner)
      c = soup.add(place[0] + 0.2 * unit(random), place[1] + 0.2 * unit(random), place[2] + 0.2 * unit(random));
    soup.triangle(corner[0], corner[1], corner[2]);
  }
  return soup;
}

}  // namespace scree::tests
