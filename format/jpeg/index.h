// The indexed JPEG: a sequential Huffman JPEG rearranged so that any MCU decodes independently, and the way back to a
// JPEG file. Lossless: coefficients and tables stay as they are in the file. Source: spec/codecs.md, indexed JPEG.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "format/jpeg/huffman.h"
#include "format/jpeg/mcu.h"
#include "format/jpeg/parse.h"
#include "format/result.h"

namespace scree::format {

inline constexpr uint16_t kJpegIndexVersion = 1;

/// How a picture is divided into MCUs and groups. All of it follows from its size and sampling factors.
struct JpegLayout {
  uint32_t mcus_across = 0;
  uint32_t mcus_down = 0;
  uint32_t mcu_blocks = 0;  // 1 to kJpegMaxMcuBlocks
  uint32_t group_mcus = 0;
  uint32_t group_count = 0;  // at most 2^24
  uint32_t anchor_block_count = 0;

  uint32_t mcu_count() const { return mcus_across * mcus_down; }  // at most 2^26
};

/// `components`: 1 or 3, factors 1 to 4. Errors kUnsupported: more than 10 blocks per MCU.
Result<JpegLayout> jpeg_layout(uint32_t width, uint32_t height, std::span<const JpegComponent> components);

/// Upper bound of the bytes that encode_jpeg_index needs for a file of `file_bytes` bytes. It depends on the file's
/// size only, because a header may be false. Errors: kUnsupported (judge_jpeg() does not return kAsItIs, or more than
/// 10 blocks per MCU), kFormat (a missing table), kTruncated (fewer than 2 bits per block).
Result<uint64_t> jpeg_index_bound(const JpegHeader& header, uint64_t file_bytes);

/// Result of encode_jpeg_index().
struct JpegEncoded {
  uint64_t bytes = 0;          // of the indexed JPEG, a multiple of 16
  uint64_t dropped_bytes = 0;  // left over before a restart marker, or behind the last MCU and before the next marker
};

/// Writes the indexed JPEG of `file` into `out`. `header`: as parse_jpeg read it. `out`: at least jpeg_index_bound()
/// bytes, all of which may be written. A file that only lacks its end marker is accepted. Takes 16 bytes of memory per
/// group. Errors, each with the byte in the file and the MCU: kTruncated (the data end early), kFormat (no such code, a
/// coefficient past the 63rd, an unexpected marker), kUnsupported (a second scan); and the errors of
/// jpeg_index_bound(). Reentrant.
Result<JpegEncoded> encode_jpeg_index(std::span<std::byte> out, const JpegHeader& header,
                                      std::span<const std::byte> file);

/// An opened indexed JPEG. The spans point into the bytes it was opened from.
struct JpegIndex {
  uint16_t width = 0;  // pixels
  uint16_t height = 0;
  JpegColour colour = JpegColour::kGrey;  // kGrey, kYcbcr or kRgb
  uint16_t restart_interval = 0;
  uint32_t component_count = 0;             // 1 or 3
  std::array<JpegComponent, 3> components;  // ids are unset; table numbers index quant, dc and ac below
  JpegLayout layout;
  std::vector<std::array<uint16_t, 64>> quant;  // zigzag order
  std::vector<JpegHuffmanSpec> dc;
  std::vector<JpegHuffmanSpec> ac;
  std::vector<JpegHuffmanTable> tables;  // dc, then ac
  std::span<const std::byte> data;       // without slack, which follows
  std::span<const std::byte> blocks;     // JpegAnchorBlock
  std::span<const std::byte> anchors;    // with slack

  /// Valid as long as this object and the bytes.
  JpegView view() const;
  /// Bytes that the index adds to the picture's data: anchor blocks and anchors.
  uint64_t index_bytes() const { return blocks.size() + anchors.size(); }
};

/// Opens an indexed JPEG and checks all of it except the anchors and the entropy-coded data, in time proportional to
/// the number of anchor blocks. Safe on any bytes; decode_jpeg_mcu_at is then safe on the result. Errors kFormat (no
/// indexed JPEG, an invalid table), kVersion, kReserved, kRange, kUnsupported, kTruncated, kTrailing, kMemory.
Result<JpegIndex> open_jpeg_index(std::span<const std::byte> bytes);

/// Upper bound of the bytes that decode_jpeg_index writes.
uint64_t jpeg_file_bound(const JpegIndex& index);

/// Writes a JPEG file with the same coefficients and tables into `out` (at least jpeg_file_bound() bytes) and returns
/// its size. Decodes every MCU and compares every anchor on the way, so success means that the whole picture is valid.
/// Errors kFormat, with the MCU: no such code, data that end early or go on, an anchor that is not where its group
/// begins. Reentrant.
Result<uint64_t> decode_jpeg_index(std::span<std::byte> out, const JpegIndex& index);

}  // namespace scree::format
