// An indexed JPEG ready for its pixels (format/jpeg/pixels.h), and all of them row by row.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "format/jpeg/index.h"
#include "format/jpeg/pixels.h"
#include "format/result.h"

namespace scree::format {

/// What JpegPicture::factors points to.
std::vector<uint32_t> jpeg_factors(const JpegIndex& index);

/// Valid while `index`, its bytes and `factors` (of jpeg_factors) are.
JpegPicture jpeg_picture(const JpegIndex& index, const uint32_t* factors);

/// Decodes the whole picture MCU row by MCU row, holding no more than that: row(y, rgb) for every row from the top, 3
/// bytes a pixel. Errors kFormat: data that are none, with the MCU.
Result<void> decode_jpeg_rows(const JpegIndex& index,
                              const std::function<void(uint32_t y, std::span<const uint8_t> rgb)>& row);

}  // namespace scree::format
