// Turns JPEG files that cannot be indexed (format/jpeg/index.h) into JPEG files that can.
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "format/result.h"
#include "runtime/images/image.h"

namespace scree::convert {

struct TranscodedJpeg {
  std::vector<std::byte> file;  // sequential, Huffman, 8 bits, one scan
  std::string note;             // for users: the reason and the change; then defects that libjpeg tolerated
};

/// Turns a progressive, arithmetic or several-scan JPEG (format::JpegTreatment::kTranscode; sequential ones are
/// accepted too) into a sequential one with optimised Huffman tables. Coefficients and quantisation tables stay the
/// same; all other segments are removed, except those that determine the colour. Holds all coefficients, 2 bytes each
/// (3 bytes per pixel for 4:2:0, 6 for 4:4:4). Errors name the byte: kTruncated (the data end early), kFormat
/// (libjpeg's message; an invalid code; more than 500 scans), kUnsupported (refused by format::judge_jpeg, not 1 or 3
/// components, or more than 10 blocks per MCU), kRange (more than kMaxImagePixels), kMemory. Reentrant.
Result<TranscodedJpeg> transcode_jpeg(std::span<const std::byte> file);

/// Encodes a picture as a JPEG: YCbCr, 4:4:4, or, if `is_grey`, its red channel only; alpha is left out. Uses
/// JpegWriter. `quality`: 1 to 100 on libjpeg's scale. Errors kUnsupported (a side of more than 65500), kMemory.
/// Reentrant.
Result<std::vector<std::byte>> encode_jpeg(const runtime::Image& image, int quality, bool is_grey = false);

/// Decodes any JPEG that decode_image accepts (format::JpegTreatment::kReencode: CMYK) and encodes it again by
/// encode_jpeg. The result is not lossless, and its note says so. Memory: the picture, 4 bytes per pixel. Errors as
/// decode_image. Reentrant.
Result<TranscodedJpeg> reencode_jpeg(std::span<const std::byte> file, int quality);

}  // namespace scree::convert
