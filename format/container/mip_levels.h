// Which mip levels of an indexed JPEG a file stores. Source: spec/container.md, mip levels.
#pragma once

#include <algorithm>
#include <cstdint>

namespace scree::format {

/// The longer side of the smallest level that is stored, pixels: a JPEG of fewer would be tables and index more than
/// picture, and a reader makes the rest in no time.
inline constexpr uint32_t kLeastLevelSide = 64;

inline constexpr uint32_t kMaxJpegSide = 65535;  // pixels: its header has 16 bits

/// Levels from 1 on whose longer side, max(width, height) >> level, is kLeastLevelSide or more.
inline uint32_t stored_level_count(uint32_t width, uint32_t height) {
  uint32_t count = 0;
  while (std::max(width, height) >> (count + 1) >= kLeastLevelSide) ++count;
  return count;
}

}  // namespace scree::format
