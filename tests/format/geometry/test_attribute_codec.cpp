#include "format/geometry/attribute_codec.h"

#include <algorithm>
#include <cfloat>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "tests/format/geometry/spec_vectors.h"
#include "tests/format/geometry/stream_checks.h"
#include "tests/results.h"

using namespace scree::format;
using namespace scree::tests;

namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInfinity = std::numeric_limits<float>::infinity();
constexpr double kDegrees = 57.29577951308232;

std::vector<std::byte> encode(const std::vector<float>& uvs, const UvRange& range) {
  return encoded(uv_stream_bytes(uvs.size() / 2, range), [&](auto out) { encode_uvs(out, uvs, range); });
}

std::vector<std::byte> encode(const std::vector<float>& normals, uint32_t bits) {
  return encoded(normal_stream_bytes(normals.size() / 3, bits), [&](auto out) { encode_normals(out, normals, bits); });
}

std::vector<std::byte> encode(const std::vector<uint64_t>& ids, const SourceIdRange& range) {
  return encoded(packed_bytes(ids.size(), range.bits), [&](auto out) { encode_source_ids(out, ids, range); });
}

/// Degrees between two vectors of any length; accurate for small angles too.
double angle(const float* a, const float* b) {
  const double x = static_cast<double>(a[1]) * b[2] - static_cast<double>(a[2]) * b[1];
  const double y = static_cast<double>(a[2]) * b[0] - static_cast<double>(a[0]) * b[2];
  const double z = static_cast<double>(a[0]) * b[1] - static_cast<double>(a[1]) * b[0];
  const double dot =
      static_cast<double>(a[0]) * b[0] + static_cast<double>(a[1]) * b[1] + static_cast<double>(a[2]) * b[2];
  return std::atan2(std::sqrt(x * x + y * y + z * z), dot) * kDegrees;
}

std::vector<float> gaussian(std::mt19937& random, size_t count) {
  std::normal_distribution<float> gauss;
  std::vector<float> values(count);
  for (float& value : values) value = gauss(random);
  return values;
}

}  // namespace

TEST_CASE("texture coordinate streams of the spec", "[attribute_codec][spec]") {
  for (const auto& vector : scree::tests::spec_vectors("uvs.txt")) {
    INFO(vector.text("name"));
    const auto uvs = vector.floats("uvs");
    const UvRange range = choose_uv_range(uvs);
    CHECK(range.exponent == vector.integer<int32_t>("exponent"));
    const auto min = vector.integers<int64_t>("min");
    const auto bits = vector.integers<uint8_t>("bits");
    CHECK(std::equal(min.begin(), min.end(), range.min.begin()));
    CHECK(std::equal(bits.begin(), bits.end(), range.bits.begin()));
    const auto bytes = vector.bytes("bytes");
    CHECK(encode(uvs, range) == bytes);
    std::vector<float> decoded(uvs.size());
    CHECK(outcome(decode_uvs(decoded, range, bytes)) == "ok");
    CHECK(decoded == vector.floats("decoded"));
  }
}

TEST_CASE("colour streams of the spec", "[attribute_codec][spec]") {
  for (const auto& vector : scree::tests::spec_vectors("colors.txt")) {
    INFO(vector.text("name"));
    const auto rgba = vector.floats("rgba");
    const auto bytes = vector.bytes("bytes");
    CHECK(encoded(color_stream_bytes(rgba.size() / 4), [&](auto out) { encode_colors(out, rgba); }) == bytes);
    std::vector<float> decoded(rgba.size());
    CHECK(outcome(decode_colors(decoded, bytes)) == "ok");
    CHECK(decoded == vector.floats("decoded"));
  }
}

