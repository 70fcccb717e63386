// Bit-packed streams: value i of width `bits` lies at bit i * bits, least significant bit first, in little-endian
// bytes. unpack() runs in kernels too. Source: spec/codecs.md, packed streams.
#pragma once

#include <cstdint>
#include <cstring>

#include "format/bytes.h"
#include "format/hd.h"

namespace scree::format {

/// Zero bytes behind the data. They let a reader load 8 bytes from the first byte of any value.
inline constexpr uint64_t kPackedSlackBytes = 8;

/// Bytes of a packed stream of `count` values: ceil(count * bits / 8) + slack, rounded up to 16. 0 where count or bits
/// is 0. The caller keeps count * bits below 2^63 (count < 2^32 and bits <= 96 suffice).
SCREE_HD constexpr uint64_t packed_bytes(uint64_t count, uint32_t bits) {
  if (count == 0 || bits == 0) return 0;
  return ((count * bits + 7) / 8 + kPackedSlackBytes + 15) & ~uint64_t{15};
}

/// The value of `bits` bits (0 to 32) at bit `bit_offset` of a stream that ends with its slack. The offset is 64-bit
/// because an index times the bits passes 2^32. In a kernel the stream is 4-byte aligned. For 0 bits no memory is read,
/// since the stream has no bytes.
SCREE_HD inline uint32_t unpack(const void* stream, uint64_t bit_offset, uint32_t bits) {
  if (bits == 0) return 0;
#if defined(__CUDA_ARCH__)
  // Two aligned words hold any 32 bits. The second ends within 8 bytes of the value's first byte, inside the slack.
  const uint32_t* word = static_cast<const uint32_t*>(stream) + (bit_offset >> 5);
  const uint32_t value = __funnelshift_r(word[0], word[1], static_cast<uint32_t>(bit_offset) & 31u);
  return value & (0xffffffffu >> (32u - bits));
#else
  uint64_t window;
  std::memcpy(&window, static_cast<const unsigned char*>(stream) + (bit_offset >> 3), sizeof window);
  return static_cast<uint32_t>(window >> (bit_offset & 7u)) & (0xffffffffu >> (32u - bits));
#endif
}

}  // namespace scree::format
