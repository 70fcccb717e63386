// The samples and colours of indexed JPEGs compared with libjpeg's.
#include "format/jpeg/picture.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <random>

#include "runtime/images/image.h"
#include "tests/format/jpeg/jpeg_checks.h"
#include "tests/models.h"
#include "tests/results.h"
#include "tools/convert/images/jpeg_file.h"

using namespace scree;
using namespace scree::format;
using namespace scree::tests;
using scree::tests::jpeg::Bytes;

namespace {

JpegIndex must_index(const Bytes& bytes) {
  return must(open_jpeg_index(bytes));
}

/// libjpeg upsamples only by whole factors.
bool libjpeg_can_upsample(const JpegIndex& index) {
  uint32_t h = 1, v = 1;
  for (uint32_t c = 0; c < index.component_count; ++c) {
    h = std::max<uint32_t>(h, index.components[c].h);
    v = std::max<uint32_t>(v, index.components[c].v);
  }
  for (uint32_t c = 0; c < index.component_count; ++c)
    if (h % index.components[c].h != 0 || v % index.components[c].v != 0) return false;
  return true;
}

std::vector<uint8_t> decode_rgb(const JpegIndex& index) {
  std::vector<uint8_t> rgb;
  uint32_t rows = 0;
  must(decode_jpeg_rows(index, [&](uint32_t y, std::span<const uint8_t> row) {
    REQUIRE(y == rows++);
    REQUIRE(row.size() == size_t{3} * index.width);
    rgb.insert(rgb.end(), row.begin(), row.end());
  }));
  REQUIRE(rows == index.height);
  return rgb;
}

/// Decodes each group into a buffer that ends at a guard page, and counts samples that differ from `planes`.
uint64_t wrong_samples(const JpegIndex& index, const std::vector<JpegSamples>& planes) {
  const auto factors = jpeg_factors(index);
  const JpegPicture picture = jpeg_picture(index, factors.data());
  GuardedBytes buffer(size_t{64} * picture.mcu_blocks * picture.view.group_mcus);
  auto* const samples = reinterpret_cast<uint8_t*>(buffer.bytes().data());
  uint64_t wrong = 0;
  for (uint32_t group = 0; group < index.layout.group_count; ++group) {
    decode_jpeg_group(picture, group, samples);
    const uint8_t* block = samples;
    for (uint32_t m = 0; m < picture.view.group_mcus; ++m) {
      const uint32_t mcu = group * picture.view.group_mcus + m;
      if (mcu >= picture.view.mcu_count) break;
      for (uint32_t c = 0; c < index.component_count; ++c) {
        const JpegComponent& component = index.components[c];
        for (uint32_t i = 0; i < uint32_t{component.h} * component.v; ++i, block += 64) {
          const uint32_t x0 = 8 * (mcu % picture.view.mcus_across * component.h + i % component.h);
          const uint32_t y0 = 8 * (mcu / picture.view.mcus_across * component.v + i / component.h);
          for (uint32_t k = 0; k < 64; ++k) {
            const uint32_t x = x0 + k % 8, y = y0 + k / 8;
            if (x >= planes[c].width || y >= planes[c].height) continue;
            wrong += block[k] != planes[c].values[size_t{y} * planes[c].width + x];
          }
        }
      }
    }
  }
  return wrong;
}

/// Counts pixels whose colour differs between decoding by groups and decoding by rows.
uint64_t wrong_places(const JpegIndex& index, const std::vector<uint8_t>& rgb) {
  const auto factors = jpeg_factors(index);
  const JpegPicture picture = jpeg_picture(index, factors.data());
  std::vector<uint8_t> samples(size_t{64} * picture.mcu_blocks * picture.view.group_mcus);
  uint32_t decoded = ~0u;
  uint64_t wrong = 0;
  for (uint32_t y = 0; y < picture.height; ++y) {
    for (uint32_t x = 0; x < picture.width; ++x) {
      const JpegPlace place = jpeg_place(picture, x, y);
      if (place.group != decoded) decode_jpeg_group(picture, decoded = place.group, samples.data());
      const uint32_t colour = jpeg_colour(picture, place, samples.data());
      const uint8_t* const expected = rgb.data() + 3 * (size_t{y} * picture.width + x);
      for (uint32_t c = 0; c < 3; ++c) wrong += ((colour >> (8 * c)) & 255u) != expected[c];
    }
  }
  return wrong;
}

struct Difference {
  uint64_t values = 0, unequal = 0;
  double squares = 0;
  int largest = 0;

