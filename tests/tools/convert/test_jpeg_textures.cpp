// JPEG textures that are decoded on demand: the picture equals the picture of completely decoded textures, for any size
// of the cache.
#include <algorithm>
#include <array>
#include <atomic>
#include <cstring>
#include <filesystem>
#include <string>
#include <thread>
#include <vector>

#include "format/jpeg/picture.h"
#include "kernels/shade/jpeg_group_cache.h"
#include "runtime/scene/camera.h"
#include "runtime/scene/scene.h"
#include "tests/models.h"
#include "tests/runtime/frame.h"
#include "tests/tools/convert/convert_fixture.h"
#include "tests/tools/jpeg_model.h"
#include "tools/convert/images/jpeg_file.h"

using namespace scree;
using namespace scree::tests;
using kernels::JpegGroupCache;
using kernels::JpegLevel;

namespace {

/// A camera that shows the whole scene.
runtime::CameraOptions whole_view(uint32_t width) {
  return {.width = width, .height = width * 2 / 3};
}

/// A camera close above the first texture.
runtime::CameraOptions close_view() {
  runtime::CameraOptions camera = whole_view(600);
  camera.eye = {0.3, 0.2, 0.2};
  camera.target = {0.6, 0, 0.5};
  return camera;
}

std::vector<uint8_t> draw(const runtime::Scene& scene, const runtime::CameraOptions& camera, uint32_t samples,
                          uint32_t threads) {
  const kernels::View view = tests::must_view(scene, camera);
  const auto frame = must(tests::Frame::draw(scene, view, samples, threads));
  return must(frame.shade({}, threads));
}

/// An indexed JPEG of the given size in pixels, with half as many chroma samples.
struct OpenJpeg {
  OpenJpeg(int width, int height)
      : indexed(convert::index_jpeg(tests::make_jpeg(jpeg_recipe(width, height, {{2, 1}, {1, 1}, {1, 1}})))),
        index(format::open_jpeg_index(indexed.value().bytes)),
        factors(format::jpeg_factors(index.value())) {}
  format::JpegPicture picture() const { return format::jpeg_picture(*index, factors.data()); }

  Result<convert::IndexedJpeg> indexed;
  Result<format::JpegIndex> index;
  std::vector<uint32_t> factors;
};

std::vector<uint8_t> draw(const runtime::Scene& scene, uint32_t width, uint32_t samples, uint32_t threads) {
  return draw(scene, whole_view(width), samples, threads);
}

}  // namespace

TEST_CASE("a picture does not depend on the size of the texture cache", "[jpeg_textures]") {
  const TempFolder folder;
  tests::make_jpeg_model(folder.file("in.glb"));
  convert::ConvertOptions options = tests::options_of(folder);
  options.encoding = GENERATE(convert::Encoding::kIndexed, convert::Encoding::kClustered);
  tests::must_convert(options);
  const runtime::Scene whole = load_cached(folder.file("out.scree"), 0);
  CHECK(whole.jpeg_group_cache() == nullptr);
  for (const uint64_t bytes : {uint64_t{1}, uint64_t{3000}, uint64_t{40000}, uint64_t{64} << 20}) {
    const runtime::Scene scene = load_cached(folder.file("out.scree"), bytes);
    REQUIRE(scene.jpeg_group_cache() != nullptr);
    CHECK(scene.jpeg_group_cache()->bytes() <= std::max<uint64_t>(bytes, 64 * format::kJpegMaxGroupBlocks));
    CHECK(scene.jpeg_group_cache()->decoded() == 0);
    for (const uint32_t width : {60u, 240u, 700u}) {  // coarse levels, middle levels, and magnified
      INFO(bytes << " bytes, " << width << " pixels");
      const auto expected = draw(whole, width, 1, 1);
      CHECK(draw(scene, width, 1, 1) == expected);
      CHECK(draw(scene, width, 1, 4) == expected);
      if (width == 60) CHECK(draw(scene, width, 4, 2) == draw(whole, width, 4, 2));
    }
    if (bytes < 40001) continue;
    // The cache persists: blocks that were used before are not decoded again.
    const uint64_t decoded = scene.jpeg_group_cache()->decoded();
    CHECK(decoded > 0);
    (void)draw(scene, 700, 1, 2);
    CHECK(scene.jpeg_group_cache()->decoded() == decoded);
  }
}

