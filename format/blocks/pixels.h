// Decodes one pixel of a block image at a time; runs in kernels too. Integer arithmetic only: the real values of the
// formats' definitions times 255, rounded to nearest, halves up. Source: spec/codecs.md, block image; Khronos Data
// Format Specification, S3TC, RGTC and BPTC.
#pragma once

#include <cstdint>

#include "format/blocks/bc7.h"
#include "format/blocks/block_bits.h"
#include "format/blocks/format.h"
#include "format/hd.h"

namespace scree::format {
inline namespace SCREE_ISA {

/// value / divisor rounded to nearest, halves up.
SCREE_HD inline uint32_t rounded_ratio(uint32_t value, uint32_t divisor) {
  return (2 * value + divisor) / (2 * divisor);
}

/// A pixel of the 8 bytes of a BC1 block, or of the colours of BC2 and BC3, whose fourth code is never transparent.
SCREE_HD inline uint32_t bc1_pixel(uint64_t block, uint32_t pixel, bool may_be_transparent) {
  const uint32_t first = block & 0xffff, second = block >> 16 & 0xffff;
  const uint32_t code = static_cast<uint32_t>(block >> (32 + 2 * pixel)) & 3;
  const bool has_thirds = first > second || !may_be_transparent;
  if (code == 3 && !has_thirds) return 0;
  // The colour is (weight * first + (6 - weight) * second) / 6.
  const uint32_t weight = code < 2 ? 6 - 6 * code : !has_thirds ? 3 : code == 2 ? 4 : 2;
  const auto channel = [&](uint32_t shift, uint32_t largest) {
    const uint32_t sum = weight * (first >> shift & largest) + (6 - weight) * (second >> shift & largest);
    return rounded_ratio(255 * sum, 6 * largest);
  };
  return channel(11, 31) | channel(5, 63) << 8 | channel(0, 31) << 16 | 0xff000000u;
}

/// A pixel of the 8 bytes of a BC4 block, of one half of a BC5 block, or of the alpha of BC3.
SCREE_HD inline uint32_t bc4_pixel(uint64_t block, uint32_t pixel) {
  const uint32_t first = block & 255, second = block >> 8 & 255;
  const uint32_t code = static_cast<uint32_t>(block >> (16 + 3 * pixel)) & 7;
  if (code == 0) return first;
  if (code == 1) return second;
  if (first > second) return rounded_ratio((8 - code) * first + (code - 1) * second, 7);
  if (code >= 6) return code == 6 ? 0 : 255;
  return rounded_ratio((6 - code) * first + (code - 1) * second, 5);
}

/// Pixel 4 y + x of a block before the swizzle: RGBA, red in the low byte. Channels that the format lacks are 0, alpha
/// 255. `block`: a multiple of block_bytes() from an address that is a multiple of 16.
SCREE_HD inline uint32_t block_pixel(BlockFormat format, const uint8_t* block, uint32_t pixel) {
  switch (format) {
    case BlockFormat::kBc1:
      return bc1_pixel(load_eight(block), pixel, true);
    case BlockFormat::kBc2: {
      const uint32_t alpha = static_cast<uint32_t>(load_eight(block) >> 4 * pixel) & 15;
      return (bc1_pixel(load_eight(block + 8), pixel, false) & 0xffffff) | alpha * 17 << 24;
    }
    case BlockFormat::kBc3:
      return (bc1_pixel(load_eight(block + 8), pixel, false) & 0xffffff) | bc4_pixel(load_eight(block), pixel) << 24;
    case BlockFormat::kBc4:
      return bc4_pixel(load_eight(block), pixel) | 0xff000000u;
    case BlockFormat::kBc5:
      return bc4_pixel(load_eight(block), pixel) | bc4_pixel(load_eight(block + 8), pixel) << 8 | 0xff000000u;
    case BlockFormat::kBc7:
      return bc7_pixel({load_eight(block), load_eight(block + 8)}, pixel);
    case BlockFormat::kR8:
      return block[0] | 0xff000000u;
    case BlockFormat::kRg8:
      return block[0] | uint32_t{block[1]} << 8 | 0xff000000u;
    case BlockFormat::kRgba8:
      return block[0] | uint32_t{block[1]} << 8 | uint32_t{block[2]} << 16 | uint32_t{block[3]} << 24;
    case BlockFormat::kNoBlocks:
      break;
  }
  return 0;
}

/// `rgba`, red in the low byte, with its channels replaced by the swizzle.
SCREE_HD inline uint32_t swizzled(uint32_t rgba, uint16_t swizzle) {
  if (swizzle == kPlainSwizzle) return rgba;
  uint32_t out = 0;
  for (uint32_t channel = 0; channel < 4; ++channel) {
    const ChannelSource source = swizzle_source(swizzle, channel);
    const uint32_t value = source <= ChannelSource::kAlpha ? rgba >> 8 * static_cast<uint32_t>(source) & 255
                           : source == ChannelSource::kOne ? 255
                                                           : 0;
    out |= value << 8 * channel;
  }
  return out;
}

/// Pixel (x, y) of a level that is `width` pixels wide. `blocks`: the level's blocks, at a multiple of 16.
SCREE_HD inline uint32_t block_image_pixel(BlockFormat format, uint16_t swizzle, const uint8_t* blocks, uint32_t width,
                                           uint32_t x, uint32_t y) {
  const uint32_t shift = block_side_log(format);
  const uint32_t inside = (1u << shift) - 1;
  const uint64_t number = uint64_t{y >> shift} * ((width + inside) >> shift) + (x >> shift);
  return swizzled(block_pixel(format, blocks + number * block_bytes(format), (y & inside) * 4 + (x & inside)), swizzle);
}

}  // namespace SCREE_ISA
}  // namespace scree::format
