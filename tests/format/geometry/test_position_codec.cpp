#include "format/geometry/position_codec.h"

#include <algorithm>
#include <bit>
#include <cfloat>
#include <cmath>
#include <limits>
#include <random>
#include <utility>
#include <vector>

#include "format/geometry/packed_values.h"
#include "tests/format/geometry/spec_vectors.h"
#include "tests/format/geometry/stream_checks.h"
#include "tests/results.h"

using namespace scree::format;
using namespace scree::tests;

namespace {

std::vector<std::byte> encode(const std::vector<uint32_t>& offsets, const PositionRange& range) {
  return encoded(position_stream_bytes(offsets.size() / 3, range),
                 [&](auto out) { encode_positions(out, offsets, range); });
}

MeshLattice lattice_with_bits(uint8_t x, uint8_t y, uint8_t z) {
  return {.exponent = -8, .min = {-1000, 0, 123456789}, .bits = {x, y, z}};
}

/// Whether the offsets decode to the values of their lattice points.
bool round_trips(const std::vector<uint32_t>& offsets, const MeshLattice& lattice, const PositionRange& range) {
  const auto bytes = encode(offsets, range);
  GuardedBytes guarded(offsets.size() * sizeof(float));
  const std::span<float> out(reinterpret_cast<float*>(guarded.bytes().data()), offsets.size());
  if (!decode_positions(out, lattice, range, bytes)) return false;
  if (!check_positions(offsets.size() / 3, lattice, range, bytes)) return false;
  for (size_t i = 0; i < offsets.size(); ++i)
    if (out[i] != dequantize(lattice.min[i % 3] + offsets[i], lattice.exponent)) return false;
  return true;
}

}  // namespace

TEST_CASE("lattices of the spec", "[position_codec][spec]") {
  for (const auto& vector : scree::tests::spec_vectors("lattice.txt")) {
    INFO(vector.text("name"));
    const auto lo = vector.floats("lo");
    const auto hi = vector.floats("hi");
    const auto lattice =
        choose_lattice(lo.data(), hi.data(), vector.integer<uint32_t>("bits"), vector.number("max_error"));
    if (vector.has("error")) {
      REQUIRE_FALSE(lattice);
      CHECK(lattice.error().code == scree::ErrorCode::kRange);
      continue;
    }
    REQUIRE(lattice);
    CHECK(lattice->exponent == vector.integer<int32_t>("lattice_exponent"));
    const auto min = vector.integers<int64_t>("lattice_min");
    const auto bits = vector.integers<uint8_t>("lattice_bits");
    CHECK(std::equal(min.begin(), min.end(), lattice->min.begin()));
    CHECK(std::equal(bits.begin(), bits.end(), lattice->bits.begin()));
    CHECK(lattice->max_error == vector.number("stated_error"));
  }
}

TEST_CASE("position streams of the spec", "[position_codec][spec]") {
  for (const auto& vector : scree::tests::spec_vectors("positions.txt")) {
    INFO(vector.text("name"));
    MeshLattice lattice{.exponent = vector.integer<int32_t>("lattice_exponent")};
    PositionRange range;
    for (size_t axis = 0; axis < 3; ++axis) {
      lattice.min[axis] = vector.integers<int64_t>("lattice_min").at(axis);
      lattice.bits[axis] = vector.integers<uint8_t>("lattice_bits").at(axis);
      range.min[axis] = vector.integers<uint32_t>("min").at(axis);
      range.bits[axis] = vector.integers<uint8_t>("bits").at(axis);
    }
    const auto bytes = vector.bytes("bytes");
    if (vector.has("error")) {
      std::vector<float> out(vector.has("offsets") ? vector.integers<uint32_t>("offsets").size() : 3);
      CHECK(outcome(decode_positions(out, lattice, range, bytes)) == vector.text("error"));
      CHECK(outcome(check_positions(out.size() / 3, lattice, range, bytes)) == vector.text("error"));
      continue;
    }
    const auto positions = vector.floats("positions");
    std::vector<float> decoded(positions.size());
    CHECK(outcome(decode_positions(decoded, lattice, range, bytes)) == "ok");
    CHECK(outcome(check_positions(positions.size() / 3, lattice, range, bytes)) == "ok");
    CHECK(decoded == positions);
    if (range.is_float32()) {
      std::vector<std::byte> floats(position_stream_bytes(positions.size() / 3, range));
      encode_positions_float32(floats, positions);
      CHECK(floats == bytes);
      continue;
    }
    const auto offsets = vector.integers<uint32_t>("offsets");
    CHECK(encode(offsets, range) == bytes);
    const PositionRange tight = position_range(offsets);
    CHECK(tight.min == range.min);
    CHECK(tight.bits == range.bits);
    std::vector<uint32_t> quantized(offsets.size());
    quantize_positions(quantized, positions, lattice);
    CHECK(quantized == offsets);
  }
}

