// An indexed JPEG ready for decoding pixels (format/jpeg/pixels.h), and the decoding of a whole picture row by row.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "format/jpeg/index.h"
#include "format/jpeg/pixels.h"
#include "format/result.h"

namespace scree::format {

/// The table for JpegPicture::factors.
std::vector<uint32_t> jpeg_factors(const JpegIndex& index);

/// Valid as long as `index`, its bytes and `factors` (from jpeg_factors()).
JpegPicture jpeg_picture(const JpegIndex& index, const uint32_t* factors);

/// Decodes the whole picture, holding one row of MCUs at a time. Calls row(y, rgb) for every row from the top, 3 bytes
/// per pixel. Errors kFormat: invalid data, with the MCU.
Result<void> decode_jpeg_rows(const JpegIndex& index,
                              const std::function<void(uint32_t y, std::span<const uint8_t> rgb)>& row);

}  // namespace scree::format
