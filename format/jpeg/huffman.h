// JPEG Huffman tables for decoding. Codes of up to 9 bits take one look-up, longer codes six comparisons without
// branches. A table takes 1.3 KiB, so that the four tables of a picture fit the shared memory of a thread block.
#pragma once

#include <cstdint>

#include "format/hd.h"
#include "format/jpeg/parse.h"
#include "format/result.h"

namespace scree::format {

inline constexpr uint32_t kJpegFastBits = 9;

/// A decoded code: its length in bits and its symbol. Length 0: no such code.
struct JpegCode {
  uint32_t length;
  uint32_t symbol;
};

/// The decoding table of one Huffman code.
struct JpegHuffmanTable {
  uint16_t fast[1u << kJpegFastBits];  // by the next 9 bits: length << 8 | symbol; 0 where the code is longer
  // Codes of length 10 + i, left-aligned in 16 bits, are below limit[i]. The limits never decrease.
  uint32_t limit[7];
  // symbols[first + code] is the symbol of a code of length 10 + i, modulo 2^32.
  uint32_t first[7];
  uint8_t symbols[256];

  /// Decodes the code at the start of `window`, whose low 16 bits are the next 16 bits of the stream. Safe for any
  /// window.
  SCREE_HD JpegCode find(uint32_t window) const {
    const uint32_t entry = fast[window >> (16 - kJpegFastBits)];
    if (entry != 0) return {entry >> 8, entry & 255u};
    uint32_t longer = 0;
    for (uint32_t i = 0; i < 6; ++i) longer += window >= limit[i] ? 1u : 0u;
    if (window >= limit[6]) return {0, 0};
    const uint32_t length = kJpegFastBits + 1 + longer;
    return {length, symbols[(first[longer] + (window >> (16 - length))) & 255u]};
  }
};

/// The table of `spec`, whose counts add up to at most 256. Codes are assigned as in T.81, C.2. Errors kFormat: more
/// codes than fit their lengths, a code of ones only, or, if `is_dc`, a symbol above 15.
Result<JpegHuffmanTable> make_jpeg_table(const JpegHuffmanSpec& spec, bool is_dc);

/// The tables of T.81, K.3: DC and AC; number 0 for luminance, 1 for chrominance.
const JpegHuffmanSpec& standard_jpeg_table(bool is_ac, uint32_t number);

}  // namespace scree::format
