#include "format/container/checksum.h"

#define XXH_STATIC_LINKING_ONLY
#include <xxhash.h>

#include "format/container/checksum_avx2.h"
#include "format/processor.h"

namespace scree::format {
namespace {

static_assert(sizeof(XXH3_state_t) == 576 && alignof(XXH3_state_t) == 64);

XXH3_state_t* xxh3(std::byte* state) {
  return reinterpret_cast<XXH3_state_t*>(state);
}

}  // namespace

uint64_t checksum(std::span<const std::byte> bytes) {
  return has_avx2() ? isa_avx2::xxh3_64(bytes.data(), bytes.size()) : XXH3_64bits(bytes.data(), bytes.size());
}

Checksum::Checksum() {
  XXH3_64bits_reset(xxh3(state_));
}

void Checksum::add(std::span<const std::byte> bytes) {
  if (has_avx2()) {
    isa_avx2::xxh3_64_update(state_, bytes.data(), bytes.size());
  } else {
    XXH3_64bits_update(xxh3(state_), bytes.data(), bytes.size());
  }
}

uint64_t Checksum::value() const {
  return XXH3_64bits_digest(reinterpret_cast<const XXH3_state_t*>(state_));
}

}  // namespace scree::format
