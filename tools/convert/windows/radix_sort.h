// Sorts many small keys without comparisons.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

namespace scree::convert {

/// Sorts by the upper 32 bits, stable, 11 bits per pass. `other`: a buffer of the same size, kept for the next call.
inline void sort_by_upper_half(std::vector<uint64_t>& pairs, std::vector<uint64_t>& other) {
  other.resize(pairs.size());
  for (const uint32_t shift : {32u, 43u, 54u}) {
    std::array<uint64_t, 2048> first{};
    for (const uint64_t pair : pairs) ++first[(pair >> shift) & 2047];
    uint64_t sum = 0;
    for (uint64_t& count : first) {
      const uint64_t next = sum + count;
      count = sum;
      sum = next;
    }
    for (const uint64_t pair : pairs) other[first[(pair >> shift) & 2047]++] = pair;
    pairs.swap(other);
  }
}

}  // namespace scree::convert
