// The depth code of a pixel. Source: spec/rasterization.md, depth.
#pragma once

#include "kernels/math.h"
#include "kernels/visbuffer.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

inline constexpr uint32_t kDepthOctaves = 64;  // near * 2^64 is the last distance that has a code of its own
inline constexpr uint32_t kFarthestBits = 0x3f800000u - (kDepthOctaves << 23);  // of the float 2^-64

/// The code of 1/w in [0, 1] (w = 1 on the near plane): 6 bits of exponent and 22 of mantissa, complemented so that the
/// nearest has the smallest code. NaN gives the farthest code.
SCREE_HD inline uint32_t perspective_depth_code(float inverse_w) {
  const uint32_t bits = float_bits(inverse_w > bits_float(kFarthestBits) ? inverse_w : bits_float(kFarthestBits));
  return kFarthestDepthCode - min_of((bits - kFarthestBits) >> 1, kFarthestDepthCode);
}

/// The code of t in [0, 1], 1 on the near plane and 0 on the far one. The farthest code is reserved for the background.
SCREE_HD inline uint32_t orthographic_depth_code(float t) {
  const float scaled = t * static_cast<float>(1u << kDepthBits);
  const uint32_t level = scaled > 1.0f ? (scaled < static_cast<float>(1u << kDepthBits) ? static_cast<uint32_t>(scaled)
                                                                                        : kFarthestDepthCode)
                                       : 1u;
  return kFarthestDepthCode - level;
}

template <bool kOrthographic>
SCREE_HD inline uint32_t depth_code(float depth) {
  if constexpr (kOrthographic) {
    return orthographic_depth_code(depth);
  } else {
    return perspective_depth_code(depth);
  }
}

/// The middle of the values (1/w or t) that have this code.
SCREE_HD inline double depth_value_of_code(uint32_t code, bool orthographic) {
  const uint32_t level = kFarthestDepthCode - min_of(code, kFarthestDepthCode);
  if (orthographic) return (static_cast<double>(level) + 0.5) * (1.0 / static_cast<double>(1u << kDepthBits));
  const uint32_t bits = kFarthestBits + 2 * level;
  return 0.5 * (static_cast<double>(bits_float(bits)) + static_cast<double>(bits_float(bits + 1)));
}

}  // namespace SCREE_ISA
}  // namespace scree::kernels