TEST_CASE("positions survive every width and length", "[position_codec]") {
  std::mt19937 random(1);
  std::vector<std::array<uint8_t, 3>> widths;
  for (uint8_t bits = 0; bits <= 24; ++bits) {
    widths.push_back({bits, bits, bits});
    widths.push_back({bits, 0, 0});
    widths.push_back({0, bits, 0});
    widths.push_back({0, 0, bits});
    widths.push_back({24, bits, 24});
    widths.push_back({bits, static_cast<uint8_t>(24 - bits), 9});
  }
  widths.push_back({24, 24, 9});   // 57 bits: the most that one window holds
  widths.push_back({24, 24, 10});  // 58
  for (const auto& bits : widths) {
    for (const size_t count : {0, 1, 2, 7, 8, 9, 40}) {
      PositionRange range{.bits = bits};
      std::vector<uint32_t> offsets(3 * count);
      for (size_t axis = 0; axis < 3; ++axis) {
        const uint32_t mask = (1u << bits[axis]) - 1;
        range.min[axis] = bits[axis] == 24 ? 0 : static_cast<uint32_t>(random()) % (0x1000000u - mask);
        for (size_t i = axis; i < offsets.size(); i += 3)
          offsets[i] = range.min[axis] + (i / 3 == 1 ? mask : static_cast<uint32_t>(random()) & mask);
      }
      const MeshLattice lattice = lattice_with_bits(24, 24, 24);
      if (!round_trips(offsets, lattice, range) || !round_trips(offsets, lattice, position_range(offsets)))
        FAIL(int{bits[0]} << ", " << int{bits[1]} << ", " << int{bits[2]} << " bits, " << count << " vertices");
    }
  }
}

TEST_CASE("a position decoder stays inside its bytes and refuses other sizes", "[position_codec]") {
  std::mt19937 random(2);
  const MeshLattice lattice = lattice_with_bits(24, 24, 24);
  for (const std::array<uint8_t, 3> bits : {std::array<uint8_t, 3>{16, 16, 16},
                                            {1, 0, 0},
                                            {0, 0, 3},
                                            {10, 11, 12},
                                            {24, 24, 24},
                                            {24, 24, 9},
                                            {24, 24, 10}}) {
    for (const size_t count : {1, 3, 8}) {
      const PositionRange range{.bits = bits};
      std::vector<uint32_t> offsets(3 * count);
      for (size_t i = 0; i < offsets.size(); ++i)
        offsets[i] = static_cast<uint32_t>(random()) & ((1u << bits[i % 3]) - 1);
      const auto bytes = encode(offsets, range);
      const uint64_t data_bits = count * range.stride_bits();
      check_stream_limits(bytes, data_bits, [&](std::span<const std::byte> stream) {
        std::vector<float> out(3 * count);
        return decode_positions(out, lattice, range, stream);
      });
      check_stream_limits(bytes, data_bits, [&](std::span<const std::byte> stream) {
        return check_positions(count, lattice, range, stream);
      });
    }
  }
}

TEST_CASE("float32 positions are kept to the bit and checked", "[position_codec]") {
  const PositionRange range{.bits = {32, 32, 32}};
  std::mt19937 random(3);
  for (const size_t count : {0, 1, 3, 4, 5, 9}) {
    std::vector<float> positions(3 * count);
    for (float& value : positions) value = std::bit_cast<float>(static_cast<uint32_t>(random()) & 0xbfffffffu);
    std::vector<std::byte> bytes(position_stream_bytes(count, range), std::byte{0xaa});
    CHECK(bytes.size() == (12 * count + 15) / 16 * 16);
    encode_positions_float32(bytes, positions);
    std::vector<float> decoded(positions.size());
    REQUIRE(decode_positions(decoded, {}, range, bytes));
    CHECK(decoded == positions);
    check_stream_limits(bytes, 96 * count, [&](std::span<const std::byte> stream) {
      std::vector<float> out(3 * count);
      return decode_positions(out, {}, range, stream);
    });
    for (const float bad : {std::numeric_limits<float>::quiet_NaN(), -std::numeric_limits<float>::infinity()}) {
      if (count == 0) continue;
      positions.back() = bad;
      encode_positions_float32(bytes, positions);
      CHECK(outcome(decode_positions(decoded, {}, range, bytes)) == "format");
      CHECK(outcome(check_positions(count, {}, range, bytes)) == "format");
    }
  }
}

