// Compares a peer's picture with scree's, sample by sample, and explains each difference by exact geometry.
#pragma once

#include <cstdint>
#include <span>

#include "kernels/frame.h"
#include "tools/synth/scenes.h"

namespace scree::lab {

/// Two rasterisers snap corners differently, each by up to a step of 1/256 pixel per axis, and clipping adds corners. A
/// sample within this distance of a triangle's edge, in pixels, may show the triangle in one picture alone.
inline constexpr double kEdgePixels = 1.0 / 128;

/// Counts of the samples that show a triangle in either picture. Their sum is the number of these samples.
struct Coverage {
  uint64_t same = 0;     // the same triangle
  uint64_t edge = 0;     // one of the two triangles has an edge, or the near plane, within kEdgePixels of the sample
  uint64_t depth = 0;    // both triangles cover it, farther from any edge: only their depths compare differently
  uint64_t other = 0;    // neither of the two: one of the pictures is wrong
  double depth_gap = 0;  // the largest relative distance between the triangles of a sample counted in `depth`

  uint64_t covered() const { return same + edge + depth + other; }
};

/// `samples`: scree's visibility buffer of `scene`, a perspective view; `ids`: the peer's triangle ids,
/// kernels::kIdMask on the background. Both row by row, of the view's size.
Coverage compare_coverage(const synth::Scene& scene, const kernels::View& view, std::span<const uint64_t> samples,
                          std::span<const uint64_t> ids);

}  // namespace scree::lab
