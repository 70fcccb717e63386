// Reads the marker segments of a JPEG file up to its first scan: size, components and tables.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "format/result.h"

namespace scree::format {

/// Row-major index of the coefficient at index `k` in zigzag order.
inline constexpr std::array<uint8_t, 64> kJpegNaturalOrder = {
    0,  1,  8,  16, 9,  2,  3,  10, 17, 24, 32, 25, 18, 11, 4,  5,  12, 19, 26, 33, 40, 48,
    41, 34, 27, 20, 13, 6,  7,  14, 21, 28, 35, 42, 49, 56, 57, 50, 43, 36, 29, 22, 15, 23,
    30, 37, 44, 51, 58, 59, 52, 45, 38, 31, 39, 46, 53, 60, 61, 54, 47, 55, 62, 63};

enum class JpegColour : uint8_t { kGrey, kYcbcr, kRgb, kOther };  // kOther: not 1 or 3 components

enum class JpegProcess : uint8_t { kBaseline, kExtended, kProgressive, kLossless, kHierarchical };

struct JpegComponent {
  uint8_t id = 0;
  uint8_t h = 1;  // blocks across and down in an MCU, 1 to 4; both 1 where it is the only component
  uint8_t v = 1;
  uint8_t quant = 0;  // numbers of its tables, 0 to 3
  uint8_t dc = 0;
  uint8_t ac = 0;
};

/// A Huffman table as a DHT segment stores it.
struct JpegHuffmanSpec {
  std::array<uint8_t, 16> counts{};    // codes of 1 to 16 bits
  std::array<uint8_t, 256> symbols{};  // in order of their codes
  bool is_defined = false;

  /// 0 to 256 for a table from parse_jpeg.
  uint32_t symbol_count() const {
    uint32_t sum = 0;
    for (const uint8_t count : counts) sum += count;
    return sum;
  }
};

/// The content of a file before its first entropy-coded byte.
struct JpegHeader {
  JpegProcess process = JpegProcess::kBaseline;
  bool is_arithmetic = false;
  uint8_t precision = 8;  // bits per sample
  uint16_t width = 0;     // pixels, at least 1
  uint16_t height = 0;
  JpegColour colour = JpegColour::kOther;
  uint32_t component_count = 0;                     // 1 to 255; components past 4 are only counted
  std::array<JpegComponent, 4> components;          // in the frame's order
  bool scan_is_whole = false;                       // the first scan has every component, in the frame's order
  uint16_t restart_interval = 0;                    // in MCUs; 0: none
  std::array<std::array<uint16_t, 64>, 4> quant{};  // zigzag order
  std::array<bool, 4> quant_is_defined{};
  std::array<JpegHuffmanSpec, 4> dc;
  std::array<JpegHuffmanSpec, 4> ac;
  uint64_t data_offset = 0;  // bytes from the file's start to the first scan's data
};

/// How a texture in such a file has to be treated before it can be indexed.
enum class JpegTreatment {
  kAsItIs,     // encode_jpeg_index accepts it
  kTranscode,  // progressive, arithmetic or several scans: the same coefficients as a sequential Huffman JPEG
  kReencode,   // not 1 or 3 components (CMYK): has to be encoded again as another picture
  kRefuse,     // not 8 bits per sample, lossless or hierarchical
};

/// Reads the segments of `file` up to its first scan. Garbage between segments and fill bytes are skipped, as in
/// libjpeg. Huffman tables that no segment defines (motion JPEG leaves them out) get the values of T.81, K.3. The
/// colour follows from libjpeg's rules: JFIF, the Adobe marker, the component ids. Errors, each with its byte in the
/// file: kFormat (malformed), kTruncated, kRange (a factor or a table number), kUnsupported (height given after the
/// data).
Result<JpegHeader> parse_jpeg(std::span<const std::byte> file);

/// The treatment, and its reason in one line for a note or an error: "progressive", "4 components (CMYK)", "12 bits per
/// sample".
struct JpegVerdict {
  JpegTreatment treatment;
  std::string reason;  // empty with kAsItIs
};

/// Judges by the headers alone. Only encode_jpeg_index() finds a sequential file whose later scans repeat a component.
JpegVerdict judge_jpeg(const JpegHeader& header);

/// Finds the next marker from `at` on, past garbage, fill bytes and stuffed zeros. Returns the offset behind it and
/// sets `marker`, or returns the file's size with `marker` 0.
uint64_t next_jpeg_marker(std::span<const std::byte> file, uint64_t at, uint32_t& marker);

}  // namespace scree::format