TEST_CASE("a code that is too large is found at every position", "[position_codec]") {
  std::mt19937 random(41);
  constexpr uint64_t kCount = 43;
  for (int round = 0; round < 60; ++round) {
    // From 3 to 72 bits per vertex.
    PositionRange range;
    MeshLattice lattice;
    const uint32_t widest = 1 + static_cast<uint32_t>(random()) % kMaxPositionBits;
    for (size_t axis = 0; axis < 3; ++axis) {
      range.min[axis] = 1;  // the largest code lies just outside the lattice
      range.bits[axis] = static_cast<uint8_t>(1 + random() % widest);
      lattice.bits[axis] = range.bits[axis];
    }
    std::vector<uint32_t> offsets(3 * kCount);
    for (size_t i = 0; i < offsets.size(); ++i)
      offsets[i] = random() % 3 == 0 ? 1 : static_cast<uint32_t>(low_mask(range.bits[i % 3]));
    const auto good = encode(offsets, range);
    if (!check_positions(kCount, lattice, range, GuardedBytes(good).bytes())) FAIL("round " << round);
    for (size_t i = 0; i < offsets.size(); ++i) {
      const uint32_t kept = std::exchange(offsets[i], static_cast<uint32_t>(low_mask(range.bits[i % 3]) + 1));
      const auto bytes = encode(offsets, range);
      if (outcome(check_positions(kCount, lattice, range, GuardedBytes(bytes).bytes())) != "range")
        FAIL("round " << round << ": vertex " << i / 3 << ", axis " << i % 3);
      offsets[i] = kept;
    }
  }
}

TEST_CASE("hostile position ranges and lattices are refused", "[position_codec]") {
  const std::vector<uint32_t> offsets{5, 6, 7, 8, 9, 10};
  const PositionRange range = position_range(offsets);  // min 5 6 7, bits 2 2 2
  const auto bytes = encode(offsets, range);
  const MeshLattice lattice = lattice_with_bits(4, 4, 4);
  std::vector<float> out(6);
  const auto both = [&](const MeshLattice& on, const PositionRange& with, std::span<const std::byte> stream) {
    return outcome_of_both(decode_positions(out, on, with, stream), check_positions(2, on, with, stream));
  };
  CHECK(both(lattice, range, bytes) == "ok");

  MeshLattice narrow = lattice;
  narrow.bits = {4, 4, 3};  // 10 exceeds 7
  CHECK(both(narrow, range, bytes) == "range");
  narrow.bits = {2, 4, 4};  // the smallest offset itself exceeds 3
  CHECK(both(narrow, range, bytes) == "range");

  PositionRange changed = range;
  changed.min[1] = 0xffffffffu;
  CHECK(both(lattice, changed, bytes) == "range");
  for (const uint8_t bits : {uint8_t{25}, uint8_t{31}, uint8_t{32}, uint8_t{33}, uint8_t{255}}) {
    for (size_t axis = 0; axis < 3; ++axis) {
      changed = range;
      changed.bits[axis] = bits;
      CHECK(both(lattice, changed, bytes) == "range");
      MeshLattice wide = lattice;
      wide.bits[axis] = bits;
      CHECK(both(wide, range, bytes) == "range");
    }
  }
  changed = range;
  changed.bits = {32, 32, 32};  // and the offsets are not 0
  CHECK(both(lattice, changed, bytes) == "range");

  MeshLattice moved = lattice;
  for (const int64_t min :
       {std::numeric_limits<int64_t>::min(), -kLatticeLimit, kLatticeLimit, std::numeric_limits<int64_t>::max()}) {
    moved.min = {0, min, 0};
    CHECK(both(moved, range, bytes) == "range");
  }
  moved.min = {0, kLatticeLimit - 1, 1 - kLatticeLimit};
  CHECK(both(moved, range, bytes) == "ok");
  for (const int32_t exponent : {std::numeric_limits<int32_t>::min(), -150, 128, std::numeric_limits<int32_t>::max()}) {
    moved = lattice;
    moved.exponent = exponent;
    CHECK(both(moved, range, bytes) == "range");
  }
  // For a lattice with points past the largest float, only codes of such points are refused.
  moved.exponent = 126;
  moved.min = {0, 0, 0};
  CHECK(both(moved, range, bytes) == "range");
  moved.exponent = 124;
  CHECK(both(moved, range, bytes) == "ok");
  moved.exponent = 125;  // both 10 * 2^125 and 8 * 2^125 = 2^128 are too large
  CHECK(both(moved, range, bytes) == "range");

  CHECK(outcome(check_positions(std::numeric_limits<uint64_t>::max(), lattice, range, bytes)) == "range");
  CHECK(outcome(check_positions(uint64_t{1} << 58, lattice, range, bytes)) == "truncated");
  const PositionRange floats{.bits = {32, 32, 32}};
  CHECK(outcome(check_positions(uint64_t{1} << 62, lattice, floats, bytes)) == "range");
  CHECK(outcome(check_positions(uint64_t{1} << 56, lattice, floats, bytes)) == "truncated");
  CHECK(outcome(check_positions(uint64_t{1} << 60, lattice_with_bits(4, 4, 4), PositionRange{}, {})) == "ok");
}

