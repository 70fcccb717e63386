// Functions that the tests of indexed JPEGs share: encoding and rebuilding in buffers that end at a guard page.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "format/jpeg/index.h"
#include "tests/format/geometry/stream_checks.h"
#include "tests/format/jpeg/decode_mcu.h"
#include "tests/format/jpeg/jpeg_maker.h"
#include "tests/tools/temp_folder.h"

// A namespace of its own: these names are short, and other tests have functions of the same names.
namespace scree::tests::jpeg {

using namespace scree::format;

using Bytes = std::vector<std::byte>;

/// Parses the file and encodes it into a buffer of exactly the bound's size that ends at a guard page.
inline Result<Bytes> encode(std::span<const std::byte> file, uint64_t* dropped_bytes = nullptr) {
  const auto header = parse_jpeg(file);
  if (!header) return header.error();
  const auto bound = jpeg_index_bound(*header, file.size());
  if (!bound) return bound.error();
  GuardedBytes out(*bound);
  std::fill(out.bytes().begin(), out.bytes().end(), std::byte{0xaa});  // the encoder must clear unused bytes
  const auto encoded = encode_jpeg_index(out.bytes(), *header, file);
  if (!encoded) return encoded.error();
  REQUIRE(encoded->bytes <= *bound);
  if (dropped_bytes != nullptr) *dropped_bytes = encoded->dropped_bytes;
  const auto used = out.bytes().first(encoded->bytes);
  return Bytes(used.begin(), used.end());
}

inline Result<Bytes> rebuild(const JpegIndex& index) {
  GuardedBytes out(jpeg_file_bound(index));
  const auto size = decode_jpeg_index(out.bytes(), index);
  if (!size) return size.error();
  const auto used = out.bytes().first(*size);
  return Bytes(used.begin(), used.end());
}

using Blocks = std::array<std::array<int16_t, 64>, kJpegMaxMcuBlocks>;  // row-major

inline bool decode_mcu(const JpegView& view, uint32_t mcu, Blocks& blocks) {
  for (auto& block : blocks) block.fill(0);
  return decode_jpeg_mcu(view, mcu, [&](uint32_t block, uint32_t k, int32_t value) {
    blocks.at(block).at(kJpegNaturalOrder.at(k)) = static_cast<int16_t>(value);
  });
}

inline JpegRecipe recipe_of(int width, int height, std::vector<std::pair<int, int>> factors, int restart = 0) {
  return {.width = width, .height = height, .factors = std::move(factors), .restart = restart};
}

/// Offset of the first segment of kind `marker`.
inline size_t find_marker(const Bytes& file, uint32_t marker) {
  for (size_t i = 2; i + 1 < file.size(); ++i)
    if (file[i] == std::byte{0xff} && file[i + 1] == std::byte(marker)) return i;
  FAIL("no marker " << marker);
  return 0;
}

}  // namespace scree::tests::jpeg