TEST_CASE("a picture does not depend on the memory for pages of JPEGs", "[jpeg_textures][texel_pager]") {
  const TempFolder folder;
  tests::make_jpeg_model(folder.file("in.glb"));
  const convert::ConvertOptions options = tests::options_of(folder);
  tests::must_convert(options);
  const runtime::Scene whole = load_cached(options.output, 0);
  const runtime::Reading reading = GENERATE(runtime::Reading::kAuto, runtime::Reading::kDirect);
  std::vector<runtime::CameraOptions> cameras;
  for (const uint32_t width : {60u, 240u, 700u}) cameras.push_back(whole_view(width));
  cameras.push_back(close_view());
  std::vector<std::vector<uint8_t>> expected;
  for (const runtime::CameraOptions& camera : cameras) expected.push_back(draw(whole, camera, 1, 2));
  for (const uint64_t cache : {uint64_t{100000}, uint64_t{64} << 20}) {
    uint64_t needed = 0;  // bytes and pages of all pictures
    uint64_t needed_pages = 0;
    for (const uint64_t part : {0u, 1u, 2u}) {
      const uint64_t memory = part == 0 ? uint64_t{1} << 40 : needed * 3 / (3 + part);
      const runtime::Scene scene = tests::must_load(options.output, {.threads = 2,
                                                                     .texture_cache = cache,
                                                                     .texture_memory = memory,
                                                                     .reading = reading,
                                                                     .device_texture_memory = memory});
      const runtime::BlockPager& pager = *scene.block_pager();
      CHECK(pager.resident_bytes() == 0);
      CHECK(pager.all_bytes() < std::filesystem::file_size(options.output));
      for (int time = 0; time < 2; ++time) {
        for (size_t i = 0; i < cameras.size(); ++i) {
          CAPTURE(cache, memory, i);
          CHECK(draw(scene, cameras[i], 1, 2) == expected[i]);
          CHECK(pager.resident_bytes() <= memory);
        }
        if (part == 0 && time == 0) needed_pages = pager.stats().read_pages;
      }
      // With room for all pages, each is read once.
      CHECK((part == 0 ? pager.stats().read_pages == needed_pages : pager.stats().read_pages > needed_pages));
      if (part != 0) continue;
      needed = pager.resident_bytes();
      CHECK(needed_pages > 5);
      CHECK(needed_pages <= pager.size());
      CHECK(draw(scene, 60, 4, 2) == draw(whole, 60, 4, 2));
    }
  }
  const runtime::Scene small = load_cached(options.output, 1, 1);
  const auto frame = tests::must_draw(small, tests::must_view(small, close_view()));
  const auto refused = refusal(frame.shade({}, 2));
  CHECK(refused.code == ErrorCode::kMemory);
  CHECK(refused.message.starts_with("a pixel shows pages of textures of "));
}

