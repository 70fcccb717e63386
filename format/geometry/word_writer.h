// Writes the sections of a cluster's data, each of whole words.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>

#include "format/geometry/cluster_layout.h"
#include "format/layout.h"

namespace scree::format {

static_assert(std::endian::native == std::endian::little);

/// Bit `bit` of each of eight bytes, side by side, that of the lowest byte first.
constexpr uint64_t gather_bits(uint64_t eight, uint32_t bit) {
  return (eight >> bit & 0x0101010101010101) * 0x0102040810204080 >> 56;
}

/// Most words of a cluster's data: a prediction, steps of two bits, distances of 7 bits and positions of 3 x 24 bits.
inline constexpr uint32_t kMostClusterWords = 2 + 2 * kMaxClusterTriangles / 32 + 14 * kMaxClusterTriangles / 32 +
                                              3 * kMaxPositionBits * kMaxClusterVertices / 32;

/// Words that a WordWriter may write behind its last word with data.
inline constexpr uint32_t kWriterSlack = 2;

/// Most bits of a value. With 7 pending bits they fit 64.
inline constexpr uint32_t kMostPutBits = 56;

/// Appends values of at most kMostPutBits bits, the first in the lowest bits.
class WordWriter {
 public:
  explicit WordWriter(uint32_t* words) : words_(words), at_(reinterpret_cast<std::byte*>(words)) {}

  /// Appends the low `bits` of `value`, whose other bits must be zero.
  void put(uint64_t value, uint32_t bits) {
    pending_ |= value << fill_;
    std::memcpy(at_, &pending_, sizeof pending_);  // unconditionally: a branch would often be mispredicted
    fill_ += bits;
    at_ += fill_ / 8;
    pending_ >>= fill_ / 8 * 8;
    fill_ %= 8;
  }
  /// Ends the section, so that the next value begins on a word, and returns that word.
  uint32_t* end_section() {
    std::memcpy(at_, &pending_, sizeof pending_);
    const ptrdiff_t bytes = at_ - reinterpret_cast<std::byte*>(words_) + (fill_ != 0 ? 1 : 0);
    *this = WordWriter(words_ + (bytes + 3) / 4);
    return words_;
  }

 private:
  uint32_t* words_;  // start of the section
  std::byte* at_;
  uint64_t pending_ = 0;
  uint32_t fill_ = 0;  // pending bits, below 8
};

}  // namespace scree::format
