// Decodes BasisLZ, the supercompression of ETC1S blocks in KTX2 files of KHR_texture_basisu. All levels of a file share
// two codebooks: sets of four colours, and the choices of a block's 16 texels between four colours. Source: KTX File
// Format Specification 2.0, appendices "BasisLZ Global Data" and "BasisLZ/ETC1S Bitstream Specification"; Khronos Data
// Format Specification 1.4, section "ETC1S".
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "format/result.h"

namespace scree::runtime {

/// A canonical Huffman code as Deflate has it (RFC 1951, 3.2.2), with codes of up to 16 bits.
struct HuffmanCode {
  std::array<uint16_t, 17> counts{};  // codes of each length
  std::vector<uint16_t> symbols;      // by length, then by value
};

/// The parts of a file's global data, as they lie one behind another.
struct BasisLzHead {
  uint32_t colors = 0;  // entries of the two codebooks, at most 65535
  uint32_t selectors = 0;
  uint32_t color_bytes = 0;
  uint32_t selector_bytes = 0;
  uint32_t table_bytes = 0;

  uint64_t part_bytes() const { return uint64_t{color_bytes} + selector_bytes + table_bytes; }
  /// The parts and the codebooks that they become. A Huffman table has at most 16,383 symbols.
  uint64_t memory() const { return part_bytes() + 16 * colors + 4 * selectors + (colors != 0 ? 5 << 15 : 0); }
};

class BasisLz {
 public:
  /// `bytes`: the three parts. Errors kFormat (malformed; the message names the part).
  static Result<BasisLz> open(const BasisLzHead& head, std::span<const std::byte> bytes);

  /// Decodes a slice into a picture of RGBA pixels. A slice of colours sets alpha to 255. A slice of alpha sets only
  /// alpha, to its own green. `pixels`: 4 * width * height; time is proportional to them. Errors kFormat, after which
  /// `pixels` is unspecified. Reentrant.
  Result<void> decode(std::span<const std::byte> slice, bool is_alpha, uint32_t width, uint32_t height,
                      std::span<std::byte> pixels) const;

 private:
  std::vector<std::array<uint32_t, 4>> colors_;  // the four colours of an entry
  std::vector<uint32_t> selectors_;              // two bits per texel, texel 0 lowest
  HuffmanCode predictions_;
  HuffmanCode color_deltas_;
  HuffmanCode selector_code_;
  HuffmanCode run_lengths_;
  uint32_t history_size_ = 0;
};

}  // namespace scree::runtime
