// Decodes one pixel of a BC7 block; runs in kernels too. Integer arithmetic only, as the format defines it. Source:
// Khronos Data Format Specification, BPTC, also for the tables of subsets and anchors.
#pragma once

#include <cstdint>

#include "format/bits.h"
#include "format/blocks/block_bits.h"
#include "format/hd.h"

namespace scree::format {
inline namespace SCREE_ISA {

struct Bc7Mode {
  uint8_t subsets;
  uint8_t partition_bits;
  uint8_t rotation_bits;
  uint8_t selection_bits;
  uint8_t color_bits;
  uint8_t alpha_bits;
  uint8_t endpoint_bits;  // below the colour's bits, one per end of each subset
  uint8_t shared_bits;    // below the colour's bits, one per subset
  uint8_t index_bits;
  uint8_t second_index_bits;
};

/// The subset that a pixel belongs to.
SCREE_HD inline uint32_t bc7_subset(uint32_t subsets, uint32_t partition, uint32_t pixel) {
  static constexpr uint16_t kTwo[64] = {
      0xcccc, 0x8888, 0xeeee, 0xecc8, 0xc880, 0xfeec, 0xfec8, 0xec80, 0xc800, 0xffec, 0xfe80, 0xe800, 0xffe8,
      0xff00, 0xfff0, 0xf000, 0xf710, 0x008e, 0x7100, 0x08ce, 0x008c, 0x7310, 0x3100, 0x8cce, 0x088c, 0x3110,
      0x6666, 0x366c, 0x17e8, 0x0ff0, 0x718e, 0x399c, 0xaaaa, 0xf0f0, 0x5a5a, 0x33cc, 0x3c3c, 0x55aa, 0x9696,
      0xa55a, 0x73ce, 0x13c8, 0x324c, 0x3bdc, 0x6996, 0xc33c, 0x9966, 0x0660, 0x0272, 0x04e4, 0x4e40, 0x2720,
      0xc936, 0x936c, 0x39c6, 0x639c, 0x9336, 0x9cc6, 0x817e, 0xe718, 0xccf0, 0x0fcc, 0x7744, 0xee22};
  static constexpr uint32_t kThree[64] = {
      0xaa685050, 0x6a5a5040, 0x5a5a4200, 0x5450a0a8, 0xa5a50000, 0xa0a05050, 0x5555a0a0, 0x5a5a5050,
      0xaa550000, 0xaa555500, 0xaaaa5500, 0x90909090, 0x94949494, 0xa4a4a4a4, 0xa9a59450, 0x2a0a4250,
      0xa5945040, 0x0a425054, 0xa5a5a500, 0x55a0a0a0, 0xa8a85454, 0x6a6a4040, 0xa4a45000, 0x1a1a0500,
      0x0050a4a4, 0xaaa59090, 0x14696914, 0x69691400, 0xa08585a0, 0xaa821414, 0x50a4a450, 0x6a5a0200,
      0xa9a58000, 0x5090a0a8, 0xa8a09050, 0x24242424, 0x00aa5500, 0x24924924, 0x24499224, 0x50a50a50,
      0x500aa550, 0xaaaa4444, 0x66660000, 0xa5a0a5a0, 0x50a050a0, 0x69286928, 0x44aaaa44, 0x66666600,
      0xaa444444, 0x54a854a8, 0x95809580, 0x96969600, 0xa85454a8, 0x80959580, 0xaa141414, 0x96960000,
      0xaaaa1414, 0xa05050a0, 0xa0a5a5a0, 0x96000000, 0x40804080, 0xa9a8a9a8, 0xaaaaaa44, 0x2a4a5254};
  if (subsets == 2) return kTwo[partition] >> pixel & 1;
  return subsets == 3 ? kThree[partition] >> 2 * pixel & 3 : 0;
}

/// The anchor pixels: the first pixel of each subset, whose index has one bit less. The anchor of subset 0 is pixel 0.
/// The byte has the anchor of subset 1 in its low half and of subset 2 in its high half; 0 means no such subset.
SCREE_HD inline uint32_t bc7_anchors(uint32_t subsets, uint32_t partition) {
  static constexpr uint8_t kTwo[64] = {15, 15, 15, 15, 15, 15, 15, 15, 15, 15, 15, 15, 15, 15, 15, 15,
                                       15, 2,  8,  2,  2,  8,  8,  15, 2,  8,  2,  2,  8,  8,  2,  2,
                                       15, 15, 6,  8,  2,  8,  15, 15, 2,  8,  2,  2,  2,  15, 15, 6,
                                       6,  2,  6,  8,  15, 15, 2,  2,  15, 15, 15, 15, 15, 2,  2,  15};
  static constexpr uint8_t kThree[64] = {0xf3, 0x83, 0x8f, 0x3f, 0xf8, 0xf3, 0x3f, 0x8f, 0xf8, 0xf8, 0xf6, 0xf6, 0xf6,
                                         0xf5, 0xf3, 0x83, 0xf3, 0x83, 0xf8, 0x3f, 0xf3, 0x83, 0xf6, 0x8a, 0x35, 0xf8,
                                         0x68, 0xa6, 0xf8, 0xf5, 0xaf, 0x8f, 0xf8, 0x3f, 0xf3, 0xa5, 0xa6, 0x8a, 0x98,
                                         0xaf, 0x6f, 0xf3, 0x8f, 0xf5, 0x3f, 0x6f, 0x6f, 0x8f, 0xf3, 0x3f, 0xf5, 0xf5,
                                         0xf5, 0xf8, 0xf5, 0xfa, 0xf5, 0xfa, 0xf8, 0xfd, 0x3f, 0xfc, 0xf3, 0x83};
  if (subsets == 2) return kTwo[partition];
  return subsets == 3 ? kThree[partition] : 0;
}

/// The weight of the second end for an index of 2, 3 or 4 bits, in 64ths: 64 * index / largest, rounded.
SCREE_HD inline uint32_t bc7_weight(uint32_t index, uint32_t bits) {
  if (bits == 2) return 0x402b1500u >> 8 * index & 255;
  if (bits == 3) return static_cast<uint32_t>(0x40372e251b120900u >> 8 * index) & 255;
  const uint32_t near = index < 8 ? index : 15 - index;
  const uint32_t weight = static_cast<uint32_t>(0x1e1a15110d090400u >> 8 * near) & 255;
  return index < 8 ? weight : 64 - weight;
}

/// The first bits of a block.
struct Bc7Head {
  Bc7Mode mode;
  uint32_t partition;
  uint32_t rotation;
  bool is_swapped;
  uint32_t end;  // the bit behind them
};

/// `block` must not be of the reserved mode, whose low byte is 0.
SCREE_HD inline Bc7Head bc7_head(const BlockBits& block) {
  static constexpr Bc7Mode kModes[8] = {{3, 4, 0, 0, 4, 0, 1, 0, 3, 0}, {2, 6, 0, 0, 6, 0, 0, 1, 3, 0},
                                        {3, 6, 0, 0, 5, 0, 0, 0, 2, 0}, {2, 6, 0, 0, 7, 0, 1, 0, 2, 0},
                                        {1, 0, 2, 1, 5, 6, 0, 0, 2, 3}, {1, 0, 2, 0, 7, 8, 0, 0, 2, 2},
                                        {1, 0, 0, 0, 7, 7, 1, 0, 4, 0}, {2, 6, 0, 0, 5, 5, 1, 0, 2, 0}};
  const uint32_t number = lowest_bit(static_cast<uint32_t>(block.low));
  Bc7Head head{};
  head.mode = kModes[number];
  head.end = number + 1;
  const auto take = [&](uint32_t bits) {
    const uint32_t value = block.bits(head.end, bits);
    head.end += bits;
    return value;
  };
  head.partition = take(head.mode.partition_bits);
  head.rotation = take(head.mode.rotation_bits);
  head.is_swapped = take(head.mode.selection_bits) != 0;
  return head;
}

/// Pixel 4 y + x of a block, red in the low byte. A block of a reserved mode is all zeros.
SCREE_HD inline uint32_t bc7_pixel(const BlockBits& block, uint32_t pixel) {
  if ((block.low & 255) == 0) return 0;
  const Bc7Head head = bc7_head(block);
  const Bc7Mode& mode = head.mode;

  const uint32_t ends = 2u * mode.subsets;
  const uint32_t alpha_at = head.end + 3 * ends * mode.color_bits;
  const uint32_t low_bits_at = alpha_at + ends * mode.alpha_bits;
  const uint32_t index_at = low_bits_at + ends * mode.endpoint_bits + mode.subsets * mode.shared_bits;
  const uint32_t anchors = bc7_anchors(mode.subsets, head.partition);
  const auto index = [&](uint32_t first, uint32_t bits, uint32_t others) {
    const uint32_t second = others & 15, third = others >> 4;  // 0: none
    // Index bits that earlier anchors do not have, and whether the pixel is an anchor.
    const uint32_t missing = (pixel > 0) + (second != 0 && pixel > second) + (third != 0 && pixel > third);
    const bool is_anchor = pixel == 0 || pixel == second || pixel == third;
    return block.bits(first + pixel * bits - missing, bits - is_anchor);
  };
  uint32_t color_weight = bc7_weight(index(index_at, mode.index_bits, anchors), mode.index_bits);
  uint32_t alpha_weight = color_weight;
  if (mode.second_index_bits != 0) {  // these modes have one subset
    alpha_weight =
        bc7_weight(index(index_at + 16u * mode.index_bits - 1, mode.second_index_bits, 0), mode.second_index_bits);
    if (head.is_swapped) {
      const uint32_t other = color_weight;
      color_weight = alpha_weight;
      alpha_weight = other;
    }
  }

  const uint32_t subset = bc7_subset(mode.subsets, head.partition, pixel);
  const uint32_t low_bits = block.bits(low_bits_at, 6);
  const uint32_t low_count = mode.endpoint_bits + mode.shared_bits;  // 0 or 1
  // `value`: the bits of an end of the pixel's subset.
  const auto in_eight_bits = [&](uint32_t value, uint32_t bits, uint32_t end) {
    const uint32_t low = low_bits >> (mode.endpoint_bits != 0 ? 2 * subset + end : subset) & low_count;
    const uint32_t all = bits + low_count;
    const uint32_t high = (value << low_count | low) << (8 - all);
    return high | high >> all;
  };
  const auto between = [&](uint32_t first, uint32_t bits, uint32_t weight) {
    const uint32_t pair = block.bits(first + 2 * subset * bits, 2 * bits);
    return ((64 - weight) * in_eight_bits(pair & ((1u << bits) - 1), bits, 0) +
            weight * in_eight_bits(pair >> bits, bits, 1) + 32) >>
           6;
  };
  uint32_t rgba = mode.alpha_bits == 0 ? 0xff000000u : between(alpha_at, mode.alpha_bits, alpha_weight) << 24;
  for (uint32_t channel = 0; channel < 3; ++channel)
    rgba |= between(head.end + channel * ends * mode.color_bits, mode.color_bits, color_weight) << 8 * channel;
  if (head.rotation == 0) return rgba;
  const uint32_t shift = 8 * (head.rotation - 1);  // of the channel that is exchanged with alpha
  const uint32_t moved = rgba >> shift & 255;
  return (rgba & ~(0xff000000u | 255u << shift)) | rgba >> 24 << shift | moved << 24;
}

}  // namespace SCREE_ISA
}  // namespace scree::format