TEST_CASE("a position stream of more than 2^32 bits is measured in 64 bits", "[position_codec]") {
  const uint64_t count = (uint64_t{1} << 27) + 3;
  const PositionRange range{.bits = {16, 16, 16}};
  SparseBytes sparse(position_stream_bytes(count, range));
  if (!sparse) {
    WARN("no room for a sparse 800 MiB: skipped");
    return;
  }
  REQUIRE(8 * sparse.bytes().size() > (uint64_t{1} << 32));
  const MeshLattice lattice = lattice_with_bits(16, 16, 16);
  CHECK(outcome(check_positions(count, lattice, range, sparse.bytes())) == "ok");
  sparse.bytes()[6 * count - 1] = std::byte{0x80};
  CHECK(outcome(check_positions(count, lattice, range, sparse.bytes())) == "ok");
  sparse.bytes()[6 * count] = std::byte{1};
  CHECK(outcome(check_positions(count, lattice, range, sparse.bytes())) == "trailing");
}

TEST_CASE("quantised positions keep the stated error at every scale", "[position_codec]") {
  std::mt19937 random(4);
  int exact = 0, refused = 0;
  for (int round = 0; round < 6000; ++round) {
    const size_t count = 1 + random() % 12;
    const int scale = static_cast<int>(random() % 262) - 149;
    std::vector<float> positions(3 * count);
    float lo[3];
    float hi[3];
    for (size_t axis = 0; axis < 3; ++axis) {
      const double center = std::ldexp(static_cast<double>(random() % 2001) - 1000, scale);
      const double width = random() % 5 == 0 ? 0 : std::ldexp(1.0, scale + 10 - static_cast<int>(random() % 40));
      lo[axis] = FLT_MAX;
      hi[axis] = -FLT_MAX;
      for (size_t i = axis; i < positions.size(); i += 3) {
        positions[i] = static_cast<float>(center + width * static_cast<double>(random()) * 0x1p-32);
        positions[i] = std::clamp(positions[i], -FLT_MAX, FLT_MAX);
        lo[axis] = std::min(lo[axis], positions[i]);
        hi[axis] = std::max(hi[axis], positions[i]);
      }
    }
    const uint32_t bits = 1 + static_cast<uint32_t>(random() % 24);
    const double wanted = random() % 2 ? 0
                                       : std::ldexp(1.0 + static_cast<double>(random() % 100) / 100,
                                                    scale - static_cast<int>(random() % 20));
    const auto lattice = choose_lattice(lo, hi, bits, wanted);
    if (!lattice) {
      if (lattice.error().code != scree::ErrorCode::kRange) FAIL(lattice.error().message);
      ++refused;
      continue;
    }
    if (wanted > 0 && lattice->max_error > wanted) FAIL("states " << lattice->max_error << ", requested " << wanted);
    if (wanted == 0 && *std::max_element(lattice->bits.begin(), lattice->bits.end()) > bits)
      FAIL("more than " << bits << " bits");
    exact += lattice->max_error == 0;
    std::vector<uint32_t> offsets(positions.size());
    const double stated = quantize_positions(offsets, positions, *lattice);
    const PositionRange range = position_range(offsets);
    const auto bytes = encode(offsets, range);
    std::vector<float> decoded(positions.size());
    must(decode_positions(decoded, *lattice, range, bytes));
    double largest = 0;
    for (size_t i = 0; i < positions.size(); ++i) {
      const double error = std::fabs(static_cast<double>(decoded[i]) - static_cast<double>(positions[i]));
      if (error > lattice->max_error)
        FAIL(positions[i] << " became " << decoded[i] << ", stated " << lattice->max_error);
      largest = std::max(largest, error);
    }
    if (stated != largest) FAIL("quantising returned an error of " << stated << ", but it is " << largest);
  }
  CHECK(exact > 100);
  CHECK(refused < 3000);
}

