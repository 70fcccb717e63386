// JPEG files that cannot be indexed as they are (format/jpeg/index.h) as ones that can.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "format/result.h"
#include "runtime/images/image.h"

namespace scree::runtime {

struct TranscodedJpeg {
  std::vector<std::byte> file;  // sequential, Huffman, 8 bits, one scan
  std::string note;             // why and how, for a user; what libjpeg put up with behind it
};

/// A progressive, arithmetic or several-scan JPEG (format::JpegTreatment::kTranscode; sequential ones are taken too) as
/// a sequential one with optimised Huffman tables: same coefficients, same quantisation tables, no other segments but
/// those that tell the colour. Holds all coefficients, 2 bytes each (3 bytes a pixel for 4:2:0, 6 for 4:4:4). Errors,
/// with the byte where it was noticed: kTruncated (the data end early), kFormat (what libjpeg said; a code that is
/// none; more than 500 scans), kUnsupported (format::judge_jpeg refuses it, it is not of 1 or 3 components, or its MCU
/// would hold more than 10 blocks), kRange (more than kMaxImagePixels), kMemory. Reentrant.
Result<TranscodedJpeg> transcode_jpeg(std::span<const std::byte> file);

/// A picture as a JPEG: YCbCr, 4:4:4, or, `is_grey`, its red alone; alpha is left out. By JpegWriter. `quality`: 1 to
/// 100 in libjpeg's scale. Errors kUnsupported (a side of more than 65500), kMemory. Reentrant.
Result<std::vector<std::byte>> encode_jpeg(const Image& image, int quality, bool is_grey = false);

/// Any JPEG that decode_image takes (format::JpegTreatment::kReencode: CMYK) decoded and coded anew by
/// encode_jpeg. Not lossless, as the note says. Holds the picture, 4 bytes a pixel. Errors as decode_image. Reentrant.
Result<TranscodedJpeg> reencode_jpeg(std::span<const std::byte> file, int quality);

}  // namespace scree::runtime
