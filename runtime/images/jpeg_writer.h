// A JPEG file in memory, written row by row through libjpeg.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "format/jpeg/parse.h"
#include "format/result.h"

namespace scree::runtime {

/// How a picture is coded.
struct JpegCoding {
  uint32_t width = 0;
  uint32_t height = 0;
  format::JpegColour colour = format::JpegColour::kYcbcr;  // kGrey, kYcbcr or kRgb
  std::array<format::JpegComponent, 3> components;         // factors and `quant`; factors divide the largest
  std::vector<std::array<uint16_t, 64>> quant;             // zigzag order; empty: libjpeg's of `quality`
  int quality = 90;                                        // 1 to 100
  bool has_own_tables = true;                              // Huffman tables, where it is not too large for them
};

/// Pictures of at most so many pixels get Huffman tables of their own, for which their coefficients are held, 2 bytes
/// each (25 MB at most); larger ones take those of T.81, K.3, a few per cent more bytes, and hold a row of MCUs.
inline constexpr uint64_t kOptimisedJpegPixels = uint64_t{1} << 22;

/// Errors of all: kMemory, kUnsupported (a size or factors that libjpeg does not write). After an error nothing but
/// the destructor may be called.
class JpegWriter {
 public:
  static Result<JpegWriter> create(const JpegCoding& coding);
  JpegWriter(JpegWriter&&) noexcept;
  JpegWriter& operator=(JpegWriter&&) noexcept;
  ~JpegWriter();

  /// The next row from the top: 3 bytes a pixel (RGB), or 1 with kGrey.
  Result<void> row(std::span<const uint8_t> samples);

  /// After the last row: the file.
  Result<std::vector<std::byte>> finish();

 private:
  struct Impl;
  explicit JpegWriter(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace scree::runtime
