// Radiance pictures (.hdr): red, green and blue with one exponent. Source: G. Ward, Real Pixels, Graphics Gems II,
// 1991, and the Radiance file formats.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>

#include "format/result.h"

namespace scree::runtime {

struct HdrSize {
  uint32_t width = 0;
  uint32_t height = 0;
};

/// Pictures with more pixels, in all or per row, are refused.
inline constexpr uint64_t kMaxHdrPixels = uint64_t{1} << 27;
inline constexpr uint32_t kMaxHdrWidth = 1 << 16;

/// The size of a picture. Errors kFormat (no Radiance picture), kUnsupported (XYZE colour; rows that do not go from the
/// top down, left to right), kTruncated, kRange (no pixel, or too many).
Result<HdrSize> read_hdr_size(std::span<const std::byte> file);

/// Reads all rows, from the top: calls `take(y, row)` with 3 * width floats, linear and finite, 0 or more. Holds one
/// row. Errors as read_hdr_size(); kTruncated, kFormat (runs past a row's end) with the row; bytes after the last row
/// are ignored. Reentrant.
Result<void> read_hdr(std::span<const std::byte> file,
                      const std::function<void(uint32_t y, std::span<const float> row)>& take);

}  // namespace scree::runtime
