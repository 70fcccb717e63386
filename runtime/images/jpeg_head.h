// Makes the header of a JPEG. The caller makes the entropy-coded bytes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "format/jpeg/parse.h"
#include "format/result.h"

namespace scree::runtime {

struct JpegHead {
  std::vector<std::byte> bytes;  // from SOI up to the first entropy-coded byte
  format::JpegHeader header;     // the same, parsed
};

/// The header of a baseline YCbCr JPEG with libjpeg's quantisation tables of `quality` (1 to 100) and the Huffman
/// tables of T.81, K.3: 0 for luma, 1 for chroma. `is_sharp`: full colour resolution (4:4:4) instead of a quarter
/// (4:2:0). A restart marker follows every `restart_mcus` MCUs. Width and height in pixels, 1 to 65,535. Errors kRange
/// (another size), kMemory.
Result<JpegHead> make_jpeg_head(uint32_t width, uint32_t height, int quality, bool is_sharp, uint16_t restart_mcus);

}  // namespace scree::runtime
