// The bits of a compressed block.
#pragma once

#include <cstdint>
#include <cstring>

#include "format/hd.h"

namespace scree::format {
inline namespace SCREE_ISA {

/// A block of 16 bytes, or of 8 with `high` = 0. Bit 0 is the lowest bit of the first byte.
struct BlockBits {
  uint64_t low;
  uint64_t high;

  /// `count` (0 to 31) bits from bit `at` (0 to 127) on. Bits past the end of the block are 0.
  SCREE_HD uint32_t bits(uint32_t at, uint32_t count) const {
    const uint64_t from = at >= 64 ? high >> (at - 64) : at == 0 ? low : low >> at | high << (64 - at);
    return static_cast<uint32_t>(from) & ((1u << count) - 1);
  }
};

/// Loads eight bytes from an address that is a multiple of 8.
SCREE_HD inline uint64_t load_eight(const uint8_t* at) {
  uint64_t value;
  std::memcpy(&value, __builtin_assume_aligned(at, 8), sizeof(value));
  return value;
}

}  // namespace SCREE_ISA
}  // namespace scree::format