TEST_CASE("normal streams of the spec", "[attribute_codec][spec]") {
  for (const auto& vector : scree::tests::spec_vectors("normals.txt")) {
    INFO(vector.text("name"));
    const auto bits = vector.integer<uint32_t>("bits");
    const auto codes = vector.integers<uint32_t>("codes");
    const auto bytes = vector.bytes("bytes");
    std::vector<float> decoded(codes.size() / 2 * 3);
    const std::string expected = vector.has("error") ? vector.text("error") : "ok";
    CHECK(outcome(decode_normals(decoded, bits, bytes)) == expected);
    CHECK(outcome(check_normals(codes.size() / 2, bits, bytes)) == expected);
    for (size_t i = 0; i < codes.size(); ++i) CHECK(unpack(bytes.data(), i * bits, bits) == codes[i]);
    if (expected != "ok") continue;
    CHECK(encode(vector.floats("normals"), bits) == bytes);
    CHECK(decoded == vector.floats("decoded"));
  }
}

TEST_CASE("source number streams of the spec", "[attribute_codec][spec]") {
  for (const auto& vector : scree::tests::spec_vectors("source_ids.txt")) {
    INFO(vector.text("name"));
    const SourceIdRange range{vector.integer<uint64_t>("min"), vector.integer<uint32_t>("bits")};
    const auto bytes = vector.bytes("bytes");
    std::vector<uint64_t> decoded(vector.integer<size_t>("count"));
    const std::string expected = vector.has("error") ? vector.text("error") : "ok";
    CHECK(outcome(decode_source_ids(decoded, range, bytes)) == expected);
    CHECK(outcome(check_source_ids(decoded.size(), range, bytes)) == expected);
    if (expected != "ok") continue;
    const auto ids = vector.integers<uint64_t>("ids");
    CHECK(decoded == ids);
    CHECK(source_id_range(ids).min == range.min);
    CHECK(source_id_range(ids).bits == range.bits);
    CHECK(encode(ids, range) == bytes);
  }
}

TEST_CASE("texture coordinates keep their error at every scale", "[attribute_codec][uv]") {
  std::mt19937 random(1);
  for (int round = 0; round < 6000; ++round) {
    const size_t count = 1 + random() % 20;
    const int scale = static_cast<int>(random() % 277) - 149;
    std::vector<float> uvs(2 * count);
    for (size_t i = 0; i < uvs.size(); ++i) {
      const double value = std::ldexp(static_cast<double>(random()) * 0x1p-31 - 1, random() % 3 ? scale : scale - 20);
      uvs[i] = std::clamp(static_cast<float>(value), -FLT_MAX, FLT_MAX);
      if (i % 2 == 1 && round % 7 == 0) uvs[i] = uvs[1];  // flat
    }
    const UvRange range = choose_uv_range(uvs);
    const auto bytes = encode(uvs, range);
    std::vector<float> decoded(uvs.size());
    must(decode_uvs(decoded, range, bytes));
    for (size_t i = 0; i < uvs.size(); ++i) {
      const double error = std::fabs(static_cast<double>(decoded[i]) - static_cast<double>(uvs[i]));
      if (!(error <= uv_error_bound(range))) FAIL(uvs[i] << " became " << decoded[i] << " at 2^" << range.exponent);
    }
    // 16 bits over the wider axis. Its step is at most 2^-15, as far as 24 bits and the precision of floats allow.
    const uint8_t widest = std::max(range.bits[0], range.bits[1]);
    if (range.exponent > -15 && widest < 24 && decoded != uvs) FAIL(int{widest} << " bits at 2^" << range.exponent);
    if (range.exponent < -15 && widest > 16) FAIL(int{widest} << " bits at 2^" << range.exponent);
  }
}

TEST_CASE("the largest texture coordinates stay finite", "[attribute_codec][uv]") {
  const std::vector<float> uvs{-FLT_MAX, FLT_MAX, FLT_MAX, 0, 0x1p127f, -FLT_MAX};
  for (const uint32_t bits : {1u, 8u, 16u, 24u}) {
    const UvRange range = choose_uv_range(uvs, bits);
    std::vector<float> decoded(uvs.size());
    REQUIRE(outcome(decode_uvs(decoded, range, encode(uvs, range))) == "ok");
    for (size_t i = 0; i < uvs.size(); ++i) {
      CHECK(std::isfinite(decoded[i]));
      CHECK(std::fabs(static_cast<double>(decoded[i]) - static_cast<double>(uvs[i])) <= uv_error_bound(range));
    }
  }
}

