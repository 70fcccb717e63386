// Drawing JPEG textures that are decoded on demand: the picture equals that of completely decoded textures, for any
// size of the cache.
#include <array>
#include <atomic>
#include <thread>

#include "format/jpeg/picture.h"
#include "kernels/shade/block_cache.h"
#include "runtime/draw/renderer.h"
#include "runtime/scene/camera.h"
#include "runtime/scene/scene.h"
#include "tests/catch.h"
#include "tests/format/jpeg/jpeg_maker.h"
#include "tests/models.h"
#include "tests/runtime/load_scene.h"
#include "tests/tools/convert/convert_fixture.h"
#include "tests/tools/jpeg_model.h"
#include "tests/tools/temp_folder.h"
#include "tools/convert/images/jpeg_file.h"

using namespace scree;
using kernels::BlockCache;
using kernels::JpegLevel;
using tests::jpeg_recipe;
using tests::load_cached;
using tests::TempFolder;

namespace {

std::vector<uint8_t> draw(const runtime::Scene& scene, uint32_t width, uint32_t samples, uint32_t threads) {
  const kernels::View view = tests::must_view(scene, {.width = width, .height = width * 2 / 3});
  const auto frame = runtime::Frame::draw(scene, view, samples, threads);
  if (!frame) FAIL(frame.error().message);
  const auto picture = frame->shade({}, threads);
  REQUIRE(picture);
  return picture->pixels;
}

}  // namespace

TEST_CASE("a picture does not depend on the size of the texture cache", "[jpeg_textures]") {
  const TempFolder folder;
  tests::make_jpeg_model(folder.file("in.glb"));
  convert::ConvertOptions options = tests::options_of(folder);
  options.encoding = GENERATE(convert::Encoding::kIndexed, convert::Encoding::kClustered);
  tests::must_convert(options);
  const runtime::Scene whole = load_cached(folder.file("out.scree"), 0);
  CHECK(whole.block_cache() == nullptr);
  for (const uint64_t bytes : {uint64_t{1}, uint64_t{3000}, uint64_t{40000}, uint64_t{64} << 20}) {
    const runtime::Scene scene = load_cached(folder.file("out.scree"), bytes);
    REQUIRE(scene.block_cache() != nullptr);
    CHECK(scene.block_cache()->bytes() <= std::max<uint64_t>(bytes, 64 * format::kJpegMaxGroupBlocks));
    CHECK(scene.block_cache()->decoded() == 0);
    for (const uint32_t width : {60u, 240u, 700u}) {  // coarse levels, middle levels, and magnified
      INFO(bytes << " bytes, " << width << " pixels");
      const auto expected = draw(whole, width, 1, 1);
      CHECK(draw(scene, width, 1, 1) == expected);
      CHECK(draw(scene, width, 1, 4) == expected);
      if (width == 60) CHECK(draw(scene, width, 4, 2) == draw(whole, width, 4, 2));
    }
    if (bytes < 40001) continue;
    // The cache persists: blocks used before are not decoded again.
    const uint64_t decoded = scene.block_cache()->decoded();
    CHECK(decoded > 0);
    (void)draw(scene, 700, 1, 2);
    CHECK(scene.block_cache()->decoded() == decoded);
  }
}

TEST_CASE("real models are equal with any texture cache", "[jpeg_textures]") {
  if (tests::models_path().empty()) {
    WARN("no models: skipped");
    return;
  }
  for (const char* name : {"DamagedHelmet/DamagedHelmet.glb", "CesiumMan/CesiumMan.gltf"}) {
    const auto path = tests::models_path() / "scenes" / name;
    if (!std::filesystem::exists(path)) continue;
    INFO(name);
    const TempFolder folder;
    convert::ConvertOptions options = tests::options_of(folder);
    options.input = path.string();
    tests::must_convert(options);
    const auto expected = draw(load_cached(options.output, 0), 300, 1, 2);
    CHECK(draw(load_cached(options.output, 1), 300, 1, 2) == expected);
    CHECK(draw(load_cached(options.output, uint64_t{64} << 20), 300, 1, 2) == expected);
  }
}

TEST_CASE("a block cache gives every group's samples to every thread", "[jpeg_textures]") {
  const auto indexed = runtime::index_jpeg(tests::make_jpeg(jpeg_recipe(200, 150, {{2, 1}, {1, 1}, {1, 1}})));
  REQUIRE(indexed);
  const auto index = format::open_jpeg_index(indexed->bytes);
  REQUIRE(index);
  const auto factors = format::jpeg_factors(*index);
  const std::array<JpegLevel, 2> levels = {JpegLevel{format::jpeg_picture(*index, factors.data()), 0},
                                           JpegLevel{format::jpeg_picture(*index, factors.data()), 1}};
  const uint32_t bytes = 64 * levels[0].picture.mcu_blocks * levels[0].picture.view.group_mcus;
  std::vector<std::vector<uint8_t>> expected(index->layout.group_count, std::vector<uint8_t>(bytes));
  for (uint32_t group = 0; group < expected.size(); ++group)
    format::decode_jpeg_group(levels[0].picture, group, expected[group].data());
  for (const uint64_t slots : {uint64_t{1}, uint64_t{7}, uint64_t{64}, 40 * uint64_t{expected.size()}}) {
    BlockCache cache(slots * bytes, bytes);
    CHECK(cache.slots() <= slots);
    CHECK(cache.slots() + BlockCache::kWays > slots);
    std::atomic<uint64_t> wrong{0};
    const auto look = [&](uint32_t step) {
      for (uint32_t i = 0; i < 4 * expected.size(); ++i) {
        const uint32_t group = i * step % static_cast<uint32_t>(expected.size());
        uint64_t place;
        const uint8_t* const samples = cache.hold(levels[i / 3 % 2], group, place);
        // MCUs behind the picture's last one belong to no picture.
        const uint32_t mcus = std::min(levels[0].picture.view.group_mcus,
                                       levels[0].picture.view.mcu_count - group * levels[0].picture.view.group_mcus);
        wrong +=
            !std::equal(samples, samples + size_t{64} * levels[0].picture.mcu_blocks * mcus, expected[group].begin());
        cache.release(place);
      }
    };
    std::vector<std::thread> threads;
    for (const uint32_t step : {1u, 1u, 7u, 13u}) threads.emplace_back(look, step);
    for (std::thread& thread : threads) thread.join();
    CHECK(wrong == 0);
    CHECK(cache.decoded() >= expected.size());
  }
}
