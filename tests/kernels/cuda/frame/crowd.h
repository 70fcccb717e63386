// A hundred thousand instances of clustered meshes.
#pragma once

#include <cmath>
#include <cstdint>

#include "tests/kernels/scene_builder.h"

namespace scree::tests {

inline constexpr uint32_t kCrowdSide = 320;  // instances along the ground

/// Leaves, and one ball per 64 instances, in four layers over a square of two units. Each is rotated, and some are
/// mirrored. Most are smaller than a pixel of the tests' pictures, or hidden.
inline void build_crowd(SceneBuilder& builder) {
  const Encoding encoding{.clusters = Clusters::kClustered};
  Encoding open = encoding;
  open.material = builder.material(format::kMaterialDoubleSided);
  const uint32_t leaf = builder.mesh(grid(3, 0.4), open);
  const uint32_t ball = builder.mesh(sphere(14, 0.1), encoding);
  for (uint32_t i = 0; i < kCrowdSide * kCrowdSide; ++i) {
    const double x = 2.0 * (i % kCrowdSide) / kCrowdSide - 1;
    const double y = 2.0 * (i / kCrowdSide) / kCrowdSide - 1;
    const double z = -0.2 * (i % 4);
    const double size = i % 64 == 0 ? 0.012 : 0.006;
    const double c = size * std::cos(0.7 * i), s = size * std::sin(0.7 * i);
    const double flip = i % 5 == 0 ? -1 : 1;
    builder.instance(i % 64 == 0 ? ball : leaf, builder.matrix({c, -s, 0, x, s, c, 0, y, 0, 0, flip * size, z}));
  }
}

}  // namespace scree::tests
