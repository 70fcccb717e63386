#include "tools/convert/images/jpeg_transcode.h"

#include <cstdlib>
#include <filesystem>

#include "format/jpeg/index.h"
#include "runtime/images/image.h"
#include "tests/format/jpeg/jpeg_checks.h"
#include "tests/models.h"
#include "tests/results.h"

using namespace scree;
using namespace scree::tests;
using scree::format::JpegTreatment;
using scree::tests::jpeg::Bytes;

namespace {

/// Checks that the file can be indexed, and the index opened.
void check_indexable(const Bytes& file) {
  const auto header = must(format::parse_jpeg(file));
  Bytes out(must(format::jpeg_index_bound(header, file.size())));
  const auto encoded = must(format::encode_jpeg_index(out, header, file));
  CHECK(encoded.dropped_bytes == 0);
  must(format::open_jpeg_index(std::span<const std::byte>(out).first(encoded.bytes)));
}

void check_transcode(const Bytes& file) {
  GuardedBytes guarded(file);
  const auto transcoded = must(convert::transcode_jpeg(guarded.bytes()));
  const auto before = scree::tests::read_coefficients(file);
  const auto after = scree::tests::read_coefficients(transcoded.file);
  REQUIRE(before.size() == after.size());
  for (size_t c = 0; c < before.size(); ++c) {
    CHECK(before[c].blocks_across == after[c].blocks_across);
    CHECK(before[c].blocks_down == after[c].blocks_down);
    CHECK(before[c].values == after[c].values);
  }
  CHECK(scree::tests::read_quant_tables(transcoded.file) == scree::tests::read_quant_tables(file));
  CHECK(scree::tests::read_colour_space(transcoded.file) == scree::tests::read_colour_space(file));
  check_indexable(transcoded.file);
}

JpegRecipe colour_recipe(std::vector<std::pair<int, int>> factors) {
  return {.width = 151, .height = 103, .factors = std::move(factors)};
}

}  // namespace

TEST_CASE("progressive, arithmetic and several-scan JPEGs keep their coefficients", "[jpeg_transcode]") {
  for (const auto& factors : std::vector<std::vector<std::pair<int, int>>>{
           {{1, 1}}, {{1, 1}, {1, 1}, {1, 1}}, {{2, 2}, {1, 1}, {1, 1}}, {{2, 1}, {1, 2}, {1, 1}}}) {
    for (int kind = 0; kind < 8; ++kind) {
      JpegRecipe recipe = colour_recipe(factors);
      recipe.is_progressive = kind == 1 || kind == 3 || kind == 6;
      recipe.is_arithmetic = kind == 2 || kind == 3;
      recipe.has_scan_each = kind == 4 || kind == 7;
      recipe.restart = kind >= 5 ? 4 : 0;
      recipe.is_rgb = kind == 6 && factors.size() == 3;
      recipe.has_wide_quant = kind == 7;
      if (kind == 7) recipe.quality = 3;
      INFO("kind " << kind << ", " << factors.size() << " components");
      check_transcode(make_jpeg(recipe));
    }
  }
  JpegRecipe recipe = colour_recipe({{2, 2}, {1, 1}, {1, 1}});
  recipe.is_progressive = true;
  CHECK(convert::transcode_jpeg(make_jpeg(recipe))->note ==
        "progressive, stored as baseline with the same coefficients");
}

TEST_CASE("a progressive JPEG that is cut anywhere is an error, never a picture", "[jpeg_transcode]") {
  JpegRecipe recipe = colour_recipe({{2, 2}, {1, 1}, {1, 1}});
  recipe.width = 40;
  recipe.height = 24;
  for (int kind = 0; kind < 2; ++kind) {
    recipe.is_progressive = kind == 0;
    recipe.has_scan_each = kind == 1;
    const Bytes file = make_jpeg(recipe);
    for (size_t size = 0; size + 2 < file.size(); ++size) {
      GuardedBytes guarded(std::span<const std::byte>(file).first(size));
      const auto transcoded = convert::transcode_jpeg(guarded.bytes());
      if (transcoded) FAIL("a prefix of " << size << " bytes is taken");
      if (transcoded.error().message.rfind("JPEG: byte ", 0) != 0) FAIL(transcoded.error().message);
    }
  }
}

