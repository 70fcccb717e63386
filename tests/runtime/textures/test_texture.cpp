#include "runtime/textures/texture.h"

#include <array>
#include <cmath>
#include <map>
#include <random>

#include "runtime/textures/srgb.h"
#include "tests/catch.h"

using namespace scree;
using namespace scree::runtime;
using namespace scree::tests;

namespace {

Image picture(uint32_t width, uint32_t height) {
  Image image{.width = width, .height = height};
  image.rgba.resize(size_t{4} * width * height);
  return image;
}

double curve(double linear) {
  return linear <= 0.0031308 ? linear * 12.92 : 1.055 * std::pow(linear, 1.0 / 2.4) - 0.055;
}

std::array<double, 4> mean_of_level(const MipChain& chain, uint32_t level) {
  const uint32_t width = std::max(1u, chain.width >> level);
  const uint32_t height = std::max(1u, chain.height >> level);
  std::array<double, 4> sum{};
  for (size_t i = 0; i < size_t{width} * height; ++i) {
    const uint8_t* const texel = chain.texels.data() + 4 * (chain.level_offset[level] + i);
    for (size_t c = 0; c < 3; ++c) sum[c] += linear_of_srgb(texel[c]);
    sum[3] += texel[3] / 255.0;
  }
  for (double& value : sum) value /= double(width) * height;
  return sum;
}

}  // namespace

TEST_CASE("sRGB codes are kept through linear light, and light gets the nearest code", "[texture]") {
  for (unsigned code = 0; code < 256; ++code) CHECK(srgb_of_linear(linear_of_srgb(static_cast<uint8_t>(code))) == code);
  size_t wrong = 0;
  for (int i = 0; i <= 200000; ++i) {
    const float linear = static_cast<float>(i) / 200000.0f;
    const double exact = curve(linear) * 255.0;
    // The two published constants differ by 1e-3.
    if (std::abs(exact - srgb_of_linear(linear)) > 0.5 + 1e-3) ++wrong;
  }
  CHECK(wrong == 0);
  CHECK(srgb_of_linear(-1.0f) == 0);
  CHECK(srgb_of_linear(2.0f) == 255);
  CHECK(srgb_of_linear(std::nanf("")) == 0);
  CHECK(srgb_of_linear(std::nextafter(1.0f, 0.0f)) == 255);
}

TEST_CASE("a picture of one colour has levels of that colour", "[texture]") {
  for (const auto& [width, height] : {std::array{1u, 1u}, std::array{2u, 2u}, std::array{3u, 3u}, std::array{7u, 13u},
                                      std::array{1u, 9u}, std::array{127u, 1u}, std::array{640u, 3u}}) {
    Image image = picture(width, height);
    const std::array<uint8_t, 4> colour{200, 3, 77, 129};
    for (size_t i = 0; i < image.rgba.size(); ++i) image.rgba[i] = colour[i % 4];
    const MipChain chain = make_mips(std::move(image));
    CHECK(chain.level_count == 1 + static_cast<uint32_t>(std::log2(std::max(width, height))));
    bool same = true;
    for (size_t i = 0; i < chain.texels.size(); ++i) same &= chain.texels[i] == colour[i % 4];
    CHECK(same);
  }
}

TEST_CASE("a texture's filters are glTF's", "[texture]") {
  const MipChain chain = make_mips(picture(8, 8));
  // By minFilter: nearest texel, nearest level alone, level 0 alone.
  const std::map<uint16_t, std::array<bool, 3>> minified{{0, {false, false, false}},   {9728, {true, false, true}},
                                                         {9729, {false, false, true}}, {9984, {true, true, false}},
                                                         {9985, {false, true, false}}, {9986, {true, false, false}},
                                                         {9987, {false, false, false}}};
  for (const uint16_t mag : std::array<uint16_t, 3>{0, 9728, 9729}) {
    for (const auto& [min, expected] : minified) {
      INFO(mag << " and " << min);
      constexpr auto kRepeat = scree::format::Wrap::kRepeat;
      const auto view = scree::runtime::texture_view(chain, {0, 0, kRepeat, kRepeat, mag, min});
      CHECK(view.magnified_nearest == (mag == 9728));
      CHECK((std::array{view.minified_nearest, view.one_level, view.finest_level} == expected));
    }
  }
}

TEST_CASE("all levels of a picture have the same mean, even of odd sizes", "[texture]") {
  std::mt19937 random(5);
  for (const auto& [width, height] :
       {std::array{64u, 64u}, std::array{63u, 65u}, std::array{5u, 3u}, std::array{255u, 31u}}) {
    Image image = picture(width, height);
    for (uint8_t& byte : image.rgba) byte = static_cast<uint8_t>(random());
    const MipChain chain = make_mips(std::move(image));
    const std::array<double, 4> mean = mean_of_level(chain, 0);
    for (uint32_t level = 1; level < chain.level_count; ++level)
      for (size_t c = 0; c < 4; ++c) CHECK(mean_of_level(chain, level)[c] == Approx(mean[c]).margin(0.004));
  }
}

TEST_CASE("black and white average to half the light, not to half the code", "[texture]") {
  Image image = picture(2, 1);
  for (size_t c = 0; c < 4; ++c) image.rgba[4 + c] = 255;
  const MipChain chain = make_mips(std::move(image));
  REQUIRE(chain.level_count == 2);
  CHECK(chain.texels[8] == 188);
  CHECK(chain.texels[11] == 128);
}

TEST_CASE("the last column and row of an odd picture have their share of the mean", "[texture]") {
  Image image = picture(3, 1);
  for (size_t c = 0; c < 4; ++c) image.rgba[8 + c] = 255;  // only the last texel is white
  const MipChain chain = make_mips(std::move(image));
  REQUIRE(chain.level_count == 2);
  CHECK(chain.texels[12] == srgb_of_linear(1.0f / 3.0f));
  CHECK(chain.texels[15] == 85);
}
