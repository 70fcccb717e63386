// Counts and finds bits, on a CPU and in kernels.
#pragma once

#include <cstdint>

#include "format/hd.h"

namespace scree::format {
inline namespace SCREE_ISA {

/// The number of bits that are set.
SCREE_HD inline uint32_t count_bits(uint32_t value) {
#if defined(__CUDA_ARCH__)
  return static_cast<uint32_t>(__popc(static_cast<int>(value)));
#else
  return static_cast<uint32_t>(__builtin_popcount(value));
#endif
}

/// The index of the lowest bit that is set; `value` is not 0.
SCREE_HD inline uint32_t lowest_bit(uint32_t value) {
#if defined(__CUDA_ARCH__)
  return static_cast<uint32_t>(__ffs(static_cast<int>(value)) - 1);
#else
  return static_cast<uint32_t>(__builtin_ctz(value));
#endif
}

}  // namespace SCREE_ISA
}  // namespace scree::format
