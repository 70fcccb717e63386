// The visibility buffer: 64 bits per sample, 28 of depth code above 36 of global triangle id. The smaller value wins.
// Source: spec/rasterization.md.
#pragma once

#include <cstdint>

#include "format/hd.h"

namespace scree::kernels {

inline constexpr uint32_t kIdBits = 36;
inline constexpr uint32_t kDepthBits = 28;
inline constexpr uint64_t kIdMask = (uint64_t{1} << kIdBits) - 1;
inline constexpr uint32_t kFarthestDepthCode = (1u << kDepthBits) - 1;
inline constexpr uint64_t kBackground = ~uint64_t{0};  // no triangle gets the id kIdMask
inline constexpr uint32_t kMaxImageSide = 16384;       // samples, after supersampling

SCREE_HD constexpr uint64_t pack_sample(uint32_t depth_code, uint64_t triangle_id) {
  return (uint64_t{depth_code} << kIdBits) | triangle_id;
}
SCREE_HD constexpr uint64_t sample_id(uint64_t sample) {
  return sample & kIdMask;
}
SCREE_HD constexpr uint32_t sample_depth_code(uint64_t sample) {
  return static_cast<uint32_t>(sample >> kIdBits);
}

}  // namespace scree::kernels
