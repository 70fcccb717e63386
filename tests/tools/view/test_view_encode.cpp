#include "tools/view/encode.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "runtime/images/image.h"
#include "tests/results.h"
#include "tools/view/adaptation.h"

using namespace scree::tools::view;
using scree::runtime::Image;
using scree::runtime::Workers;

namespace {

struct TestPicture {
  std::vector<uint8_t> bytes;
  PixelView view;
};

/// A smooth picture, which JPEG hardly changes. A step between strips would reveal a wrong position.
TestPicture make_picture(uint32_t width, uint32_t height) {
  TestPicture out;
  for (uint32_t y = 0; y < height; ++y)
    for (uint32_t x = 0; x < width; ++x)
      for (uint32_t c = 0; c < 3; ++c)
        out.bytes.push_back(
            static_cast<uint8_t>(127 + 90 * std::sin(0.02 * x + 0.05 * y * (c + 1)) + (c == 0 ? x % 7 : 0)));
  out.view = {width, height, 3, out.bytes};
  return out;
}

Image decoded(const std::vector<std::byte>& file) {
  const auto image = must(scree::runtime::decode_image(file));
  CHECK(image.warning.empty());
  return image;
}

}  // namespace

TEST_CASE("a JPEG in strips equals the JPEG of one strip", "[view][view-encode]") {
  Workers one(1), three(3);
  for (const bool is_sharp : {false, true}) {
    for (const auto& [width, height] : {std::pair{1u, 1u}, {17u, 200u}, {331u, 257u}, {8192u, 40u}, {1280u, 720u}}) {
      const TestPicture picture = make_picture(width, height);
      const Image left = decoded(must(encode_jpeg(picture.view, 90, is_sharp, one)));
      const Image right = decoded(must(encode_jpeg(picture.view, 90, is_sharp, three)));
      REQUIRE(left.height == height);
      if (is_sharp) CHECK(left.rgba == right.rgba);  // with 4:2:0 the decoder smooths across the borders of strips
      double squares = 0;
      for (size_t i = 0; i < size_t{width} * height; ++i)
        for (size_t c = 0; c < 3; ++c) squares += std::pow(right.rgba[4 * i + c] - picture.bytes[3 * i + c], 2);
      CHECK(squares / (3.0 * width * height) < 40);
    }
  }
}

TEST_CASE("an encoder stops when its picture is no longer needed", "[view][view-encode]") {
  Workers workers(2);
  const TestPicture picture = make_picture(640, 360);
  const auto yes = [] { return true; };
  CHECK(encode_jpeg(picture.view, 80, false, workers, yes)->empty());
}

TEST_CASE("quality follows the rates of the link and the renderer", "[view][view-encode]") {
  // A picture takes fixed_ms, plus time for its pixels and for its bytes, whose number depends on its quality.
  const auto settle = [](double fixed_ms, double pixel_ms, double byte_ms) {
    Adaptation adaptation;
    double now = 1000;
    for (int i = 0; i < 2000; ++i) {
      const Quality& quality = adaptation.quality();
      const double pixels = quality.scale * quality.scale;
      const double ms = fixed_ms + pixels * (pixel_ms + byte_ms * quality.jpeg / 75.0);
      adaptation.note(adaptation.level(), ms, now);
      now += ms;
    }
    return adaptation.level();
  };
  CHECK(settle(5, 5, 5) == 0);     // everything is fast: the best quality
  CHECK(settle(10, 200, 0) >= 2);  // a slow renderer: fewer pixels
  CHECK(settle(10, 200, 0) <= 4);
  CHECK(settle(10, 10, 1500) == 5);  // a slow link: the lowest quality
  CHECK(settle(200, 1, 1) <= 1);     // neither pixels nor bytes matter: a good picture is as fast as a bad one
}

TEST_CASE("quality recovers after a short disturbance", "[view][view-encode]") {
  Adaptation adaptation;
  double now = 1000;
  const auto show = [&](double until, double ms) {
    size_t worst = 0;
    for (; now < until; now += ms) {
      adaptation.note(adaptation.level(), ms, now);
      worst = std::max(worst, adaptation.level());
    }
    return worst;
  };
  CHECK(show(2000, 150) >= 2);  // while the scene is loaded
  show(20000, 60);              // fast enough for steering, but not fast
  CHECK(adaptation.level() == 0);
  // If the level above stays too slow, it is tried less and less often.
  Adaptation slow;
  size_t trials = 0;
  for (now = 1000; now < 241000;) {
    const size_t level = slow.level();
    const double ms = level < 2 ? 130 : 70;
    slow.note(level, ms, now);
    if (slow.level() < level) ++trials;
    now += ms;
  }
  CHECK(trials >= 3);
  CHECK(trials <= 8);
  CHECK(slow.level() <= 2);
}
