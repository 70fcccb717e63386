#include "runtime/images/png_writer.h"

#include <cmath>
#include <filesystem>
#include <vector>

#include "runtime/images/image.h"
#include "tests/results.h"
#include "tests/tools/temp_folder.h"

using namespace scree;
using namespace scree::runtime;
using namespace scree::tests;

namespace {

/// Waves, noise and flat rows, so that each filter is the best one somewhere.
std::vector<uint8_t> make_pixels(uint32_t width, uint32_t height, uint32_t channels) {
  std::vector<uint8_t> out;
  uint32_t state = 1;
  for (uint32_t y = 0; y < height; ++y)
    for (uint32_t x = 0; x < width; ++x)
      for (uint32_t c = 0; c < channels; ++c) {
        state = state * 1664525u + 1013904223u;
        const double wave = 127 + 90 * std::sin(0.02 * x + 0.05 * y * (c + 1));
        out.push_back(static_cast<uint8_t>(y / 16 % 3 == 0 ? wave : y / 16 % 3 == 1 ? wave + (state >> 29) : 7 * c));
      }
  return out;
}

/// Compares every pixel of a PNG with `picture`.
void check_pixels(const PixelView& picture, bool has_alpha, const std::vector<std::byte>& file) {
  const Image image = must(scree::runtime::decode_image(file));
  CHECK(image.warning.empty());
  REQUIRE(image.width == picture.width);
  REQUIRE(image.height == picture.height);
  uint64_t wrong = 0;
  for (size_t i = 0; i < size_t{picture.width} * picture.height; ++i)
    for (size_t c = 0; c < 4; ++c) {
      const bool is_stored = c < 3 || (picture.channels == 4 && has_alpha);
      const uint8_t expected = is_stored ? picture.bytes[picture.channels * i + c] : uint8_t{255};
      wrong += image.rgba[4 * i + c] != expected ? 1 : 0;
    }
  CHECK(wrong == 0);
}

}  // namespace

TEST_CASE("a PNG in strips has every pixel, whatever the threads", "[image][png]") {
  Workers one(1), three(3);
  const uint32_t channels = GENERATE(3u, 4u);
  const bool has_alpha = GENERATE(true, false);
  for (const auto& [width, height] :
       {std::pair{1u, 1u}, {1u, 700u}, {700u, 1u}, {331u, 257u}, {1280u, 720u}, {90000u, 3u}}) {
    const std::vector<uint8_t> pixels = make_pixels(width, height, channels);
    const PixelView picture{width, height, channels, pixels};
    size_t sizes[2];
    for (const bool is_small : {true, false}) {
      INFO(width << " x " << height << " x " << channels << (is_small ? ", small" : "") << (has_alpha ? "" : ", RGB"));
      PngOptions options{.is_small = is_small, .has_alpha = has_alpha};
      const std::vector<std::byte> file = must(encode_png(picture, options));
      for (Workers* const workers : {&one, &three}) {
        options.workers = workers;
        CHECK((must(encode_png(picture, options)) == file));
      }
      CHECK(must(scree::runtime::probe_image(file)).channels == (has_alpha ? channels : 3));
      if (width <= scree::runtime::kMaxDecodedSide) check_pixels(picture, has_alpha, file);
      sizes[is_small ? 1 : 0] = file.size();
    }
    CHECK(sizes[1] <= sizes[0] + sizes[0] / 500);  // a smaller sum of differences need not deflate better
  }
}

TEST_CASE("an abandoned PNG has no bytes and leaves no file", "[image][png]") {
  const std::vector<uint8_t> pixels = make_pixels(640, 360, 3);
  const PixelView picture{640, 360, 3, pixels};
  Workers workers(2);
  const PngOptions options{.workers = &workers, .is_abandoned = [] { return true; }};
  CHECK(must(encode_png(picture, options)).empty());
  const scree::tests::TempFolder folder;
  must(scree::runtime::write_png(folder.file("a.png"), picture, options));
  CHECK(std::filesystem::is_empty(folder.path()));
}
