// Positions on textures: points in integers, their wrap modes and the texels around them, compared with the same rules
// in double precision (spec/rasterization.md 9).
#include "kernels/shade/texture.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>

#include "tests/catch.h"

using namespace scree;
using format::Wrap;
using kernels::TexelPair;
using kernels::texture_point;
using kernels::TexturePoint;

namespace {

constexpr TexturePoint kSide = TexturePoint{1} << 32;

/// The value at a point of a texture with texels cos(2 pi i / size), which has no jump at its border.
double value_at(const TexelPair& pair, uint32_t size) {
  const auto texel = [&](uint32_t i) { return std::cos(2 * std::numbers::pi * i / size); };
  const double weight = static_cast<double>(pair.weight);
  return texel(pair.first) * (1 - weight) + texel(pair.second) * weight;
}

double reference_at(double coordinate, uint32_t size, Wrap wrap) {
  double wrapped = coordinate - std::floor(coordinate);
  if (wrap == Wrap::kClamp) wrapped = std::clamp(coordinate, 0.0, 1.0);
  if (wrap == Wrap::kMirror) {
    const double period = coordinate - 2 * std::floor(coordinate / 2);
    wrapped = period > 1 ? 2 - period : period;
  }
  const double place = wrapped * size - 0.5;
  const auto index = [&](double texel) {
    if (wrap == Wrap::kRepeat) return static_cast<uint32_t>(texel < 0 ? size - 1.0 : texel >= size ? 0.0 : texel);
    return static_cast<uint32_t>(std::clamp(texel, 0.0, size - 1.0));
  };
  const double first = std::floor(place);
  return value_at({index(first), index(first + 1), static_cast<float>(place - first)}, size);
}

}  // namespace

TEST_CASE("points on textures are exact to 2^-32 for any number", "[texture]") {
  CHECK(texture_point(0.0) == 0);
  CHECK(texture_point(1.0) == kSide);
  CHECK(texture_point(-0.25) == TexturePoint{0} - kSide / 4);
  CHECK(texture_point(-1e-20) == 0);
  CHECK(texture_point(0x1p-33) == 1);
  CHECK(texture_point(0x1p50 + 0.5) == (TexturePoint{1} << 31));
  for (const double none : {0x1p51, -1e300, std::numeric_limits<double>::infinity(), std::nan("")})
    CHECK(texture_point(none) == 0);

  CHECK(texture_point(0.75f) == texture_point(0.75));
  CHECK(texture_point(-1234.5f) == texture_point(-1234.5));
  CHECK(texture_point(1e-20f) == 0);
  CHECK(texture_point(3e38f) == texture_point(8388608.0));
  CHECK(texture_point(-std::numeric_limits<float>::infinity()) == texture_point(-8388608.0));
  CHECK(texture_point(std::nanf("")) == texture_point(-8388608.0));

  CHECK(texture_point(int64_t{-3}, -2) == texture_point(-0.75));
  CHECK(texture_point(int64_t{1} << 51, -32) == TexturePoint{1} << 51);
  CHECK(texture_point(int64_t{5}, -33) == 3);
  CHECK(texture_point(int64_t{1}, -149) == 0);
  CHECK(texture_point(int64_t{7}, 31) == TexturePoint{7} << 63);
  CHECK(texture_point(int64_t{7}, 40) == texture_point(7 * 0x1p40));
}

TEST_CASE("the texels around a point are those of double precision", "[texture]") {
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> near(-2, 3);
  std::uniform_real_distribution<double> far(-1e5, 1e5);
  double worst = 0;
  for (const uint32_t size : {1u, 2u, 3u, 100u, 2048u, 65535u, 65536u}) {
    for (const Wrap wrap : {Wrap::kRepeat, Wrap::kMirror, Wrap::kClamp}) {
      for (int i = 0; i < 2000; ++i) {
        const double coordinate = i % 2 == 0 ? near(random) : i % 4 == 1 ? far(random) : i / 4 * 0.25 - 100;
        const uint32_t wrapped = kernels::wrap_point(texture_point(coordinate), wrap);
        const TexelPair pair = kernels::texel_pair(wrapped, size, wrap);
        REQUIRE(std::max(pair.first, pair.second) < size);
        REQUIRE((pair.weight >= 0 && pair.weight <= 1));
        worst = std::max(worst, std::abs(value_at(pair, size) - reference_at(coordinate, size, wrap)));
      }
    }
  }
  CHECK(worst < 2e-7);
  // The centres of texels are exact.
  for (uint32_t i = 0; i < 256; ++i) {
    const TexelPair pair =
        kernels::texel_pair(kernels::wrap_point(texture_point((i + 0.5) / 256), Wrap::kRepeat), 256, Wrap::kRepeat);
    CHECK((pair.first == i && pair.weight == 0));
  }
}