TEST_CASE("a page of JPEG levels is checked when it is read", "[jpeg_textures][texel_pager][bad]") {
  const TempFolder folder;
  tests::make_jpeg_model(folder.file("in.glb"));
  const convert::ConvertOptions options = tests::options_of(folder);
  tests::must_convert(options);
  const runtime::Scene scene = load_cached(options.output, 1, uint64_t{1} << 40);
  const format::Container& container = scene.container();
  const format::ImageRecord& image = container.images()[0];
  REQUIRE(image.codec == format::ImageCodec::kIndexedJpeg);
  REQUIRE(image.level_count > 1);
  // Levels 1 and 2 of an image lie in one page.
  const uint32_t page = container.mip_levels()[image.first_level].page;
  REQUIRE(container.mip_levels()[image.first_level + 1].page == page);
  std::vector<std::byte> scratch;
  const auto raw = must(container.load_page(page, scratch));
  const runtime::JpegLevels levels{0, 1, 2};
  std::vector<std::byte> memory(runtime::jpeg_head_place(raw.size(), image.channels, levels.count));
  const auto write = [&] {
    return runtime::write_jpeg_heads(container, levels, memory.data(), raw.size(), memory.data());
  };
  std::copy(raw.begin(), raw.end(), memory.begin());
  REQUIRE(write());
  for (uint32_t i = 0; i < levels.count; ++i) {
    format::JpegPicture picture;
    std::memcpy(&picture, memory.data() + runtime::jpeg_head_place(raw.size(), image.channels, i), sizeof picture);
    CHECK(picture.width == image.width >> (i + 1));
    CHECK(picture.height == image.height >> (i + 1));
  }
  for (uint32_t i = 0; i < levels.count; ++i) {
    const uint64_t offset = container.mip_levels()[image.first_level + i].offset;
    for (const uint64_t damaged : {offset, offset + 8}) {  // the magic, then the width
      std::copy(raw.begin(), raw.end(), memory.begin());
      memory[damaged] ^= std::byte{1};
      CHECK(refusal(write()).message.starts_with("image 0: level " + std::to_string(i + 1) + ": indexed JPEG: "));
    }
  }
  // In the file, the checksum becomes wrong.
  tests::damage(options.output, container.pages()[image.page].offset + 200);
  const auto frame = tests::must_draw(scene, tests::must_view(scene, close_view()));
  const auto refused = refusal(frame.shade({}, 2));
  CHECK(refused.code == ErrorCode::kChecksum);
  CHECK(refused.message.starts_with("page " + std::to_string(image.page) + ": "));
}

TEST_CASE("groups larger than a cache's slots are decoded where they are sampled", "[jpeg_textures]") {
  const OpenJpeg jpeg(100, 80);
  const format::JpegPicture picture = jpeg.picture();
  const uint32_t bytes = format::jpeg_group_bytes(picture);
  JpegGroupCache large(100 * bytes, bytes), small(100 * bytes, bytes - 64);
  uint64_t wrong = 0;
  for (uint32_t i = 0; i < 3000; ++i) {
    const uint32_t x[2] = {i * 7 % 100, (i * 7 + i % 3) % 100}, y[2] = {i * 13 % 80, (i * 13 + i % 2) % 80};
    uint32_t expected[4], found[4];
    large.fetch(picture, 0, x, y, expected);
    small.fetch(picture, 0, x, y, found);
    wrong += !std::equal(expected, expected + 4, found);
  }
  CHECK(wrong == 0);
  CHECK(small.decoded() >= 3000);
}

TEST_CASE("pictures of real models do not depend on the texture cache", "[jpeg_textures]") {
  const std::filesystem::path models = scree::tests::real_models("scenes");
  if (models.empty()) return;
  for (const char* name : {"DamagedHelmet/DamagedHelmet.glb", "CesiumMan/CesiumMan.gltf"}) {
    const auto path = models / name;
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
  const OpenJpeg jpeg(200, 150);
  const std::array<JpegLevel, 2> levels = {JpegLevel{jpeg.picture(), 0}, JpegLevel{jpeg.picture(), 1}};
  const uint32_t bytes = 64 * levels[0].picture.mcu_blocks * levels[0].picture.view.group_mcus;
  std::vector<std::vector<uint8_t>> expected(jpeg.index->layout.group_count, std::vector<uint8_t>(bytes));
  for (uint32_t group = 0; group < expected.size(); ++group)
    format::decode_jpeg_group(levels[0].picture, group, expected[group].data());
  for (const uint64_t slots : {uint64_t{1}, uint64_t{7}, uint64_t{64}, 40 * uint64_t{expected.size()}}) {
    JpegGroupCache cache(slots * bytes, bytes);
    CHECK(cache.slots() <= slots);
    CHECK(cache.slots() + JpegGroupCache::kWays > slots);
    std::atomic<uint64_t> wrong{0};
    const auto look = [&](uint32_t step) {
      for (uint32_t i = 0; i < 4 * expected.size(); ++i) {
        const uint32_t group = i * step % static_cast<uint32_t>(expected.size());
        uint64_t place;
        const uint8_t* const samples = cache.hold(levels[i / 3 % 2].picture, levels[i / 3 % 2].number, group, place);
        // MCUs past the picture's last one belong to no picture.
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
