// The checks that every codec's stream must pass.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "format/result.h"
#include "tests/catch.h"
#include "tests/format/geometry/guarded_bytes.h"

namespace scree::tests {

/// An error's kind as a word for comparing.
inline std::string word_of(ErrorCode code) {
  static const std::map<ErrorCode, std::string> words{
      {ErrorCode::kTruncated, "truncated"},    {ErrorCode::kTrailing, "trailing"}, {ErrorCode::kRange, "range"},
      {ErrorCode::kFormat, "format"},          {ErrorCode::kVersion, "version"},   {ErrorCode::kReserved, "reserved"},
      {ErrorCode::kUnsupported, "unsupported"}};
  const auto word = words.find(code);
  return word == words.end() ? "other" : word->second;
}

/// The outcome of a call: "ok" or the kind of error.
template <class T>
std::string outcome(const Result<T>& result) {
  return result ? "ok" : word_of(result.error().code);
}

/// The outcome of decoding a stream, which must equal that of only checking it.
template <class Decoded>
std::string outcome_of_both(const Result<Decoded>& decoded, const Result<void>& checked) {
  return outcome(decoded) == outcome(checked) ? outcome(decoded) : outcome(decoded) + " and " + outcome(checked);
}

/// The bytes that `write` writes into a buffer of `size` bytes that ends at a guard page. The encoder must clear unused
/// bytes.
template <class Write>
std::vector<std::byte> encoded(uint64_t size, const Write& write) {
  GuardedBytes guarded(size);
  std::fill(guarded.bytes().begin(), guarded.bytes().end(), std::byte{0xaa});
  write(guarded.bytes());
  return {guarded.bytes().begin(), guarded.bytes().end()};
}

/// Checks that `decode` stays inside the stream (guard page), accepts any alignment, and refuses every prefix, one byte
/// too many and every set bit after the data. `decode`: Result<void>(std::span<const std::byte>). `valid`: a stream
/// that it accepts, with `data_bits` of data.
template <class Decode>
void check_stream_limits(std::span<const std::byte> valid, uint64_t data_bits, Decode&& decode) {
  {
    GuardedBytes guarded(valid);
    CHECK(outcome(decode(guarded.bytes())) == "ok");
  }
  for (size_t shift = 1; shift < 4; ++shift) {
    const auto moved = std::make_unique<std::byte[]>(valid.size() + shift);
    std::copy(valid.begin(), valid.end(), moved.get() + shift);
    CHECK(outcome(decode({moved.get() + shift, valid.size()})) == "ok");
  }
  for (size_t size = 0; size < valid.size(); ++size) {
    const auto prefix = std::make_unique<std::byte[]>(size);  // exact size, so that ASan detects a read past its end
    std::copy_n(valid.begin(), size, prefix.get());
    const std::string found = outcome(decode({prefix.get(), size}));
    if (found != "truncated") FAIL("a prefix of " << size << " of " << valid.size() << " bytes: " << found);
  }
  {
    const auto longer = std::make_unique<std::byte[]>(valid.size() + 1);
    std::copy(valid.begin(), valid.end(), longer.get());
    CHECK(outcome(decode({longer.get(), valid.size() + 1})) == "trailing");
  }
  const auto flipped = std::make_unique<std::byte[]>(valid.size());
  std::copy(valid.begin(), valid.end(), flipped.get());
  for (uint64_t bit = data_bits; bit < 8 * valid.size(); ++bit) {
    flipped[bit / 8] ^= std::byte{1} << (bit % 8);
    const std::string found = outcome(decode({flipped.get(), valid.size()}));
    flipped[bit / 8] ^= std::byte{1} << (bit % 8);
    if (found != "trailing") FAIL("bit " << bit << " set after " << data_bits << " bits of data: " << found);
  }
}

}  // namespace scree::tests
