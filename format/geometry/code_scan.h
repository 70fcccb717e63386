// The largest codes of bit-packed streams, for processors with AVX2: most of what checking a stream takes.
#pragma once

#include <cstddef>
#include <cstdint>

namespace scree::format::isa_avx2 {

#ifdef SCREE_HAS_AVX2_CODE
inline constexpr bool kScansCodes = true;
/// Looks at the first of `count` codes of `bits` bits each (1 to 32), as many as it can without touching what lies
/// behind the stream's `bytes`. Returns how many those are, a multiple of 8, and raises `largest` to the largest.
uint64_t scan_codes(const std::byte* stream, size_t bytes, uint64_t count, uint32_t bits, uint32_t& largest);
/// The same for records of three codes, `bits[axis]` (0 to 24, not all 0) of each.
uint64_t scan_triples(const std::byte* stream, size_t bytes, uint64_t count, const uint8_t* bits, uint32_t* largest);
#else
inline constexpr bool kScansCodes = false;
inline uint64_t scan_codes(const std::byte*, size_t, uint64_t, uint32_t, uint32_t&) {
  return 0;
}
inline uint64_t scan_triples(const std::byte*, size_t, uint64_t, const uint8_t*, uint32_t*) {
  return 0;
}
#endif

}  // namespace scree::format::isa_avx2
