// Sizes of block images and the order of their channels. Source: spec/codecs.md, block image.
#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>

#include "format/hd.h"
#include "format/layout.h"

namespace scree::format {
inline namespace SCREE_ISA {

inline constexpr uint32_t kMaxBlockImageSide = 65536;  // pixels

/// Whether the value is one that files may have for a block image; kNoBlocks is not.
SCREE_HD constexpr bool is_block_format(BlockFormat format) {
  const auto number = static_cast<uint32_t>(format);
  return number >= 1 && number <= 10 && number != 6;
}

/// Base-2 logarithm of block_side().
SCREE_HD constexpr uint32_t block_side_log(BlockFormat format) {
  return format < BlockFormat::kR8 ? 2 : 0;
}

/// Side of a block in pixels: 4 for the compressed formats, 1 for the others.
SCREE_HD constexpr uint32_t block_side(BlockFormat format) {
  return 1u << block_side_log(format);
}

/// Bytes of a block; of a pixel for the uncompressed formats.
SCREE_HD constexpr uint32_t block_bytes(BlockFormat format) {
  switch (format) {
    case BlockFormat::kR8:
      return 1;
    case BlockFormat::kRg8:
      return 2;
    case BlockFormat::kRgba8:
      return 4;
    case BlockFormat::kBc1:
    case BlockFormat::kBc4:
      return 8;
    default:
      return 16;
  }
}

/// Channels that a block stores, before the swizzle.
constexpr uint32_t block_channels(BlockFormat format) {
  if (format == BlockFormat::kBc4 || format == BlockFormat::kR8) return 1;
  return format == BlockFormat::kBc5 || format == BlockFormat::kRg8 ? 2 : 4;
}

constexpr const char* block_format_name(BlockFormat format) {
  constexpr const char* kNames[] = {"none", "BC1", "BC2", "BC3", "BC4", "BC5", "BC6", "BC7", "R8", "RG8", "RGBA8"};
  return kNames[static_cast<uint32_t>(format)];
}

/// Bytes of a level's blocks: rows of blocks, from the top. Sides up to kMaxBlockImageSide.
constexpr uint64_t block_level_bytes(BlockFormat format, uint32_t width, uint32_t height) {
  const uint32_t side = block_side(format);
  return uint64_t{(width + side - 1) / side} * ((height + side - 1) / side) * block_bytes(format);
}

/// Most raw bytes of a page, if a level takes several pages. Such a page is small enough to be read for a few pixels,
/// and large enough that alignment and records take less than 2%.
inline constexpr uint64_t kBlockPageBytes = uint64_t{1} << 18;

/// How a level's rows of blocks lie in pages: as many whole rows per page as kBlockPageBytes hold.
struct BlockRows {
  uint64_t row_bytes;  // at most kBlockPageBytes
  uint32_t rows;
  uint32_t rows_per_page;

  SCREE_HD constexpr uint32_t pages() const { return (rows + rows_per_page - 1) / rows_per_page; }
  /// `page`: below pages().
  constexpr uint64_t page_bytes(uint32_t page) const {
    return row_bytes * std::min(rows_per_page, rows - page * rows_per_page);
  }
  constexpr uint64_t bytes() const { return row_bytes * rows; }
};

/// Sides up to kMaxBlockImageSide.
SCREE_HD constexpr BlockRows block_rows(BlockFormat format, uint32_t width, uint32_t height) {
  const uint32_t side = block_side(format);
  const uint64_t row_bytes = uint64_t{(width + side - 1) / side} * block_bytes(format);
  return {row_bytes, (height + side - 1) / side,
          static_cast<uint32_t>(kBlockPageBytes) / static_cast<uint32_t>(row_bytes)};
}

/// Levels of a picture of this size from level 1 down to 1 x 1. A block image has at most this many.
constexpr uint32_t most_block_levels(uint32_t width, uint32_t height) {
  return static_cast<uint32_t>(std::bit_width(std::max(width, height))) - 1;
}

/// The source of a channel of the picture.
enum class ChannelSource : uint32_t { kRed, kGreen, kBlue, kAlpha, kZero, kOne };

/// ImageRecord::swizzle: three bits per channel, red lowest.
constexpr uint16_t make_swizzle(ChannelSource red, ChannelSource green, ChannelSource blue, ChannelSource alpha) {
  return static_cast<uint16_t>(static_cast<uint32_t>(red) | static_cast<uint32_t>(green) << 3 |
                               static_cast<uint32_t>(blue) << 6 | static_cast<uint32_t>(alpha) << 9);
}

/// The source of channel `channel` (0 red to 3 alpha) of the picture.
SCREE_HD constexpr ChannelSource swizzle_source(uint16_t swizzle, uint32_t channel) {
  return static_cast<ChannelSource>(swizzle >> 3 * channel & 7);
}

inline constexpr uint16_t kPlainSwizzle =
    make_swizzle(ChannelSource::kRed, ChannelSource::kGreen, ChannelSource::kBlue, ChannelSource::kAlpha);
inline constexpr uint16_t kOpaqueSwizzle =
    make_swizzle(ChannelSource::kRed, ChannelSource::kGreen, ChannelSource::kBlue, ChannelSource::kOne);

/// Whether the bits are a valid ImageRecord::swizzle.
constexpr bool is_swizzle(uint16_t swizzle) {
  for (uint32_t channel = 0; channel < 4; ++channel)
    if (swizzle_source(swizzle, channel) > ChannelSource::kOne) return false;
  return swizzle >> 12 == 0;
}

/// The swizzle that equals `first` followed by `second`.
constexpr uint16_t swizzle_of_swizzle(uint16_t first, uint16_t second) {
  uint32_t both = 0;
  for (uint32_t channel = 0; channel < 4; ++channel) {
    ChannelSource source = swizzle_source(second, channel);
    if (source <= ChannelSource::kAlpha) source = swizzle_source(first, static_cast<uint32_t>(source));
    both |= static_cast<uint32_t>(source) << 3 * channel;
  }
  return static_cast<uint16_t>(both);
}

}  // namespace SCREE_ISA
}  // namespace scree::format
