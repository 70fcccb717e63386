// The number of stored mip levels of an indexed JPEG, the pages of a level, and the bytes of a mask's levels. Source:
// spec/container.md, mip levels and masks.
#pragma once

#include <algorithm>
#include <cstdint>

#include "format/blocks/format.h"
#include "format/layout.h"

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

/// How level `level` of an image whose codec is kBlocks lies in its pages.
inline BlockRows block_rows(const ImageRecord& image, uint32_t level) {
  return block_rows(image.block_format, std::max(1u, image.width >> level), std::max(1u, image.height >> level));
}

/// Number of pages that level `level` of an image takes, beginning with the page of its record. Several pages hold
/// nothing else.
inline uint32_t level_page_count(const ImageRecord& image, uint32_t level) {
  return image.codec == ImageCodec::kBlocks ? block_rows(image, level).pages() : 1;
}

/// The most levels that a mask of this size may have: down to one texel.
inline uint32_t max_mask_levels(uint32_t width, uint32_t height) {
  uint32_t count = 1;
  while (std::max(width, height) >> count != 0) ++count;
  return count;
}

/// Bytes of the levels of a mask. Each side is at most kMaxMaskSide.
inline uint64_t mask_bytes(uint32_t width, uint32_t height, uint32_t level_count) {
  uint64_t bytes = 0;
  for (uint32_t l = 0; l < level_count; ++l) bytes += uint64_t{std::max(1u, width >> l)} * std::max(1u, height >> l);
  return bytes;
}

}  // namespace scree::format