TEST_CASE("texture coordinates survive every width and length", "[attribute_codec][uv]") {
  std::mt19937 random(2);
  for (uint8_t u_bits = 0; u_bits <= 24; ++u_bits) {
    for (const uint8_t v_bits : {uint8_t{0}, uint8_t{1}, uint8_t{16}, uint8_t{24}}) {
      for (const size_t count : {0, 1, 7, 8, 9, 33}) {
        const UvRange range{.exponent = -12, .min = {-77, 4096}, .bits = {u_bits, v_bits}};
        std::vector<float> uvs(2 * count);
        for (size_t i = 0; i < uvs.size(); ++i) {
          const int64_t code = random() & ((1u << range.bits[i % 2]) - 1);
          uvs[i] = dequantize(range.min[i % 2] + code, range.exponent);
        }
        std::vector<float> decoded(uvs.size());
        if (!decode_uvs(decoded, range, encode(uvs, range)) || decoded != uvs)
          FAIL(int{u_bits} << " and " << int{v_bits} << " bits, " << count);
      }
    }
  }
}

TEST_CASE("a texture coordinate decoder stays inside its bytes and checks its range", "[attribute_codec][uv]") {
  const std::vector<float> uvs{0.1f, 0.9f, 0.5f, -0.25f, 0.75f, 0.125f};
  const UvRange range = choose_uv_range(uvs);
  const auto bytes = encode(uvs, range);
  check_stream_limits(bytes, 3 * range.stride_bits(), [&](std::span<const std::byte> stream) {
    std::vector<float> out(6);
    return decode_uvs(out, range, stream);
  });
  check_stream_limits(bytes, 3 * range.stride_bits(),
                      [&](std::span<const std::byte> stream) { return check_uvs(3, range, stream); });
  std::vector<float> out(6);
  const auto both = [&](const UvRange& with) {
    return outcome_of_both(decode_uvs(out, with, bytes), check_uvs(3, with, bytes));
  };
  CHECK(both(range) == "ok");
  UvRange changed = range;
  for (const uint8_t bits : {uint8_t{25}, uint8_t{32}, uint8_t{64}, uint8_t{255}}) {
    changed.bits = {range.bits[0], bits};
    CHECK(both(changed) == "range");
  }
  changed = range;
  for (const int64_t min : {std::numeric_limits<int64_t>::min(), -kLatticeLimit, kLatticeLimit}) {
    changed.min = {min, 0};
    CHECK(both(changed) == "range");
  }
  for (const int32_t exponent : {std::numeric_limits<int32_t>::min(), -150, 127, std::numeric_limits<int32_t>::max()}) {
    changed = range;
    changed.exponent = exponent;
    CHECK(both(changed) == "range");
  }
  CHECK(outcome(check_uvs(uint64_t{1} << 60, range, bytes)) == "range");
}

TEST_CASE("random bytes and ranges never take a texture coordinate decoder past its limits", "[attribute_codec][uv]") {
  std::mt19937_64 random(7);
  int accepted = 0;
  for (int round = 0; round < 10000; ++round) {
    const size_t count = random() % 12;
    UvRange range{.exponent =
                      random() % 8 == 0 ? static_cast<int32_t>(random()) : static_cast<int32_t>(random() % 281) - 151};
    for (size_t axis = 0; axis < 2; ++axis) {
      range.min[axis] = static_cast<int64_t>(random()) >> (random() % 8 == 0 ? 0 : 12 + random() % 52);
      range.bits[axis] = static_cast<uint8_t>(random() % 8 == 0 ? random() : random() % 26);
    }
    GuardedBytes guarded(uv_stream_bytes(count, range) + (random() % 8 == 0 ? random() % 3 : 0));
    for (uint64_t bit = 0; bit < count * range.stride_bits(); ++bit)
      if (random() % 2) guarded.bytes()[bit / 8] |= std::byte{1} << (bit % 8);
    std::vector<float> out(2 * count);
    const auto decoded = decode_uvs(out, range, guarded.bytes());
    const auto checked = check_uvs(count, range, guarded.bytes());
    if (outcome(decoded) != outcome(checked)) FAIL(outcome(decoded) << " but the check returns " << outcome(checked));
    if (!decoded) continue;
    ++accepted;
    for (const float value : out)
      if (!std::isfinite(value)) FAIL("a texture coordinate that is not finite");
  }
  CHECK(accepted > 1000);
}