TEST_CASE("a requested error gets the coarsest step that keeps it", "[position_codec]") {
  std::mt19937 random(5);
  for (int round = 0; round < 20000; ++round) {
    const float size =
        std::ldexp(1.0f + static_cast<float>(random() % 1000) / 1000, static_cast<int>(random() % 60) - 30);
    const float lo[3] = {-size, 0, -size / 3};
    const float hi[3] = {size, size / 2, size / 7};
    const double wanted = static_cast<double>(size) * std::ldexp(1.0 + static_cast<double>(random() % 1000) / 1000,
                                                                 -static_cast<int>(random() % 22) - 1);
    const double half_ulp = 0.5 * float_ulp(size);
    const auto lattice = must(choose_lattice(lo, hi, 16, wanted));
    const double half_step = 0.5 * exp2i(lattice.exponent);
    if (half_step + half_ulp > wanted) FAIL("half of 2^" << lattice.exponent << " is more than " << wanted);
    if (2 * half_step + half_ulp <= wanted) FAIL("twice 2^" << lattice.exponent << " would keep " << wanted << " too");
    if (lattice.max_error != half_step + half_ulp) FAIL("states " << lattice.max_error);
  }
}

TEST_CASE("with an error above the size of a mesh, the lattice is one point", "[position_codec]") {
  const float lo[3] = {-1, 0, 2};
  const float hi[3] = {1, 0.5f, 3};
  for (const double wanted : {1e9, 1e38, 1e300, std::numeric_limits<double>::infinity()}) {
    const auto lattice = must(choose_lattice(lo, hi, 16, wanted));
    CHECK(lattice.bits == std::array<uint8_t, 3>{0, 0, 0});
    CHECK(lattice.exponent <= kMaxLatticeExponent);
    CHECK(lattice.max_error <= wanted);
  }
}

TEST_CASE("random bytes and ranges never take a position decoder past its limits", "[position_codec]") {
  std::mt19937_64 random(8);
  int accepted = 0;
  for (int round = 0; round < 20000; ++round) {
    const size_t count = random() % 12;
    // Values are mostly near the limits, sometimes random.
    MeshLattice lattice;
    PositionRange range;
    lattice.exponent = random() % 8 == 0 ? static_cast<int32_t>(random()) : static_cast<int32_t>(random() % 281) - 151;
    for (size_t axis = 0; axis < 3; ++axis) {
      lattice.min[axis] = static_cast<int64_t>(random()) >> (random() % 8 == 0 ? 0 : 12 + random() % 52);
      lattice.bits[axis] = static_cast<uint8_t>(random() % 8 == 0 ? random() : random() % 25);
      range.bits[axis] = static_cast<uint8_t>(random() % 32 == 0 ? random() : random() % (lattice.bits[axis] % 25 + 1));
      range.min[axis] = static_cast<uint32_t>(random() % 4 == 0 ? random() >> (random() % 64) : 0);
    }
    if (round % 16 == 0) range = {{0, 0, 0}, {32, 32, 32}};
    const uint64_t data_bits = count * (range.is_float32() ? 96 : range.stride_bits());
    GuardedBytes guarded(position_stream_bytes(count, range) + (random() % 8 == 0 ? random() % 3 : 0));
    for (uint64_t bit = 0; bit < std::min<uint64_t>(data_bits, 8 * guarded.bytes().size()); ++bit)
      if (random() % 2) guarded.bytes()[bit / 8] |= std::byte{1} << (bit % 8);
    std::vector<float> out(3 * count);
    const auto decoded = decode_positions(out, lattice, range, guarded.bytes());
    const auto checked = check_positions(count, lattice, range, guarded.bytes());
    if (outcome(decoded) != outcome(checked)) FAIL(outcome(decoded) << " but the check returns " << outcome(checked));
    if (!decoded) continue;
    ++accepted;
    for (const float value : out)
      if (!std::isfinite(value)) FAIL("a position that is not finite");
  }
  CHECK(accepted > 1000);
}

