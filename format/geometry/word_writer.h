// Writes the sections of a cluster's data, each of whole words.
#pragma once

#include <bit>
#include <cstdint>
#include <cstring>

#include "format/geometry/cluster_layout.h"
#include "format/layout.h"

namespace scree::format {

static_assert(std::endian::native == std::endian::little);

/// Most words of a cluster's data: a prediction, steps of two bits, distances of 7 bits and positions of 3 x 24 bits.
inline constexpr uint32_t kMostClusterWords = 2 + 2 * kMaxClusterTriangles / 32 + 14 * kMaxClusterTriangles / 32 +
                                              3 * kMaxPositionBits * kMaxClusterVertices / 32;

/// Appends values of at most 32 bits, the first in the lowest bits. The words need room for one word more than is
/// written.
class WordWriter {
 public:
  explicit WordWriter(uint32_t* words) : at_(words) {}

  /// Appends the low `bits` (0 to 32) of `value`, whose other bits must be zero.
  void put(uint32_t value, uint32_t bits) {
    pending_ |= uint64_t{value} << fill_;
    std::memcpy(at_, &pending_, sizeof pending_);  // unconditionally: a branch would often be mispredicted
    fill_ += bits;
    at_ += fill_ / 32;
    pending_ >>= fill_ / 32 * 32;
    fill_ %= 32;
  }
  /// Ends the section, so that the next value begins on a word, and returns that word.
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