TEST_CASE("colours are rounded to the nearest of 256 values", "[attribute_codec][color]") {
  std::vector<float> all(256);
  for (size_t i = 0; i < all.size(); ++i) all[i] = static_cast<float>(i) / 255.0f;
  const auto bytes = encoded(color_stream_bytes(64), [&](auto out) { encode_colors(out, all); });
  for (size_t i = 0; i < all.size(); ++i) CHECK(std::to_integer<size_t>(bytes[i]) == i);
  std::vector<float> decoded(all.size());
  REQUIRE(decode_colors(decoded, bytes));
  CHECK(decoded == all);

  std::mt19937 random(3);
  std::vector<float> colors(4 * 1001);
  for (float& value : colors) value = static_cast<float>(random()) * 0x1p-32f;
  decoded.resize(colors.size());
  REQUIRE(decode_colors(decoded, encoded(color_stream_bytes(1001), [&](auto out) { encode_colors(out, colors); })));
  for (size_t i = 0; i < colors.size(); ++i)
    if (std::fabs(decoded[i] - colors[i]) > 0.5 / 255 + 1e-7) FAIL(colors[i] << " became " << decoded[i]);

  const std::vector<float> odd{kNan, kInfinity, -kInfinity, -0.0f, 1e30f, -1e30f, FLT_TRUE_MIN, 1.0000001f};
  decoded.resize(odd.size());
  REQUIRE(decode_colors(decoded, encoded(color_stream_bytes(2), [&](auto out) { encode_colors(out, odd); })));
  CHECK(decoded == std::vector<float>{0, 1, 0, 0, 1, 0, 0, 1});
}

TEST_CASE("a colour decoder stays inside its bytes", "[attribute_codec][color]") {
  for (const size_t count : {1, 3, 4, 5}) {
    const std::vector<float> colors(4 * count, 0.7f);
    const auto bytes = encoded(color_stream_bytes(count), [&](auto out) { encode_colors(out, colors); });
    CHECK(bytes.size() == (count + 3) / 4 * 16);
    check_stream_limits(bytes, 32 * count, [&](std::span<const std::byte> stream) {
      std::vector<float> out(4 * count);
      return decode_colors(out, stream);
    });
  }
  CHECK(outcome(decode_colors({}, {})) == "ok");
  CHECK(outcome(check_colors(uint64_t{1} << 62, {})) == "range");
}

TEST_CASE("normals keep the angle stated in the spec", "[attribute_codec][normal]") {
  // Degrees, spec/codecs.md: measured over 2 million directions, rounded up.
  const double stated[] = {54.8, 22.4, 11.5, 5.4, 2.7, 1.3, 0.64, 0.32, 0.16, 0.08, 0.04, 0.02, 0.01, 0.005, 0.0025};
  std::mt19937 random(4);
  const std::vector<float> normals = gaussian(random, 3 * 20000);
  for (uint32_t bits = 2; bits <= 16; ++bits) {
    std::vector<float> decoded(normals.size());
    REQUIRE(decode_normals(decoded, bits, encode(normals, bits)));
    double worst = 0, longest = 0;
    for (size_t i = 0; i < normals.size(); i += 3) {
      worst = std::max(worst, angle(&normals[i], &decoded[i]));
      const double square = static_cast<double>(decoded[i]) * decoded[i] +
                            static_cast<double>(decoded[i + 1]) * decoded[i + 1] +
                            static_cast<double>(decoded[i + 2]) * decoded[i + 2];
      longest = std::max(longest, std::fabs(square - 1));
    }
    INFO(bits << " bits");
    CHECK(worst <= stated[bits - 2]);
    CHECK(worst > stated[bits - 2] / 2);  // the table is not much looser than needed
    CHECK(longest < 4e-7);
  }
}

