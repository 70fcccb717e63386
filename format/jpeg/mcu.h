// Decodes one MCU of an indexed JPEG from its group's anchor; runs in kernels too. Allocates nothing, and is safe on
// any bytes: it reads nothing outside the view's tables and streams. Source: spec/codecs.md, indexed JPEG.
#pragma once

#include <cstdint>
#include <cstring>

#include "format/bitpack.h"
#include "format/hd.h"
#include "format/jpeg/huffman.h"

namespace scree::format {

inline constexpr uint32_t kJpegMaxComponents = 3;
inline constexpr uint32_t kJpegMaxMcuBlocks = 10;  // T.81, B.2.3
inline constexpr uint32_t kJpegBlockGroups = 32;   // groups per anchor block, one per lane of a warp
inline constexpr uint32_t kJpegGroupPixels = 256;  // a group covers at least this many pixels

/// The shared values of the groups of an anchor block, as they lie in the file.
struct JpegAnchorBlock {
  uint64_t bit;                         // start of the first group's data
  uint32_t word;                        // start of the block's anchors, in 32-bit words
  int16_t dc_min[kJpegMaxComponents];   // smallest DC predictors of the block's groups
  uint8_t bit_bits;                     // width of a group's distance from `bit`, 0 to 32
  uint8_t dc_bits[kJpegMaxComponents];  // widths of the predictors' distances from dc_min, 0 to 16
  uint8_t zero[2];
};
static_assert(sizeof(JpegAnchorBlock) == 24);

struct JpegViewComponent {
  uint8_t h;  // blocks across and down in an MCU
  uint8_t v;
  uint8_t quant;  // index of the quantisation table in the picture
  uint8_t dc;     // index in JpegView::tables
  uint8_t ac;
};

/// An indexed JPEG ready for decoding; owns nothing. Made by JpegIndex::view, on whose checks the functions below rely.
/// On a GPU the pointers refer to copies in device memory.
struct JpegView {
  const void* data;                // unstuffed, with slack; in a kernel 4-byte aligned
  uint64_t data_bits;              // without slack
  const void* blocks;              // JpegAnchorBlock, one per 32 groups; in a kernel 8-byte aligned
  const void* anchors;             // packed, with slack; in a kernel 4-byte aligned
  const JpegHuffmanTable* tables;  // DC, then AC
  uint32_t mcu_count;
  uint32_t mcus_across;
  uint32_t group_mcus;        // MCUs per group, at least 1; the last group may have fewer
  uint32_t restart_interval;  // in MCUs; 0: none
  uint32_t component_count;   // 1 or 3
  JpegViewComponent components[kJpegMaxComponents];
};

/// State of decoding before MCU `mcu`.
struct JpegCursor {
  uint64_t bit;
  uint32_t mcu;
  int32_t dc[kJpegMaxComponents];  // predictors, within int16
};

/// The 32 bits from `bit` on, the first in the highest bit. Reads at most 8 bytes from the byte that holds `bit`.
SCREE_HD inline uint32_t peek_jpeg_bits(const void* data, uint64_t bit) {
#if defined(__CUDA_ARCH__)
  const uint32_t* word = static_cast<const uint32_t*>(data) + (bit >> 5);
  const uint32_t high = __byte_perm(word[0], 0, 0x0123);
  const uint32_t low = __byte_perm(word[1], 0, 0x0123);
  return __funnelshift_l(low, high, static_cast<uint32_t>(bit) & 31u);
#else
  uint64_t window;
  std::memcpy(&window, static_cast<const unsigned char*>(data) + (bit >> 3), sizeof window);
  return static_cast<uint32_t>(__builtin_bswap64(window) << (bit & 7u) >> 32);
#endif
}

/// The signed number in the highest `size` bits (0 to 15) of `window` (T.81, F.2.2.1).
SCREE_HD inline int32_t extend_jpeg_bits(uint32_t window, uint32_t size) {
  if (size == 0) return 0;
  const int32_t value = static_cast<int32_t>(window >> (32 - size));
  return value < 1 << (size - 1) ? value - (1 << size) + 1 : value;
}

/// The cursor before the first MCU of `group`, which is below ceil(mcu_count / group_mcus).
SCREE_HD inline JpegCursor jpeg_anchor(const JpegView& view, uint32_t group) {
#if defined(__CUDA_ARCH__)
  const JpegAnchorBlock block = static_cast<const JpegAnchorBlock*>(view.blocks)[group / kJpegBlockGroups];
#else
  JpegAnchorBlock block;
  std::memcpy(&block,
              static_cast<const unsigned char*>(view.blocks) + sizeof block * uint64_t{group / kJpegBlockGroups},
              sizeof block);
#endif
  const uint32_t stride = block.bit_bits + block.dc_bits[0] + block.dc_bits[1] + block.dc_bits[2];
  uint64_t at = uint64_t{block.word} * 32 + uint64_t{group % kJpegBlockGroups} * stride;
  JpegCursor cursor;
  cursor.mcu = group * view.group_mcus;
  cursor.bit = block.bit + unpack(view.anchors, at, block.bit_bits);
  at += block.bit_bits;
  for (uint32_t c = 0; c < kJpegMaxComponents; ++c) {
    cursor.dc[c] =
        static_cast<int16_t>(block.dc_min[c] + static_cast<int32_t>(unpack(view.anchors, at, block.dc_bits[c])));
    at += block.dc_bits[c];
  }
  return cursor;
}

/// At the start of a restart interval, aligns to a byte and resets the predictors to 0.
SCREE_HD inline void begin_jpeg_mcu(const JpegView& view, JpegCursor& cursor) {
  if (view.restart_interval == 0 || cursor.mcu % view.restart_interval != 0) return;
  cursor.bit = (cursor.bit + 7) & ~uint64_t{7};
  for (uint32_t c = 0; c < kJpegMaxComponents; ++c) cursor.dc[c] = 0;
}

/// Decodes a block of component `c`. Calls sink(k, value) for the DC coefficient (k = 0, even if it is 0) and every
/// stored AC coefficient; k rises to at most 63 in zigzag order, values are quantised and within int16. Returns false
/// for invalid or truncated data, after which the cursor is unspecified.
template <class Sink>
SCREE_HD bool decode_jpeg_block(const JpegView& view, JpegCursor& cursor, uint32_t c, Sink&& sink) {
  if (cursor.bit > view.data_bits) return false;
  uint32_t window = peek_jpeg_bits(view.data, cursor.bit);
  JpegCode code = view.tables[view.components[c].dc].find(window >> 16);
  if (code.length == 0) return false;
  uint32_t size = code.symbol & 15u;
  // Damaged differences wrap, as libjpeg's 16-bit coefficients do.
  cursor.dc[c] = static_cast<int16_t>(cursor.dc[c] + extend_jpeg_bits(window << code.length, size));
  cursor.bit += code.length + size;
  sink(0u, cursor.dc[c]);
  const JpegHuffmanTable& table = view.tables[view.components[c].ac];
  for (uint32_t k = 1; k < 64; ++k) {
    if (cursor.bit > view.data_bits) return false;
    window = peek_jpeg_bits(view.data, cursor.bit);
    code = table.find(window >> 16);
    if (code.length == 0) return false;
    const uint32_t run = code.symbol >> 4;
    size = code.symbol & 15u;
    cursor.bit += code.length + size;
    if (size == 0 && run != 15) break;
    k += run;
    if (size == 0) continue;
    if (k > 63) return false;
    sink(k, extend_jpeg_bits(window << code.length, size));
  }
  return cursor.bit <= view.data_bits;
}

/// Decodes the MCU at the cursor and advances it. Calls sink(block, k, value); blocks 0 to 9 count in stream order:
/// component by component, rows of v times h blocks. Returns false for invalid or truncated data, and if no MCU is
/// left.
template <class Sink>
SCREE_HD bool decode_jpeg_mcu_at(const JpegView& view, JpegCursor& cursor, Sink&& sink) {
  if (cursor.mcu >= view.mcu_count) return false;
  begin_jpeg_mcu(view, cursor);
  uint32_t block = 0;
  for (uint32_t c = 0; c < view.component_count; ++c) {
    const uint32_t count = uint32_t{view.components[c].h} * view.components[c].v;
    for (uint32_t i = 0; i < count; ++i, ++block) {
      if (!decode_jpeg_block(view, cursor, c, [&](uint32_t k, int32_t value) { sink(block, k, value); })) return false;
    }
  }
  ++cursor.mcu;
  return true;
}

}  // namespace scree::format
