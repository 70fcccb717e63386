// The visibility buffer: 64 bits a sample, 28 of depth code over 36 of global triangle id; the smaller value wins.
// Source: spec/rasterization.md.
#pragma once

#include <cstdint>

#include "format/hd.h"

namespace scree::kernels {

inline constexpr uint32_t kIdBits = 36;
inline constexpr uint32_t kDepthBits = 28;
inline constexpr uint64_t kIdMask = (uint64_t{1} << kIdBits) - 1;
inline constexpr uint32_t kFarthestDepthCode = (1u << kDepthBits) - 1;
inline constexpr uint64_t kBackground = ~uint64_t{0};  // id kIdMask is never given to a triangle
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
