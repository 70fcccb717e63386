// Compiled with -mavx2 (CMakeLists.txt). All of xxhash is static here, and no other header is included whose inline
// functions the linker might share with code for other processors.
#include "format/container/checksum_avx2.h"

#define XXH_INLINE_ALL
#include <xxhash.h>

static_assert(XXH_VECTOR == XXH_AVX2);

namespace scree::format::isa_avx2 {

uint64_t xxh3_64(const void* bytes, size_t size) {
  return XXH3_64bits(bytes, size);
}

void xxh3_64_update(void* state, const void* bytes, size_t size) {
  static_assert(sizeof(XXH3_state_t) == 576);
  XXH3_64bits_update(static_cast<XXH3_state_t*>(state), bytes, size);
}

}  // namespace scree::format::isa_avx2
