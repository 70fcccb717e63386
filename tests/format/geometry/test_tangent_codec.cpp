#include "format/geometry/tangent_codec.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "format/bitpack.h"
#include "format/geometry/attribute_codec.h"
#include "format/layout.h"
#include "format/vec3.h"
#include "tests/format/geometry/spec_vectors.h"
#include "tests/format/geometry/stream_checks.h"
#include "tests/results.h"

using namespace scree;
using namespace scree::format;
using namespace scree::tests;

namespace {

std::vector<std::byte> encode(const std::vector<float>& tangents, const std::vector<float>& normals, uint32_t bits) {
  return encoded(tangent_stream_bytes(tangents.size() / 4, bits),
                 [&](auto out) { encode_tangents(out, tangents, normals, bits); });
}

Vec3 wide(const float* values) {
  return {double{values[0]}, double{values[1]}, double{values[2]}};
}

}  // namespace

TEST_CASE("tangent streams of the spec", "[tangent_codec][spec]") {
  size_t seen = 0;
  for (const auto& vector : scree::tests::spec_vectors("tangents.txt")) {
    INFO(vector.text("name"));
    const auto bits = vector.integer<uint32_t>("bits");
    const auto codes = vector.integers<uint32_t>("codes");
    const auto bytes = vector.bytes("bytes");
    const auto normals = vector.floats("normals");
    CHECK(encode(vector.floats("tangents"), normals, bits) == bytes);
    for (size_t i = 0; i < codes.size(); ++i) CHECK(unpack(bytes.data(), i * bits, bits) == codes[i]);
    std::vector<float> decoded(4 * codes.size());
    CHECK(outcome(decode_tangents(decoded, normals, bits, bytes)) == "ok");
    CHECK(decoded == vector.floats("decoded"));
    ++seen;
  }
  CHECK(seen == 4);
}

TEST_CASE("tangents keep their angle and their sign", "[tangent_codec]") {
  std::mt19937 random(3);
  std::normal_distribution<float> gauss;
  for (const uint32_t bits : {3u, 4u, 8u, 12u, 16u}) {
    const size_t count = 4000;
    std::vector<float> normals(3 * count), tangents(4 * count);
    for (float& value : normals) value = gauss(random);
    for (float& value : tangents) value = gauss(random);
    std::fill_n(normals.begin(), 2, 0.0f);  // the two poles, where the axes change sides
    normals[2] = 1;
    std::fill_n(normals.begin() + 3, 2, 0.0f);
    normals[5] = -1;
    std::vector<std::byte> stream(normal_stream_bytes(count, 12));
    encode_normals(stream, normals, 12);
    REQUIRE(decode_normals(normals, 12, stream));
    std::vector<float> decoded(4 * count);
    REQUIRE(decode_tangents(decoded, normals, bits, encode(tangents, normals, bits)));
    double worst = 0;
    for (size_t i = 0; i < count; ++i) {
      const Vec3 n = wide(&normals[3 * i]), t = wide(&tangents[4 * i]), d = wide(&decoded[4 * i]);
      REQUIRE(dot(d, d) == Approx(1).epsilon(1e-6));
      REQUIRE(std::abs(dot(d, n)) < 1e-6);
      REQUIRE(decoded[4 * i + 3] == (tangents[4 * i + 3] < 0 ? -1.0f : 1.0f));
      // The angle around the normal.
      worst = std::max(worst, std::abs(std::atan2(dot(n, cross(d, t)), dot(d, t))));
    }
    CAPTURE(bits);
    CHECK(worst <= std::exp2(3.0 - bits) * 1.0001 + 1e-6);
    CHECK(worst > std::exp2(3.0 - bits) * 0.75);  // the bound is not much larger than needed
  }
  CHECK(std::exp2(3.0 - 12) * 57.29578 < 0.112);
}

TEST_CASE("tangents without a direction are counted", "[tangent_codec]") {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  const std::vector<float> normals{0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1};
  const std::vector<float> tangents{0, 0, 0, 1, 0, 0, -3, 1, kNan, 1, 0, 1, 1, 0, 5, -1};
  std::vector<std::byte> bytes(tangent_stream_bytes(4, 12));
  CHECK(encode_tangents(bytes, tangents, normals, 12) == 3);
}

TEST_CASE("a tangent decoder stays inside its bytes and checks its width", "[tangent_codec]") {
  const std::vector<float> normals{0, 0, 1, 0, 1, 0, 1, 0, 0};
  const std::vector<float> tangents{1, 0, 0, 1, 1, 0, 0, -1, 0, 1, 0, 1};
  const auto bytes = encode(tangents, normals, 11);
  const auto decode = [&](std::span<const std::byte> stream) {
    std::vector<float> out(12);
    return decode_tangents(out, normals, 11, stream);
  };
  check_stream_limits(bytes, 33, decode);
  check_stream_limits(bytes, 33, [&](std::span<const std::byte> stream) { return check_tangents(3, 11, stream); });
  for (const uint32_t bits : {0u, 2u, 17u, 255u}) CHECK(outcome(check_tangents(3, bits, bytes)) == "range");
  CHECK(outcome(check_tangents(uint64_t{1} << 61, 11, bytes)) == "range");
}

TEST_CASE("second texture coordinates store the rest of their range in a header", "[attribute_codec][uv]") {
  const std::vector<float> uvs{0.1f, 0.9f, 0.5f, -0.25f, 0.75f, 0.125f};
  const UvRange range = choose_uv_range(uvs);
  std::vector<std::byte> bytes(second_uv_stream_bytes(3, range));
  encode_second_uvs(bytes, uvs, range);
  std::span<const std::byte> codes = bytes;
  const auto opened = must(open_second_uvs(range.bits.data(), codes));
  CHECK(opened.exponent == range.exponent);
  CHECK(opened.min == range.min);
  CHECK(opened.bits == range.bits);
  std::vector<float> second(6), first(6);
  REQUIRE(decode_uvs(second, opened, codes));
  std::vector<std::byte> plain(uv_stream_bytes(3, range));
  encode_uvs(plain, uvs, range);
  REQUIRE(decode_uvs(first, range, plain));
  CHECK(second == first);

  for (size_t size = 0; size < sizeof(SecondUvHeader); ++size) {
    GuardedBytes guarded(std::span<const std::byte>(bytes).first(size));
    std::span<const std::byte> cut = guarded.bytes();
    CHECK(outcome(open_second_uvs(range.bits.data(), cut)) == "truncated");
  }
  for (size_t byte = offsetof(SecondUvHeader, reserved); byte < sizeof(SecondUvHeader); ++byte) {
    std::vector<std::byte> set = bytes;
    set[byte] = std::byte{1};
    std::span<const std::byte> at = set;
    CHECK(outcome(open_second_uvs(range.bits.data(), at)) == "reserved");
  }
}
