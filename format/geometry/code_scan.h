// Finds the largest codes of bit-packed streams with AVX2, which is most of the work of checking a stream.
#pragma once

#include <cstddef>
#include <cstdint>

namespace scree::format::isa_avx2 {

#ifdef SCREE_HAS_AVX2_CODE
inline constexpr bool kScansCodes = true;
/// Scans the first of `count` codes of `bits` bits each (1 to 32), as many as possible without reading behind the
/// stream's `bytes`. Returns the number scanned, a multiple of 8, and raises `largest` to their maximum.
uint64_t scan_codes(const std::byte* stream, size_t bytes, uint64_t count, uint32_t bits, uint32_t& largest);
/// The same for records of three codes of `bits[axis]` bits (0 to 24, not all 0).
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
