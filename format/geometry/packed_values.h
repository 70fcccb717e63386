// Packs and unpacks whole streams on the CPU, for all codecs. Eight values of one width take exactly `width` bytes, so
// each width has its own unrolled loop with constant shifts.
#pragma once

#include <cassert>
#include <cstddef>
#include <cstdint>
#include <span>
#include <type_traits>
#include <utility>

#include "format/bitpack.h"
#include "format/bytes.h"
#include "format/result.h"

namespace scree::format {

inline constexpr uint32_t kMaxPackedBits = 32;
inline constexpr uint64_t kPackedGroup = 8;

/// 2^bits - 1, bits 0 to 63.
constexpr uint64_t low_mask(uint32_t bits) {
  return (uint64_t{1} << bits) - 1;
}

/// Checks that `bytes` has the size of a stream of `data_bits` bits (kTruncated, kTrailing) and that the bits after the
/// data are zero (kTrailing). `stream_bytes`: the stream's packed_bytes(). `what`: name of the stream in the message.
Result<void> check_stream(const char* what, uint64_t data_bits, uint64_t stream_bytes,
                          std::span<const std::byte> bytes);

/// packed_bytes() for untrusted numbers: kRange where count * bits overflows.
Result<uint64_t> checked_packed_bytes(const char* what, uint64_t count, uint32_t bits);

/// Zeroes the bytes of `out` behind the last value.
void zero_slack(std::span<std::byte> out, uint64_t data_bits);

/// Calls function(integral_constant<uint32_t, bits>) for bits 0 to 32.
template <class Function>
void with_constant_bits(uint32_t bits, Function&& function) {
  assert(bits <= kMaxPackedBits);
  [&]<uint32_t... kBits>(std::integer_sequence<uint32_t, kBits...>) {
    (void)((bits == kBits && (function(std::integral_constant<uint32_t, kBits>{}), true)) || ...);
  }
  (std::make_integer_sequence<uint32_t, kMaxPackedBits + 1>{});
}

/// Packs value(0) .. value(count - 1), each below 2^bits, into exactly packed_bytes(count, bits) bytes.
template <class Value>
void pack_values(std::span<std::byte> out, uint64_t count, uint32_t bits, Value&& value) {
  assert(out.size() == packed_bytes(count, bits));
  if (out.empty()) return;
  const uint64_t groups = count / kPackedGroup;
  with_constant_bits(bits, [&](auto constant) {
    constexpr uint32_t kBits = constant();
    // A group is written in whole words: up to 7 bytes past its end, which the next group or the slack overwrites.
    const auto pack_group = [](std::byte* at, auto&& get) {
      uint64_t word = 0;
      uint32_t fill = 0;
#pragma GCC unroll 8
      for (uint32_t i = 0; i < kPackedGroup; ++i) {
        const uint64_t code = get(i);
        assert(code <= low_mask(kBits));
        word |= code << fill;
        fill += kBits;
        if (fill >= 64) {
          store(at, word);
          at += sizeof word;
          fill -= 64;
          word = fill == 0 ? 0 : code >> (kBits - fill);
        }
      }
      if (fill != 0) store(at, word);
    };
    std::byte* at = out.data();
    for (uint64_t group = 0; group < groups; ++group, at += kBits) {
      const uint64_t first = group * kPackedGroup;
      pack_group(at, [&](uint32_t i) -> uint64_t { return value(first + i); });
    }
    const uint64_t first = groups * kPackedGroup;
    if (first < count) {
      std::byte last[kMaxPackedBits + 8] = {};
      pack_group(last, [&](uint32_t i) -> uint64_t { return first + i < count ? value(first + i) : 0; });
      std::memcpy(at, last, ((count - first) * kBits + 7) / 8);
    }
  });
  zero_slack(out, count * bits);
}

/// Calls sink(i, code) for the codes of a stream of packed_bytes(count, bits) bytes, in order.
template <class Sink>
void unpack_values(const std::byte* stream, uint64_t count, uint32_t bits, Sink&& sink) {
  const uint64_t groups = count / kPackedGroup;
  with_constant_bits(bits, [&](auto constant) {
    constexpr uint32_t kBits = constant();
    const std::byte* at = stream;
    for (uint64_t group = 0; group < groups; ++group, at += kBits) {
#pragma GCC unroll 8
      for (uint32_t i = 0; i < kPackedGroup; ++i) sink(group * kPackedGroup + i, unpack(at, i * kBits, kBits));
    }
    for (uint64_t i = groups * kPackedGroup; i < count; ++i) sink(i, unpack(stream, i * kBits, kBits));
  });
}

}  // namespace scree::format
