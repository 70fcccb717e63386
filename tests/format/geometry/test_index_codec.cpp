#include "format/geometry/index_codec.h"

#include <algorithm>
#include <limits>
#include <random>
#include <vector>

#include "tests/format/geometry/index_range.h"
#include "tests/format/geometry/spec_vectors.h"
#include "tests/format/geometry/stream_checks.h"

using namespace scree::format;
using namespace scree::tests;
using scree::Result;

namespace {

constexpr uint32_t kMostVertices = std::numeric_limits<uint32_t>::max();

std::vector<std::byte> encode(const std::vector<uint32_t>& indices, IndexRange range) {
  return encoded(packed_bytes(indices.size(), range.bits), [&](auto out) { encode_indices(out, indices, range); });
}

/// Decodes into a buffer that ends at a guard page.
bool decodes_to(const std::vector<uint32_t>& indices, IndexRange range, std::span<const std::byte> bytes) {
  GuardedBytes guarded(indices.size() * sizeof(uint32_t));
  const std::span<uint32_t> out(reinterpret_cast<uint32_t*>(guarded.bytes().data()), indices.size());
  return decode_indices(out, kMostVertices, range, bytes) && std::equal(out.begin(), out.end(), indices.begin());
}

}  // namespace

TEST_CASE("index streams of the spec", "[index_codec][spec]") {
  for (const auto& vector : scree::tests::spec_vectors("indices.txt")) {
    INFO(vector.text("name"));
    const auto indices = vector.integers<uint32_t>("indices");
    const auto bytes = vector.bytes("bytes");
    const auto vertex_count = vector.integer<uint32_t>("vertex_count");
    const IndexRange range{vector.integer<uint32_t>("min"), vector.integer<uint32_t>("bits")};
    const std::string expected = vector.has("error") ? vector.text("error") : "ok";
    std::vector<uint32_t> decoded(indices.size());
    CHECK(outcome(decode_indices(decoded, vertex_count, range, bytes)) == expected);
    CHECK(outcome(check_indices(indices.size(), vertex_count, range, bytes)) == expected);
    if (expected != "ok") continue;
    CHECK(decoded == indices);
    CHECK(scree::tests::index_range(indices).min == range.min);
    CHECK(scree::tests::index_range(indices).bits == range.bits);
    CHECK(encode(indices, range) == bytes);
  }
}

TEST_CASE("indices survive every width and length around a group", "[index_codec]") {
  std::mt19937 random(11);
  for (uint32_t bits = 0; bits <= 32; ++bits) {
    const auto mask = static_cast<uint32_t>((uint64_t{1} << bits) - 1);
    for (const size_t count : {0, 1, 2, 7, 8, 9, 15, 16, 17, 63, 64, 65, 300}) {
      const uint32_t min = bits == 32 ? 0 : static_cast<uint32_t>(random()) % (kMostVertices - mask);
      std::vector<uint32_t> indices(count);
      for (uint32_t& index : indices)
        index = std::min(min + (static_cast<uint32_t>(random()) & mask), kMostVertices - 1);
      const IndexRange range{min, bits};
      if (!decodes_to(indices, range, encode(indices, range))) FAIL(bits << " bits, " << count << " indices");
      const IndexRange tight = scree::tests::index_range(indices);
      if (tight.bits > bits || !decodes_to(indices, tight, encode(indices, tight)))
        FAIL(bits << " bits, " << count << " indices, tight");
    }
  }
}

TEST_CASE("the width of a span of indices is exact around powers of two", "[index_codec]") {
  for (uint32_t power = 0; power <= 32; ++power) {
    for (int64_t away = -1; away <= 1; ++away) {
      const int64_t span = (int64_t{1} << power) + away;
      if (span > int64_t{0xfffffffe}) continue;
      for (const uint32_t min : {0u, 3u}) {
        if (min + span >= int64_t{kMostVertices}) continue;
        const std::vector<uint32_t> indices{min, static_cast<uint32_t>(min + span),
                                            static_cast<uint32_t>(min + span / 2)};
        const IndexRange range = scree::tests::index_range(indices);
        uint32_t bits = 0;  // the smallest number with span < 2^bits
        while ((int64_t{1} << bits) <= span) ++bits;
        if (range.min != min || range.bits != bits) FAIL("span " << span << ": " << range.bits << " bits");
        if (!decodes_to(indices, range, encode(indices, range))) FAIL("span " << span << " does not round trip");
      }
    }
  }
  CHECK(scree::tests::index_range(std::vector<uint32_t>{0, 0xffffffffu}).bits == 32);
  CHECK(scree::tests::index_range({}).bits == 0);
}

TEST_CASE("an index decoder stays inside its bytes and refuses other sizes", "[index_codec]") {
  std::mt19937 random(3);
  for (const uint32_t bits : {1u, 5u, 8u, 13u, 31u, 32u}) {
    for (const size_t count : {1, 8, 21}) {
      const auto mask = static_cast<uint32_t>((uint64_t{1} << bits) - 1);
      std::vector<uint32_t> indices(count);
      for (uint32_t& index : indices) index = std::min(static_cast<uint32_t>(random()) & mask, kMostVertices - 1);
      const IndexRange range{0, bits};
      const auto bytes = encode(indices, range);
      check_stream_limits(bytes, count * bits, [&](std::span<const std::byte> stream) {
        std::vector<uint32_t> out(count);
        return decode_indices(out, kMostVertices, range, stream);
      });
      check_stream_limits(bytes, count * bits, [&](std::span<const std::byte> stream) {
        return check_indices(count, kMostVertices, range, stream);
      });
    }
  }
}

