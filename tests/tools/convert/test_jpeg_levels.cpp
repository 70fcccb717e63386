// Mip levels of indexed JPEGs: the right pictures, and small files.
#include "tools/convert/images/jpeg_levels.h"

#include <algorithm>
#include <cmath>

#include "format/container/mip_levels.h"
#include "runtime/textures/jpeg_image.h"
#include "runtime/textures/texture.h"
#include "tests/format/jpeg/jpeg_checks.h"
#include "tests/models.h"
#include "tests/results.h"
#include "tools/convert/images/jpeg_file.h"

using namespace scree;
using namespace scree::format;
using runtime::Image;
using scree::tests::jpeg::Bytes;
using scree::tests::jpeg::recipe_of;

namespace {

struct Levels {
  Bytes base;
  std::vector<Bytes> others;
};

Levels must_make(const Bytes& file) {
  auto indexed = must(convert::index_jpeg(file));
  const auto index = must(open_jpeg_index(indexed.bytes));
  auto levels = must(convert::make_jpeg_levels(index));
  return {std::move(indexed.bytes), std::move(levels)};
}

Image must_decode(const Bytes& bytes, uint32_t width, uint32_t height, uint32_t channels) {
  return must(runtime::decode_jpeg_level(must(runtime::open_jpeg_level(bytes, width, height, channels))));
}

/// PSNR in dB of each stored level, compared with the box filter of the base level.
std::vector<double> level_quality(const Levels& levels) {
  const auto base = must(open_jpeg_index(levels.base));
  const uint32_t width = base.width;
  const uint32_t height = base.height;
  REQUIRE(levels.others.size() == stored_level_count(width, height));
  const runtime::MipChain chain = runtime::make_mips(must_decode(levels.base, width, height, base.component_count));
  std::vector<double> quality;
  for (size_t i = 0; i < levels.others.size(); ++i) {
    const auto l = static_cast<uint32_t>(i) + 1;
    const Image image =
        must_decode(levels.others[i], std::max(1u, width >> l), std::max(1u, height >> l), base.component_count);
    double squares = 0;
    const uint8_t* const expected = chain.texels.data() + 4 * chain.level_offset[l];
    for (size_t k = 0; k < image.rgba.size(); ++k) squares += std::pow(int{image.rgba[k]} - int{expected[k]}, 2);
    const double values = 0.75 * static_cast<double>(image.rgba.size());  // alpha is 255 in both
    quality.push_back(10 * std::log10(255.0 * 255.0 * values / std::max(squares, 1e-9)));
  }
  return quality;
}

}  // namespace

TEST_CASE("levels with a longer side of at least 64 are stored", "[jpeg_levels]") {
  CHECK(stored_level_count(1, 1) == 0);
  CHECK(stored_level_count(127, 127) == 0);
  CHECK(stored_level_count(128, 1) == 1);
  CHECK(stored_level_count(1, 255) == 1);
  CHECK(stored_level_count(256, 3) == 2);
  CHECK(stored_level_count(16384, 16384) == 8);
  CHECK(stored_level_count(65535, 1) == 9);
}

TEST_CASE("levels are the box filter of the base level, for every sampling", "[jpeg_levels]") {
  using Factors = std::vector<std::pair<int, int>>;
  for (const Factors& factors : {Factors{{1, 1}}, Factors{{1, 1}, {1, 1}, {1, 1}}, Factors{{2, 2}, {1, 1}, {1, 1}},
                                 Factors{{2, 1}, {1, 1}, {1, 1}}, Factors{{1, 2}, {1, 1}, {1, 1}},
                                 Factors{{4, 1}, {1, 1}, {1, 1}}, Factors{{1, 1}, {2, 1}, {1, 2}}}) {
    for (const bool is_rgb : {false, true}) {
      if (is_rgb && factors.size() == 1) continue;
      auto recipe = recipe_of(517, 389, factors);
      recipe.quality = 98;
      recipe.is_rgb = is_rgb;
      INFO(factors.size() << " components, " << factors[0].first << " x " << factors[0].second << ", RGB " << is_rgb);
      const Levels levels = must_make(scree::tests::make_jpeg(recipe));
      REQUIRE(levels.others.size() == 3);
      for (const double quality : level_quality(levels)) CHECK(quality > 20);  // noise in chroma loses most
      CHECK(must_make(scree::tests::make_jpeg(recipe)).others == levels.others);
    }
  }
  auto flat = recipe_of(640, 200, {{1, 1}, {1, 1}, {1, 1}});
  flat.quality = 100;
  for (const double quality : level_quality(must_make(scree::tests::make_jpeg(flat)))) CHECK(quality > 40);
}

TEST_CASE("levels of real files take at most 0.4 of their base levels", "[jpeg_levels]") {
  const std::filesystem::path folder = scree::tests::real_models("jpeg");
  if (folder.empty()) return;
  double ratios = 0;
  double large_ratios = 0;  // for files of 65,536 pixels or more
  double bytes = 0, base_bytes = 0;
  double quality = 0;  // of level 1
  uint32_t files = 0, large = 0;
  double worst = 0;
  for (const auto& path : scree::tests::files_below(folder)) {
    INFO(path.filename().string());
    const Bytes file = tests::read_bytes(path);
    if (!convert::index_jpeg(file)) continue;
    const Levels levels = must_make(file);
    uint64_t sum = levels.base.size();
    for (const Bytes& level : levels.others) sum += level.size();
    const double ratio = static_cast<double>(sum) / static_cast<double>(levels.base.size());
    ratios += ratio;
    ++files;
    bytes += static_cast<double>(sum);
    base_bytes += static_cast<double>(levels.base.size());
    const auto base = must(open_jpeg_index(levels.base));
    if (uint64_t{base.width} * base.height < 65536) continue;
    large_ratios += ratio;
    worst = std::max(worst, ratio);
    quality += level_quality(levels)[0];
    ++large;
  }
  CHECK(files == 118);
  CHECK(ratios / files < 1.4);
  CHECK(large_ratios / large < 1.4);
  CHECK(bytes / base_bytes < 1.4);
  WARN(files << " files: all levels " << ratios / files << " x the base in the mean, " << bytes / base_bytes
             << " of all bytes; " << large << " of 65,536 pixels or more: " << large_ratios / large << ", largest "
             << worst << ", level 1 " << quality / large << " dB");
}
