// convert --textures: the stored form of images, and their export.
#include <algorithm>

#include "format/jpeg/index.h"
#include "runtime/images/image.h"
#include "runtime/images/png_writer.h"
#include "tests/format/jpeg/jpeg_maker.h"
#include "tests/tools/compare/compare_scenes.h"
#include "tests/tools/convert/convert_fixture.h"
#include "tests/tools/model_maker.h"
#include "tools/convert/convert.h"
#include "tools/export/export.h"
#include "tools/gltf/source.h"

using namespace scree;
using namespace scree::tests;

namespace {

using Bytes = std::vector<std::byte>;

JpegRecipe recipe(std::vector<std::pair<int, int>> factors) {
  return {.width = 301, .height = 203, .factors = std::move(factors)};
}

Bytes make_png(uint32_t channels) {
  std::vector<uint8_t> pixels(size_t{160} * 90 * channels);
  for (size_t i = 0; i < pixels.size(); ++i) pixels[i] = static_cast<uint8_t>(i * 7 % 251);
  return must(runtime::encode_png({160, 90, channels, pixels}));
}

/// Makes a grid per image, with a material that shows it.
void make_image_model(const std::string& path, const std::vector<std::pair<format::ImageCodec, Bytes>>& images) {
  ModelMaker maker(path);
  for (size_t i = 0; i < images.size(); ++i) {
    const uint32_t material = maker.textured("image" + std::to_string(i), images[i].first, images[i].second);
    maker.node("n" + std::to_string(i), maker.mesh("m" + std::to_string(i), {maker.grid({.uv = true}, material)}));
  }
  maker.finish();
}

}  // namespace

TEST_CASE("JPEGs are indexed and keep their coefficients", "[convert][jpeg]") {
  const TempFolder folder;
  JpegRecipe progressive = recipe({{2, 2}, {1, 1}, {1, 1}});
  progressive.is_progressive = true;
  JpegRecipe restarts = recipe({{1, 1}, {1, 1}, {1, 1}});
  restarts.restart = 5;
  restarts.has_segments = true;
  JpegRecipe rgb = recipe({{1, 1}, {1, 1}, {1, 1}});
  rgb.is_rgb = true;
  const std::vector<Bytes> files = {tests::make_jpeg(recipe({{2, 2}, {1, 1}, {1, 1}})), tests::make_jpeg(progressive),
                                    tests::make_jpeg(restarts), tests::make_jpeg(rgb),
                                    tests::make_jpeg(recipe({{1, 1}}))};
  std::vector<std::pair<format::ImageCodec, Bytes>> images;
  for (const Bytes& file : files) images.emplace_back(format::ImageCodec::kJpeg, file);
  images.emplace_back(format::ImageCodec::kPng, make_png(4));
  make_image_model(folder.file("in.glb"), images);
  const convert::ConvertOptions options = options_of(folder);
  const convert::ConvertReport report = must_convert(options);
  REQUIRE(report.warnings.size() == 1);
  CHECK(report.warnings[0] == "in.glb: image 1 (image1): progressive, stored as baseline with the same coefficients");
  must_verify(options.output);
  {
    const tests::PackedFile opened = must_open(options.output);
    const format::Container& file = opened.file;
    REQUIRE(file.images().size() == 6);
    CHECK(file.mip_levels().size() == 5 * 2);  // 150 x 101 and 75 x 50
    for (uint32_t i = 0; i < 5; ++i) {
      CHECK(file.images()[i].codec == format::ImageCodec::kIndexedJpeg);
      CHECK(file.images()[i].channels == (i == 4 ? 1 : 3));
    }
    CHECK(file.images()[5].codec == format::ImageCodec::kPng);
  }
  const std::string once = tests::read_whole(options.output);
  convert::ConvertOptions alone = options;
  alone.threads = 1;
  CHECK((tests::converted_bytes(alone) == once));

  // Exported to glTF and imported again, the coefficients are the same, and so is the file converted from the export.
  const tests::PackedFile packed = must_open(options.output);
  must(tools::export_gltf(packed.file, folder.file("back.glb"), {.threads = 1}));
  const auto source = must(convert::import_gltf(options.input, {}));
  const auto back = must(convert::import_gltf(folder.file("back.glb"), {}));
  for (const std::string& difference : tests::compare_scenes(source, packed.file, back)) FAIL_CHECK(difference);
}

TEST_CASE("other images become JPEGs only on request", "[convert][jpeg]") {
  const TempFolder folder;
  const Bytes jpeg = tests::make_jpeg(recipe({{2, 1}, {1, 1}, {1, 1}}));
  make_image_model(folder.file("in.glb"), {{format::ImageCodec::kPng, make_png(4)},
                                           {format::ImageCodec::kPng, make_png(3)},
                                           {format::ImageCodec::kJpeg, jpeg}});
  convert::ConvertOptions options = options_of(folder);
  SECTION("jpeg") {
    options.images.textures = convert::Textures::kJpeg;
    options.images.quality = 80;
    const convert::ConvertReport report = must_convert(options);
    REQUIRE(report.warnings.size() == 1);
    CHECK(report.warnings[0] == "in.glb: image 0 (image0): alpha is left out");
    must_verify(options.output);
    const tests::PackedFile opened = must_open(options.output);
    for (uint32_t i = 0; i < 3; ++i) {
      CHECK(opened.file.images()[i].codec == format::ImageCodec::kIndexedJpeg);
      std::vector<std::byte> scratch;
      const auto page = must(opened.file.load_page(opened.file.images()[i].page, scratch));
      if (i < 2) CHECK(must(format::open_jpeg_index(page)).layout.mcu_blocks == 3);  // 4:4:4
    }
    CHECK(opened.file.string(opened.file.source().options).find("--textures jpeg:80") != std::string_view::npos);
  }
  SECTION("raw") {
    options.images.textures = convert::Textures::kRaw;
    must_convert(options);
    must_verify(options.output);
    const tests::PackedFile opened = must_open(options.output);
    CHECK(opened.file.images()[2].codec == format::ImageCodec::kJpeg);
    CHECK(opened.file.mip_levels().empty());
    std::vector<std::byte> scratch;
    const auto page = must(opened.file.load_page(opened.file.images()[2].page, scratch));
    CHECK(std::ranges::equal(page, jpeg));
  }
  SECTION("an invalid quality") {
    options.images.quality = 0;
    must_fail(options, ErrorCode::kUsage, "--textures: quality 0");
  }
}

TEST_CASE("a damaged JPEG is an error, or grey with --keep-going", "[convert][jpeg]") {
  const TempFolder folder;
  Bytes cut = tests::make_jpeg(recipe({{2, 2}, {1, 1}, {1, 1}}));
  cut.resize(cut.size() / 2);
  const Bytes whole = tests::make_jpeg(recipe({{1, 1}}));
  make_image_model(folder.file("in.glb"), {{format::ImageCodec::kJpeg, cut}, {format::ImageCodec::kJpeg, whole}});
  convert::ConvertOptions options = options_of(folder);
  must_fail(options, ErrorCode::kTruncated, "in.glb: image 0 (image0): JPEG: byte " + std::to_string(cut.size()));
  options.images.keep_going = true;
  const convert::ConvertReport report = must_convert(options);
  REQUIRE(report.warnings.size() == 1);
  CHECK(report.warnings[0].find("grey in its place") != std::string::npos);
  must_verify(options.output);
  const tests::PackedFile opened = must_open(options.output);
  CHECK(opened.file.images()[0].width == 1);
  CHECK(opened.file.images()[1].width == 301);
}
