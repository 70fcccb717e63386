// Writes the sections of whole words that a cluster's data are made of.
#pragma once

#include <bit>
#include <cstdint>
#include <cstring>

#include "format/geometry/cluster_layout.h"
#include "format/layout.h"

namespace scree::format {

static_assert(std::endian::native == std::endian::little);

/// Most words of a cluster's data: a prediction, steps of two bits, distances of 7 and positions of 24.
inline constexpr uint32_t kMostClusterWords = 2 + 2 * kMaxClusterTriangles / 32 + 14 * kMaxClusterTriangles / 32 +
                                              3 * kMaxPositionBits * kMaxClusterVertices / 32;

/// Appends values of at most 32 bits to words that have room and one word more, the first in the lowest bits.
class WordWriter {
 public:
  explicit WordWriter(uint32_t* words) : at_(words) {}

  void put(uint32_t value, uint32_t bits) {
    pending_ |= uint64_t{value} << fill_;
    std::memcpy(at_, &pending_, sizeof pending_);  // whether it ends a word or not: branches would be guessed wrong
    fill_ += bits;
    at_ += fill_ / 32;
    pending_ >>= fill_ / 32 * 32;
    fill_ %= 32;
  }
  /// The next value begins on a word. Returns where.
  uint32_t* end_section() {
    if (fill_ != 0) ++at_;
    pending_ = 0;
    fill_ = 0;
    return at_;
  }

 private:
  uint32_t* at_;
  uint64_t pending_ = 0;
  uint32_t fill_ = 0;
};

}  // namespace scree::format
