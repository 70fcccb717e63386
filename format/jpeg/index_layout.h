// The byte layout of an indexed JPEG, shared by its writer and its reader. Source: spec/codecs.md, indexed JPEG.
#pragma once

#include <cstdint>
#include <cstring>

#include "format/bytes.h"
#include "format/jpeg/index.h"

namespace scree::format {

inline constexpr char kJpegIndexMagic[4] = {'S', 'J', 'P', 'G'};
inline constexpr uint64_t kJpegIndexAlignment = 16;
inline constexpr uint32_t kMaxAnchorBits = 32 + 16 * kJpegMaxComponents;  // of a group: its start and its DC predictors

struct JpegIndexHeader {
  char magic[4];
  uint16_t version;
  uint8_t component_count;
  uint8_t colour;
  uint16_t width;
  uint16_t height;
  uint16_t restart_interval;
  uint8_t quant_count;
  uint8_t dc_count;
  uint8_t ac_count;
  uint8_t zero[7];
  struct Component {
    uint8_t h, v, quant, dc, ac, zero[3];
  } components[kJpegMaxComponents];
  uint64_t data_bytes;
  uint32_t anchor_words;
  uint32_t zero_end;
};
static_assert(sizeof(JpegIndexHeader) == 64);

/// Bytes of a section of `size` bytes, without and with the 8 bytes of slack of a packed stream.
constexpr uint64_t jpeg_section_bytes(uint64_t size) {
  return align_up(size, kJpegIndexAlignment);
}
constexpr uint64_t jpeg_stream_bytes(uint64_t size) {
  return align_up(size + kPackedSlackBytes, kJpegIndexAlignment);
}

/// False if the data are too short: a block takes at least a DC and an AC code of one bit each (T.81).
inline bool jpeg_data_may_hold(const JpegLayout& layout, uint64_t data_bytes) {
  return uint64_t{layout.mcu_count()} * layout.mcu_blocks <= 4 * data_bytes;
}

/// Bits of a group's anchor.
inline uint32_t anchor_stride(const JpegAnchorBlock& block) {
  return uint32_t{block.bit_bits} + block.dc_bits[0] + block.dc_bits[1] + block.dc_bits[2];
}

/// 32-bit words of the anchors of a block of `groups` groups.
inline uint32_t anchor_words(const JpegAnchorBlock& block, uint32_t groups) {
  return (groups * anchor_stride(block) + 31) / 32;
}

}  // namespace scree::format
