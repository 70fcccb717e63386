// Boxes of lattice offsets, and the bounds of clusters and groups that are made of them. Runs in kernels too.
#pragma once

#include <cstdint>

#include "format/geometry/cluster_layout.h"
#include "format/hd.h"

namespace scree::format {

/// A box of lattice offsets.
struct OffsetBox {
  uint32_t min[3];
  uint32_t max[3];
};

/// The number of bits that a value takes: 0 for 0.
SCREE_HD inline uint32_t bits_of(uint32_t value) {
#if defined(__CUDA_ARCH__)
  return static_cast<uint32_t>(32 - __clz(static_cast<int>(value)));
#else
  return value == 0 ? 0 : static_cast<uint32_t>(32 - __builtin_clz(value));
#endif
}

/// The finest bounds that hold `box`, relative to `origin`. The box must lie within 2^24 of `origin`.
SCREE_HD inline ClusterBounds bounds_of(const OffsetBox& box, const uint32_t origin[3]) {
  uint32_t widest = 0;
  for (int i = 0; i < 3; ++i) widest = box.max[i] - box.min[i] > widest ? box.max[i] - box.min[i] : widest;
  ClusterBounds bounds{};
  bounds.shift = widest < 256 ? 0u : bits_of(widest) - 8;
  for (int i = 0; i < 3; ++i)
    bounds.axis[i] = (box.min[i] - origin[i]) | ((box.max[i] - box.min[i]) >> bounds.shift) << 24;
  return bounds;
}

}  // namespace scree::format
