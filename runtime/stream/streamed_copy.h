// Copies that bypass the cache.
#pragma once

#include <emmintrin.h>

#include <cstddef>
#include <cstdint>
#include <cstring>

namespace scree::runtime {

/// memcpy() past the cache, for data that only a device reads next. Ordinary stores would first read the old bytes of
/// `to` into the cache. Synchronises with other threads like any copy.
inline void copy_past_cache(std::byte* to, const std::byte* from, size_t bytes) {
  constexpr size_t kVector = sizeof(__m128i);
  constexpr size_t kLine = 4 * kVector;
  const size_t before = (0 - reinterpret_cast<uintptr_t>(to)) % kLine;
  if (bytes < before + kLine) {
    std::memcpy(to, from, bytes);
    return;
  }
  std::memcpy(to, from, before);
  size_t at = before;
  for (; bytes - at >= kLine; at += kLine) {
    __m128i line[4];
    std::memcpy(line, from + at, kLine);
    auto* const out = reinterpret_cast<__m128i*>(to + at);
    for (int i = 0; i < 4; ++i) _mm_stream_si128(out + i, line[i]);
  }
  std::memcpy(to + at, from + at, bytes - at);
  _mm_sfence();
}

}  // namespace scree::runtime
