// XXH3 built for AVX2. The library's own build uses SSE2 and is a third as fast on data in the cache.
#pragma once

#include <cstddef>
#include <cstdint>

namespace scree::format::isa_avx2 {

#ifdef SCREE_HAS_AVX2_CODE
/// XXH3-64 of `size` bytes.
uint64_t xxh3_64(const void* bytes, size_t size);
/// `state`: an XXH3_state_t, which is the same for all instruction sets.
void xxh3_64_update(void* state, const void* bytes, size_t size);
#else
inline uint64_t xxh3_64(const void*, size_t) {
  return 0;
}
inline void xxh3_64_update(void*, const void*, size_t) {}
#endif

}  // namespace scree::format::isa_avx2