TEST_CASE("JPEGs that cannot be transcoded are refused before memory is allocated", "[jpeg_transcode]") {
  const auto message = [](const Bytes& file) { return refusal(convert::transcode_jpeg(file)).message; };
  JpegRecipe recipe = colour_recipe({{1, 1}, {1, 1}, {1, 1}});
  recipe.is_progressive = true;
  Bytes file = make_jpeg(recipe);
  size_t frame = 2;  // SOF2
  while (file[frame] != std::byte{0xff} || file[frame + 1] != std::byte{0xc2}) ++frame;
  const auto set = [&](size_t at, uint32_t value) {
    Bytes changed = file;
    changed[frame + at] = static_cast<std::byte>(value);
    return changed;
  };
  CHECK(message(set(4, 12)) == "JPEG: 12 bits per sample");
  CHECK(message(set(1, 0xc3)) == "JPEG: lossless");
  Bytes huge = file;
  for (size_t i = 5; i < 9; ++i) huge[frame + i] = std::byte{0xff};
  CHECK(message(huge) == "JPEG: 65535 x 65535 pixels, expected at most 2^28");
  huge[frame + 5] = huge[frame + 7] = std::byte{0x3f};
  CHECK(message(huge).find("expected at least one bit per block") != std::string::npos);
  Bytes wide = set(11, 0x33);
  CHECK(convert::transcode_jpeg(wide).error().code == ErrorCode::kUnsupported);  // 11 blocks per MCU
  CHECK(message(make_jpeg(colour_recipe({{1, 1}, {1, 1}, {1, 1}, {1, 1}}))) == "JPEG: 4 components (CMYK)");
}

TEST_CASE("CMYK is decoded and encoded again", "[jpeg_transcode]") {
  JpegRecipe recipe = colour_recipe({{1, 1}, {1, 1}, {1, 1}, {1, 1}});
  const Bytes file = make_jpeg(recipe);
  const auto coded = must(convert::reencode_jpeg(file, 95));
  CHECK(coded.note == "4 components (CMYK), decoded and encoded again with quality 95");
  check_indexable(coded.file);
  const auto before = runtime::decode_image(file);
  const auto after = runtime::decode_image(coded.file);
  REQUIRE((before && after));
  REQUIRE(before->rgba.size() == after->rgba.size());
  double sum = 0;
  for (size_t i = 0; i < before->rgba.size(); ++i) sum += std::abs(int{before->rgba[i]} - int{after->rgba[i]});
  CHECK(sum / static_cast<double>(before->rgba.size()) < 3);

  // A small file that states 16,191 x 16,191 pixels is refused at once.
  size_t frame = 2;  // SOF0
  while (file[frame] != std::byte{0xff} || file[frame + 1] != std::byte{0xc0}) ++frame;
  Bytes huge = file;
  for (size_t i = 5; i < 9; ++i) huge[frame + i] = std::byte{0x3f};
  const Error error = refusal(convert::reencode_jpeg(huge, 95));
  CHECK(error.code == ErrorCode::kTruncated);
  CHECK(error.message.find("expected at least one bit per block") != std::string::npos);
}

TEST_CASE("real JPEG files are indexed as they are, transcoded, encoded again or refused", "[jpeg_transcode]") {
  const std::filesystem::path folder = scree::tests::real_models("jpeg");
  if (folder.empty()) return;
  uint32_t transcoded = 0, refused = 0, coded = 0;
  for (const std::filesystem::path& path : scree::tests::files_below(folder)) {
    INFO(path.filename().string());
    const Bytes file = read_bytes(path);
    const auto header = must(format::parse_jpeg(file));
    switch (format::judge_jpeg(header).treatment) {
      case JpegTreatment::kAsItIs:
        break;
      case JpegTreatment::kTranscode:
        check_transcode(file);
        ++transcoded;
        break;
      case JpegTreatment::kReencode: {
        check_indexable(must(convert::reencode_jpeg(file, 90)).file);
        ++coded;
        break;
      }
      case JpegTreatment::kRefuse:
        CHECK(convert::transcode_jpeg(file).error().code == ErrorCode::kUnsupported);
        CHECK(convert::reencode_jpeg(file, 90).error().code == ErrorCode::kUnsupported);
        ++refused;
        break;
    }
  }
  CHECK(transcoded >= 25);
  CHECK(coded >= 4);
  CHECK(refused == 4);
}

TEST_CASE("damaged JPEG files never take the transcoder past its limits", "[jpeg_transcode]") {
  const std::filesystem::path folder = scree::tests::real_models("bad/jpeg");
  if (folder.empty()) return;
  uint32_t refused = 0;
  for (const std::filesystem::path& path : scree::tests::files_below(folder)) {
    INFO(path.filename().string());
    const auto transcoded = convert::transcode_jpeg(read_bytes(path));
    refused += !transcoded;
    if (transcoded) check_indexable(transcoded->file);
  }
  CHECK(refused > 50);
}