TEST_CASE("every normal code decodes to a unit vector and encodes to itself or its twin", "[attribute_codec][normal]") {
  for (const uint32_t bits : {2u, 3u, 5u, 8u}) {
    const uint32_t last = (1u << bits) - 2;
    for (uint32_t v = 0; v <= last; ++v) {
      for (uint32_t u = 0; u <= last; ++u) {
        std::vector<float> normal(3);
        decode_octahedral(u, v, bits, normal.data());
        std::vector<float> again(3);
        REQUIRE(decode_normals(again, bits, encode(normal, bits)));
        if (again != normal) FAIL(bits << " bits, codes " << u << " " << v);
      }
    }
  }
}

TEST_CASE("normals encoded four at a time have the codes of normals encoded alone", "[attribute_codec][normal]") {
  std::mt19937 random(11);
  std::vector<float> normals = gaussian(random, 3 * 20000);
  constexpr float kOdd[] = {0.0f, -0.0f, 1.0f, -1.0f, 0.5f, 1e-45f, 3e38f, -3e38f, kInfinity, kNan};
  for (const float x : kOdd)
    for (const float y : kOdd)
      for (const float z : kOdd) normals.insert(normals.end(), {x, y, z});
  for (int i = 0; i < 3000; ++i) {  // on axes, planes and diagonals, where several candidates are equally near
    const auto step = [&] { return static_cast<float>(static_cast<int>(random() % 9) - 4); };
    normals.insert(normals.end(), {step(), step(), step()});
  }
  for (const uint32_t bits : {2u, 3u, 8u, 12u, 16u}) {
    const std::vector<std::byte> together = encode(normals, bits);
    std::vector<float> some(normals.size()), one(3);
    REQUIRE(decode_normals(some, bits, together));
    for (size_t i = 0; i < normals.size(); i += 3) {  // some have fewer than four, which are encoded one by one
      REQUIRE(decode_normals(one, bits, encode({normals[i], normals[i + 1], normals[i + 2]}, bits)));
      if (one != std::vector<float>{some[i], some[i + 1], some[i + 2]}) FAIL("bits " << bits << ", normal " << i / 3);
    }
  }
}

TEST_CASE("normals: the axes are exact, any length is allowed, and no direction becomes +z",
          "[attribute_codec][normal]") {
  for (uint32_t bits = 2; bits <= 16; ++bits) {
    const std::vector<float> axes{1, 0, 0, -1, 0, 0, 0, 1, 0, 0, -1, 0, 0, 0, 1, 0, 0, -1};
    std::vector<float> decoded(axes.size());
    REQUIRE(decode_normals(decoded, bits, encode(axes, bits)));
    CHECK(decoded == axes);
    const std::vector<float> odd{0, 0, 0, -0.0f, 0, -0.0f, kNan, 0, -1, 1, kInfinity, 0, 0, -kInfinity, 0};
    decoded.resize(odd.size());
    REQUIRE(decode_normals(decoded, bits, encode(odd, bits)));
    for (size_t i = 0; i < odd.size(); ++i) CHECK(decoded[i] == (i % 3 == 2 ? 1.0f : 0.0f));
  }
  for (const float length : {FLT_TRUE_MIN, 1e-30f, 1e30f, FLT_MAX}) {
    const std::vector<float> normal{length, -length, length};
    const std::vector<float> unit{1, -1, 1};
    CHECK(encode(normal, 12) == encode(unit, 12));
  }
}

