// FLIP and PSNR: values of the authors' program, and values that follow from the paper's formulas.
#include <array>
#include <cmath>
#include <filesystem>
#include <vector>

#include "runtime/images/image.h"
#include "runtime/images/png_writer.h"
#include "tests/models.h"
#include "tests/results.h"
#include "tests/tools/temp_folder.h"
#include "tools/compare/flip.h"
#include "tools/compare/images.h"

using namespace scree;

namespace {

using Colour = std::array<uint8_t, 3>;

struct Picture {
  uint32_t width, height;
  std::vector<uint8_t> rgb;

  Picture(uint32_t w, uint32_t h, const Colour& colour) : width(w), height(h) {
    for (uint64_t i = 0; i < uint64_t{w} * h; ++i) rgb.insert(rgb.end(), colour.begin(), colour.end());
  }
  void set(uint32_t x, uint32_t y, const Colour& colour) {
    std::copy(colour.begin(), colour.end(), rgb.begin() + 3 * (uint64_t{y} * width + x));
  }
  compare::RgbView view() const { return {width, height, rgb}; }
};

std::vector<float> flip(const Picture& a, const Picture& b, double ppd = compare::kPixelsPerDegree,
                        uint32_t threads = 2) {
  return compare::flip_map(a.view(), b.view(), ppd, threads);
}

constexpr Colour kBlack{0, 0, 0}, kWhite{255, 255, 255}, kGreen{0, 255, 0}, kBlue{0, 0, 255}, kGrey{128, 128, 128};

}  // namespace

TEST_CASE("flip of plain colours equals the paper's colour formulas", "[flip]") {
  const auto one = [](const Colour& a, const Colour& b) {
    const auto map = flip({9, 5, a}, {9, 5, b});
    REQUIRE(map.size() == 45);
    // Without features the error is the same everywhere.
    for (const float error : map) CHECK(std::abs(error - map[0]) < 1e-4f);
    return static_cast<double>(map[0]);
  };
  CHECK(one(kGrey, kGrey) == 0);
  CHECK(one(kGreen, kBlue) == Approx(1).margin(1e-4));  // the largest possible difference, by definition
  // HyAB is 100 between black and white, and 203.3 between green and blue after the Hunt adjustment. To the power of
  // 0.7 these are 25.12 and 41.27, and 0.95 + 0.05 (25.12 - 0.4 41.27) / (0.6 41.27) is 0.9674.
  CHECK(one(kBlack, kWhite) == Approx(0.9674).margin(2e-4));
}

TEST_CASE("flip finds a line, symmetrically and for any number of threads", "[flip]") {
  Picture plain(64, 40, kGrey), line = plain;
  for (uint32_t y = 0; y < 40; ++y) line.set(20, y, kWhite);
  const auto there = flip(plain, line), back = flip(line, plain);
  CHECK(there == back);
  CHECK(there == flip(plain, line, compare::kPixelsPerDegree, 7));
  const auto at = [&](uint32_t x) { return there[uint64_t{64} * 20 + x]; };
  CHECK(at(20) > 0.3f);
  CHECK(at(20) >= at(24));
  CHECK(at(24) >= at(30));
  CHECK(at(60) == 0);
  // Columns are handled like rows.
  Picture plain_turned(40, 64, kGrey), turned = plain_turned;
  for (uint32_t x = 0; x < 40; ++x) turned.set(x, 20, kWhite);
  const auto map = flip(plain_turned, turned);
  for (uint32_t i = 0; i < 64; ++i) CHECK(map[uint64_t{40} * i + 17] == Approx(at(i)).margin(1e-4));
  // From far away (many pixels per degree) a single line is less visible.
  CHECK(flip(plain, line, 300)[uint64_t{64} * 20 + 20] < at(20));
}

TEST_CASE("psnr and flip of picture files", "[flip]") {
  const tests::TempFolder folder;
  Picture a(10, 10, kGrey), b = a;
  b.set(3, 4, {128, 138, 128});
  const auto write = [&](const char* name, const Picture& picture) {
    REQUIRE(runtime::write_png(folder.file(name), {picture.width, picture.height, 3, picture.rgb}));
  };
  write("a.png", a);
  write("b.png", b);
  const auto report = must(compare::compare_pictures(folder.file("a.png"), folder.file("b.png"), 67, 2));
  CHECK(report.differing == 1);
  CHECK(report.max_levels == 10);
  CHECK(report.psnr == Approx(10 * std::log10(255.0 * 255.0 / (100.0 / 300))));
  CHECK(report.flip_max > 0);
  CHECK(report.flip_mean < report.flip_max);
  const auto same = must(compare::compare_pictures(folder.file("a.png"), folder.file("a.png"), 67, 2));
  CHECK(std::isinf(same.psnr));
  CHECK(same.flip_max == 0);
}

TEST_CASE("flip equals the values of the authors' program", "[flip]") {
  const std::filesystem::path folder = std::filesystem::path(tests::kModelsFolder) / "flip";
  if (!std::filesystem::exists(folder)) {
    WARN("skipped: no pictures with values of the authors' program");
    return;
  }
  struct Pair {
    const char* test;
    const char* reference;
    double mean, max;  // of FLIP v1.6 with the same pixels per degree
  };
  for (const Pair& pair : {Pair{"a1.png", "a16.png", 0.050113, 0.309114},
                           {"assao.png", "a1.png", 0.102688, 0.521568},
                           {"anorm.png", "a1.png", 0.830921, 0.991447},
                           {"acol.png", "a1.png", 0.690676, 0.969740}}) {
    INFO(pair.test);
    const auto report = must(compare::compare_pictures(
        (folder / pair.test).string(), (folder / pair.reference).string(), compare::kPixelsPerDegree, 2));
    CHECK(report.flip_mean == Approx(pair.mean).epsilon(0).margin(2e-5));
    CHECK(report.flip_max == Approx(pair.max).epsilon(0).margin(2e-5));
  }
}
