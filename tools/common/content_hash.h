// The hash by which convert recognises equal content. It has 128 bits, and the bytes are not compared: a collision
// among a million different contents has a probability of 1.5e-27. A deliberate collision only damages its author's own
// file. Comparing bytes would read all sources of equal content once more.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#define XXH_STATIC_LINKING_ONLY
#include <xxhash.h>

namespace scree::convert {

using ContentHash = std::array<uint64_t, 2>;

/// XXH3-128 of bytes that are added in pieces.
class ContentHasher {
 public:
  ContentHasher() { XXH3_128bits_reset(&state_); }
  void add(std::span<const std::byte> bytes) { XXH3_128bits_update(&state_, bytes.data(), bytes.size()); }
  ContentHash value() const {
    const XXH128_hash_t hash = XXH3_128bits_digest(&state_);
    return {hash.high64, hash.low64};
  }

 private:
  XXH3_state_t state_;
};

}  // namespace scree::convert
