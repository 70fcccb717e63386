// Which mip levels of an indexed JPEG a file stores. Source: spec/container.md, mip levels.
#pragma once

#include <algorithm>
#include <cstdint>

namespace scree::format {

/// The longer side of the smallest stored level, in pixels. A smaller JPEG would be mostly tables and index, and a
/// reader computes the smaller levels quickly.
inline constexpr uint32_t kLeastLevelSide = 64;

inline constexpr uint32_t kMaxJpegSide = 65535;  // pixels; the JPEG header has 16 bits

/// Levels from level 1 on whose longer side, max(width, height) >> level, is at least kLeastLevelSide.
inline uint32_t stored_level_count(uint32_t width, uint32_t height) {
  uint32_t count = 0;
  while (std::max(width, height) >> (count + 1) >= kLeastLevelSide) ++count;
  return count;
}

}  // namespace scree::format
