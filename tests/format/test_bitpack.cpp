#include "format/bitpack.h"

#include <random>
#include <vector>

#include "tests/catch.h"
#include "tests/format/geometry/guarded_bytes.h"

using namespace scree::format;
using scree::tests::GuardedBytes;
using scree::tests::SparseBytes;

namespace {

/// Reads `bits` bits at bit_offset, one by one.
uint32_t bit_by_bit(std::span<const std::byte> bytes, uint64_t bit_offset, uint32_t bits) {
  uint32_t value = 0;
  for (uint32_t i = 0; i < bits; ++i) {
    const uint64_t bit = bit_offset + i;
    value |= ((std::to_integer<uint32_t>(bytes[bit / 8]) >> (bit % 8)) & 1u) << i;
  }
  return value;
}

}  // namespace

TEST_CASE("a packed stream has its data and 8 bytes of slack, rounded up to 16 bytes", "[bitpack]") {
  CHECK(packed_bytes(0, 17) == 0);
  CHECK(packed_bytes(1000, 0) == 0);
  CHECK(packed_bytes(1, 1) == 16);
  CHECK(packed_bytes(64, 1) == 16);  // 8 bytes and 8 of slack
  CHECK(packed_bytes(65, 1) == 32);
  CHECK(packed_bytes(3, 32) == 32);
  CHECK(packed_bytes(uint64_t{1} << 32, 32) == (uint64_t{1} << 34) + 16);
  CHECK(packed_bytes(0xffffffffu, 96) == (uint64_t{0xffffffffu} * 12 + 8 + 15) / 16 * 16);
}

TEST_CASE("unpack equals reading bit by bit at every width and bit offset", "[bitpack]") {
  std::mt19937 random(7);
  std::vector<std::byte> bytes(64);
  for (std::byte& byte : bytes) byte = static_cast<std::byte>(random());
  for (uint32_t bits = 0; bits <= 32; ++bits) {
    for (uint64_t offset = 0; offset <= 128; ++offset) {
      if (unpack(bytes.data(), offset, bits) != bit_by_bit(bytes, offset, bits)) FAIL(bits << " bits at " << offset);
    }
  }
}

TEST_CASE("unpack reads at most the slack, and nothing for 0 bits", "[bitpack]") {
  CHECK(unpack(nullptr, 0, 0) == 0);
  for (uint32_t bits = 1; bits <= 32; ++bits) {
    for (uint64_t count = 1; count <= 17; ++count) {
      // A reader may depend on the slack alone, without the rounding to 16 bytes.
      const uint64_t data_bytes = (count * bits + 7) / 8;
      GuardedBytes guarded(data_bytes + kPackedSlackBytes);
      for (uint64_t i = 0; i < data_bytes; ++i) guarded.bytes()[i] = std::byte{0xff};
      const uint32_t all_ones = static_cast<uint32_t>((uint64_t{1} << bits) - 1);
      if (unpack(guarded.bytes().data(), (count - 1) * bits, bits) != all_ones) FAIL(bits << " bits, " << count);
    }
  }
}

TEST_CASE("unpack reads bits past 2^32", "[bitpack]") {
  SparseBytes sparse(uint64_t{1} << 30);
  if (!sparse) {
    WARN("no room for a sparse 1 GiB: skipped");
    return;
  }
  std::byte* const bytes = sparse.bytes().data();
  const uint32_t bits = 17;
  const uint64_t index = (uint64_t{1} << 32) / bits + 12345;  // index * bits wraps in 32 bits
  const uint64_t offset = index * bits;
  REQUIRE(offset > uint64_t{0xffffffffu});
  const uint32_t value = 0x15a5du;
  for (uint32_t i = 0; i < bits; ++i)
    if ((value >> i) & 1u) bytes[(offset + i) / 8] |= std::byte{1} << ((offset + i) % 8);
  CHECK(unpack(bytes, offset, bits) == value);
  CHECK(unpack(bytes, offset & 0xffffffffu, bits) == 0);  // a 32-bit product would give this address
}