TEST_CASE("an index that is too large is found at every position", "[index_codec]") {
  for (uint32_t bits = 1; bits <= 32; ++bits) {
    const auto limit = static_cast<uint32_t>((uint64_t{1} << bits) - 1);
    for (const size_t count : {1, 8, 70, 200}) {
      std::vector<uint32_t> indices(count, limit - 1);  // nearly all bits around the tested index are set
      for (size_t i = 0; i < count; i += 3) indices[i] = 0;
      const IndexRange range{0, bits};
      if (!check_indices(count, limit, range, GuardedBytes(encode(indices, range)).bytes()))
        FAIL(bits << " bits, " << count << " indices");
      for (size_t i = 0; i < count; ++i) {
        std::vector<uint32_t> changed = indices;
        changed[i] = limit;
        const Result<void> checked = check_indices(count, limit, range, GuardedBytes(encode(changed, range)).bytes());
        if (outcome(checked) != "range") FAIL(bits << " bits, index " << i << " of " << count);
        if (checked.error().message.find(std::to_string(limit)) == std::string::npos) FAIL(checked.error().message);
      }
    }
  }
}

TEST_CASE("hostile index ranges are refused", "[index_codec]") {
  const std::vector<uint32_t> indices{10, 12, 14};
  const IndexRange range = scree::tests::index_range(indices);
  const auto bytes = encode(indices, range);
  std::vector<uint32_t> out(3);
  CHECK(outcome(decode_indices(out, 15, range, bytes)) == "ok");
  CHECK(outcome(decode_indices(out, 14, range, bytes)) == "range");
  CHECK(outcome(check_indices(3, 15, range, bytes)) == "ok");
  CHECK(outcome(check_indices(3, 14, range, bytes)) == "range");
  CHECK(decode_indices(out, 14, range, bytes).error().message == "index 14, but 14 vertices");
  CHECK(outcome(decode_indices(out, 15, {10, 33}, bytes)) == "range");
  CHECK(outcome(decode_indices(out, 15, {10, 0xffffffffu}, bytes)) == "range");
  CHECK(outcome(decode_indices(out, kMostVertices, {0xffffffffu, 3}, bytes)) == "range");  // min + code passes 2^32
  CHECK(outcome(decode_indices(out, 15, {10, 0}, bytes)) == "trailing");
  // With 0 bits only the range matters.
  CHECK(outcome(decode_indices(out, 11, {10, 0}, {})) == "ok");
  CHECK(outcome(decode_indices(out, 10, {10, 0}, {})) == "range");
  CHECK(outcome(check_indices(uint64_t{1} << 60, 10, {10, 0}, {})) == "range");
  CHECK(outcome(decode_indices({}, 0, {10, 0}, {})) == "ok");
  CHECK(outcome(check_indices(std::numeric_limits<uint64_t>::max(), 15, {10, 3}, bytes)) == "range");
  CHECK(outcome(check_indices(uint64_t{1} << 60, 15, {10, 3}, bytes)) == "truncated");
}

TEST_CASE("an index stream of more than 2^32 bits is measured in 64 bits", "[index_codec]") {
  const uint64_t count = (uint64_t{1} << 28) + 5;
  const IndexRange range{0, 31};
  const uint64_t size = packed_bytes(count, range.bits);
  REQUIRE(size > (uint64_t{1} << 29));
  SparseBytes sparse(size);
  if (!sparse) {
    WARN("no room for a sparse 1 GiB: skipped");
    return;
  }
  // Every code is below the vertex count, so only the size and the last bytes are checked.
  CHECK(outcome(check_indices(count, uint32_t{1} << 31, range, sparse.bytes())) == "ok");
  const uint64_t data_bits = count * range.bits;
  sparse.bytes()[data_bits / 8] |= std::byte{1} << (data_bits % 8 - 1);
  CHECK(outcome(check_indices(count, uint32_t{1} << 31, range, sparse.bytes())) == "ok");  // the last bit of the data
                                                                                           // is set
  sparse.bytes()[data_bits / 8] |= std::byte{1} << (data_bits % 8);
  CHECK(outcome(check_indices(count, uint32_t{1} << 31, range, sparse.bytes())) == "trailing");
}

TEST_CASE("random bytes never take an index decoder past its limits", "[index_codec]") {
  std::mt19937 random(5);
  int accepted = 0;
  for (int round = 0; round < 3000; ++round) {
    const size_t count = random() % 40;
    const IndexRange range{static_cast<uint32_t>(random()) >> (random() % 32), static_cast<uint32_t>(random() % 34)};
    const uint32_t vertex_count = static_cast<uint32_t>(random()) >> (random() % 32);
    const uint64_t right = range.bits <= 32 ? packed_bytes(count, range.bits) : 16;
    GuardedBytes guarded(right + (random() % 8 == 0 ? random() % 3 : 0));
    for (uint64_t i = 0; i < std::min<uint64_t>(count * range.bits / 8, guarded.bytes().size()); ++i)
      guarded.bytes()[i] = static_cast<std::byte>(random());
    std::vector<uint32_t> out(count);
    const auto decoded = decode_indices(out, vertex_count, range, guarded.bytes());
    const auto checked = check_indices(count, vertex_count, range, guarded.bytes());
    if (outcome(decoded) != outcome(checked)) FAIL(outcome(decoded) << " but the check returns " << outcome(checked));
    if (decoded) {
      ++accepted;
      for (const uint32_t index : out)
        if (index >= vertex_count) FAIL("index " << index << " of " << vertex_count << " vertices");
    }
  }
  CHECK(accepted > 100);
}
