// The order from near to far in which a GPU draws clustered chunks.
#pragma once

#include "kernels/cull/coverage_filter.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

inline constexpr uint32_t kNearBuckets = 512;

/// The bucket, from near to far, of a chunk whose nearest point is at `near` (nearness()): 32 buckets per octave of w,
/// counted down from the farthest point of the scene, `farthest`. The buckets span 16 octaves; the first one also takes
/// all nearer points. The near plane may lie many octaves nearer, but few chunks lie between. An orthographic camera's
/// nearness is linear: 1 on the near plane and 0 on the far one. NaN may be in any bucket.
SCREE_HD inline uint32_t near_bucket(float near, bool orthographic, float farthest) {
  if (orthographic) return static_cast<uint32_t>(fast_max(fast_min(near * kNearBuckets, kNearBuckets - 1.0f), 0.0f));
  const float nearest = fast_min(fast_max(near, 1.0f), farthest);
  return kNearBuckets - 1 - min_of((float_bits(farthest) - float_bits(nearest)) >> 18, kNearBuckets - 1);
}

}  // namespace SCREE_ISA
}  // namespace scree::kernels