TEST_CASE("an impossible lattice is refused with the reason", "[position_codec]") {
  const float lo[3] = {-1000, 0, 0};
  const float hi[3] = {1000, 1, 1};
  const auto fine = choose_lattice(lo, hi, 16, 1e-4);  // step 2^-13: 24 bits
  CHECK(fine);
  const auto finer = choose_lattice(lo, hi, 16, 5e-5);  // step 2^-15
  REQUIRE_FALSE(finer);
  CHECK(finer.error().code == scree::ErrorCode::kRange);
  CHECK(finer.error().message.find("26 bits on x") != std::string::npos);
  CHECK(finer.error().message.find("float32") != std::string::npos);
  CHECK(refusal(choose_lattice(lo, hi, 16, 1e-9)).message.find("half the spacing of float32 at 1000") !=
        std::string::npos);

  CHECK(lattice_of_exponent(lo, hi, -12));
  CHECK(lattice_of_exponent(lo, hi, -12)->bits[0] == 23);
  CHECK_FALSE(lattice_of_exponent(lo, hi, -14));
  CHECK_FALSE(lattice_of_exponent(lo, hi, -149));
  CHECK_FALSE(lattice_of_exponent(lo, hi, -150));
  CHECK_FALSE(lattice_of_exponent(lo, hi, 128));

  // Within half a step below 2^128 no lattice point is a float.
  const float low[3] = {0, 0, 0};
  const float huge[3] = {FLT_MAX, 0, 0};
  CHECK(refusal(choose_lattice(low, huge, 16, 0)).message.find("exceeds float32") != std::string::npos);
  CHECK(choose_lattice(low, huge, 24, 0));
}

TEST_CASE("the maximum of a box has the last code", "[position_codec]") {
  std::mt19937 random(6);
  for (int round = 0; round < 20000; ++round) {
    const float a = std::bit_cast<float>(0x3f000000u + static_cast<uint32_t>(random() % 0x2000000u));
    const float b = -std::bit_cast<float>(0x3f000000u + static_cast<uint32_t>(random() % 0x2000000u));
    const float lo[3] = {b, a, b};
    const float hi[3] = {a, a + 1, b};
    const auto lattice = must(choose_lattice(lo, hi, 16, 0));
    for (size_t axis = 0; axis < 3; ++axis) {
      const int64_t last = quantize(hi[axis], lattice.exponent) - lattice.min[axis];
      const uint32_t bits = lattice.bits[axis];
      if (bits > 16 || last >= int64_t{1} << bits || (bits > 0 && last < int64_t{1} << (bits - 1)))
        FAIL("last code " << last << " in " << bits << " bits");
    }
  }
}

TEST_CASE("neighbouring meshes of similar size have equal border points", "[position_codec]") {
  std::mt19937 random(7);
  for (int round = 0; round < 2000; ++round) {
    const float width = 1.5f + static_cast<float>(random() % 100) / 1000;
    const float border = static_cast<float>(random() % 1000) / 7;
    const float point[3] = {border, static_cast<float>(random() % 1500) / 1000,
                            static_cast<float>(random() % 1500) / 1000};
    const float left_lo[3] = {border - width, 0, 0};
    const float left_hi[3] = {border, 1.5f, 1.5f};
    const float right_lo[3] = {border, 0, 0};
    const float right_hi[3] = {border + width, 1.5f, 1.5f};
    const auto left = must(choose_lattice(left_lo, left_hi, 16, 0));
    const auto right = must(choose_lattice(right_lo, right_hi, 16, 0));
    REQUIRE(left.exponent == right.exponent);
    std::array<uint32_t, 3> on_left, on_right;
    quantize_positions(on_left, point, left);
    quantize_positions(on_right, point, right);
    for (size_t axis = 0; axis < 3; ++axis)
      if (left.min[axis] + on_left[axis] != right.min[axis] + on_right[axis]) FAIL("a crack at " << point[axis]);
  }
}