  void add(const std::vector<uint8_t>& a, const std::vector<uint8_t>& b) {
    REQUIRE(a.size() == b.size());
    for (size_t i = 0; i < a.size(); ++i) {
      const int off = std::abs(int{a[i]} - int{b[i]});
      unequal += off != 0;
      squares += off * off;
      largest = std::max(largest, off);
    }
    values += a.size();
  }
};

}  // namespace

TEST_CASE("samples and colours equal libjpeg's, for every kind of file", "[jpeg_pixels]") {
  for (const auto& recipe : scree::tests::indexable_recipes()) {
    INFO(recipe.name << ", " << recipe.width << " x " << recipe.height);
    const Bytes file = make_jpeg(recipe);
    const auto indexed = must(convert::index_jpeg(file));
    CHECK(indexed.note.empty());
    const JpegIndex index = must_index(indexed.bytes);
    if (!libjpeg_can_upsample(index)) {
      (void)decode_rgb(index);
      continue;
    }
    CHECK(wrong_samples(index, scree::tests::read_samples(file)) == 0);
    const auto rgb = decode_rgb(index);
    Difference difference;
    difference.add(rgb, scree::tests::read_rgb(file, false));
    CHECK(difference.unequal == 0);
    if (recipe.width * recipe.height < 40000) CHECK(wrong_places(index, rgb) == 0);
  }
}

TEST_CASE("damaged groups decode within their bytes", "[jpeg_pixels]") {
  std::mt19937 random(7);
  uint32_t opened = 0;
  for (const auto& recipe : scree::tests::indexable_recipes()) {
    if (recipe.width * recipe.height > 40000) continue;
    INFO(recipe.name << ", " << recipe.width << " x " << recipe.height);
    const auto indexed = must(convert::index_jpeg(make_jpeg(recipe)));
    for (int round = 0; round < 4; ++round) {
      GuardedBytes bytes(indexed.bytes);
      for (int i = 0; i < 6; ++i)
        bytes.bytes()[64 + random() % (bytes.bytes().size() - 64)] ^= std::byte(1 + random() % 255);
      const auto index = open_jpeg_index(bytes.bytes());
      if (!index) continue;
      ++opened;
      const auto factors = jpeg_factors(*index);
      const JpegPicture picture = jpeg_picture(*index, factors.data());
      GuardedBytes samples(size_t{64} * picture.mcu_blocks * picture.view.group_mcus);
      for (uint32_t group = 0; group < index->layout.group_count; ++group)
        decode_jpeg_group(picture, group, reinterpret_cast<uint8_t*>(samples.bytes().data()));
    }
  }
  CHECK(opened > 50);
}

TEST_CASE("samples and colours of real files equal libjpeg's", "[jpeg_pixels]") {
  const std::filesystem::path folder = scree::tests::real_models("jpeg");
  if (folder.empty()) return;
  uint32_t equal = 0;
  Difference fancy;
  for (const auto& path : scree::tests::files_below(folder)) {
    INFO(path.filename().string());
    const Bytes file = tests::read_bytes(path);
    const auto indexed = convert::index_jpeg(file);
    if (!indexed) {
      CHECK(indexed.error().code == ErrorCode::kUnsupported);
      continue;
    }
    const JpegIndex index = must_index(indexed->bytes);
    if (indexed->note.find("encoded again") != std::string::npos || !libjpeg_can_upsample(index)) {
      UNSCOPED_INFO("not compared");
      (void)decode_rgb(index);
      continue;
    }
    const uint64_t wrong = wrong_samples(index, scree::tests::read_samples(file));
    CHECK(wrong == 0);
    const auto rgb = decode_rgb(index);
    Difference difference;
    difference.add(rgb, scree::tests::read_rgb(file, false));
    CHECK(difference.unequal == 0);
    fancy.add(rgb, scree::tests::read_rgb(file, true));
    equal += wrong == 0 && difference.unequal == 0;
  }
  CHECK(equal >= 113);
  const double mean_square = fancy.squares / static_cast<double>(fancy.values);
  WARN(equal << " files equal; against interpolated chroma: " << 10 * std::log10(255.0 * 255.0 / mean_square)
             << " dB, at most " << fancy.largest << " codes, "
             << 100.0 * static_cast<double>(fancy.unequal) / static_cast<double>(fancy.values) << "% of values differ");
}