TEST_CASE("a normal decoder stays inside its bytes and checks its codes", "[attribute_codec][normal]") {
  std::mt19937 random(5);
  for (const uint32_t bits : {2u, 7u, 8u, 16u}) {
    for (const size_t count : {1, 8, 9, 50}) {
      const auto bytes = encode(gaussian(random, 3 * count), bits);
      check_stream_limits(bytes, 2 * bits * count, [&](std::span<const std::byte> stream) {
        std::vector<float> out(3 * count);
        return decode_normals(out, bits, stream);
      });
      std::vector<float> out(3 * count);
      for (size_t code = 0; code < 2 * count; ++code) {
        GuardedBytes changed(bytes);
        for (size_t bit = code * bits; bit < (code + 1) * bits; ++bit)
          changed.bytes()[bit / 8] |= std::byte{1} << (bit % 8);  // all ones
        if (outcome(decode_normals(out, bits, changed.bytes())) != "range") FAIL("decoding code " << code);
        if (outcome(check_normals(count, bits, changed.bytes())) != "range") FAIL("checking code " << code);
      }
      for (const uint32_t wrong : {0u, 1u, 17u, 32u, 0x80000000u, 0xffffffffu}) {
        CHECK(outcome(decode_normals(out, wrong, bytes)) == "range");
        CHECK(outcome(check_normals(count, wrong, bytes)) == "range");
      }
    }
  }
  CHECK(outcome(check_normals(uint64_t{1} << 59, 16, {})) == "range");
  CHECK(outcome(decode_normals({}, 8, {})) == "ok");
}

TEST_CASE("source numbers survive every width and length", "[attribute_codec][source_ids]") {
  std::mt19937_64 random(6);
  for (uint32_t bits = 0; bits <= 32; ++bits) {
    for (const size_t count : {0, 1, 7, 8, 9, 64, 65}) {
      const uint64_t mask = (uint64_t{1} << bits) - 1;
      const SourceIdRange range{random() >> (random() % 40 + 1), bits};
      std::vector<uint64_t> ids(count);
      for (uint64_t& id : ids) id = range.min + (random() & mask);
      const SourceIdRange tight = source_id_range(ids);
      std::vector<uint64_t> decoded(count);
      if (tight.bits > bits || !decode_source_ids(decoded, range, encode(ids, range)) || decoded != ids ||
          !decode_source_ids(decoded, tight, encode(ids, tight)) || decoded != ids) {
        FAIL(bits << " bits, " << count);
      }
    }
  }
}

TEST_CASE("a source number decoder stays inside its bytes and checks its range", "[attribute_codec][source_ids]") {
  const std::vector<uint64_t> ids{100, 107, 103};
  const SourceIdRange range = source_id_range(ids);
  const auto bytes = encode(ids, range);
  check_stream_limits(bytes, 9, [&](std::span<const std::byte> stream) {
    std::vector<uint64_t> out(3);
    return decode_source_ids(out, range, stream);
  });
  check_stream_limits(bytes, 9, [&](std::span<const std::byte> stream) { return check_source_ids(3, range, stream); });
  std::vector<uint64_t> out(3);
  for (const uint32_t bits : {33u, 64u, 0xffffffffu}) {
    CHECK(outcome(decode_source_ids(out, {100, bits}, bytes)) == "range");
    CHECK(outcome(check_source_ids(3, {100, bits}, bytes)) == "range");
  }
  const uint64_t last = std::numeric_limits<uint64_t>::max();
  CHECK(outcome(decode_source_ids(out, {last - 7, 3}, bytes)) == "ok");
  CHECK(outcome(check_source_ids(3, {last - 7, 3}, bytes)) == "ok");
  CHECK(outcome(decode_source_ids(out, {last - 6, 3}, bytes)) == "range");
  CHECK(outcome(check_source_ids(3, {last - 6, 3}, bytes)) == "range");
  CHECK(outcome(check_source_ids(uint64_t{1} << 62, {0, 3}, bytes)) == "range");
}
