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

/// Encoding options of a picture.
struct JpegCoding {
  uint32_t width = 0;
  uint32_t height = 0;
  format::JpegColour colour = format::JpegColour::kYcbcr;  // kGrey, kYcbcr or kRgb
  std::array<format::JpegComponent, 3> components;         // factors and `quant`; factors divide the largest
  std::vector<std::array<uint16_t, 64>> quant;             // zigzag order; empty: libjpeg's tables of `quality`
  int quality = 90;                                        // 1 to 100
  bool has_own_tables = true;                              // optimised Huffman tables, unless the picture is too large
};

/// Pictures of at most this many pixels get optimised Huffman tables; memory for that: 2 bytes per coefficient, at most
/// 25 MB. Larger pictures use the tables of T.81, K.3, which make the file a few per cent larger, and hold one row of
/// MCUs.
inline constexpr uint64_t kOptimisedJpegPixels = uint64_t{1} << 22;

/// Writes a JPEG row by row. Errors of all methods: kMemory, kUnsupported (a size or factors that libjpeg cannot
/// write). After an error only the destructor may be called.
class JpegWriter {
 public:
  /// Begins a picture.
  static Result<JpegWriter> create(const JpegCoding& coding);
  JpegWriter(JpegWriter&&) noexcept;
  JpegWriter& operator=(JpegWriter&&) noexcept;
  ~JpegWriter();

  /// Writes the next row from the top: 3 bytes per pixel (RGB), or 1 for kGrey.
  Result<void> row(std::span<const uint8_t> samples);

  /// Returns the file, after the last row.
  Result<std::vector<std::byte>> finish();

 private:
  struct Impl;
  explicit JpegWriter(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace scree::runtime
