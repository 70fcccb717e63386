// Drawing JPEG textures, decoded as they are looked at: the picture is that of textures decoded whole, whatever the
// size of the cache.
#include <array>
#include <atomic>
#include <thread>

#include "format/jpeg_picture.h"
#include "kernels/block_cache.h"
#include "runtime/camera.h"
#include "runtime/jpeg_file.h"
#include "runtime/renderer.h"
#include "runtime/scene.h"
#include "tests/catch.h"
#include "tests/format/jpeg_maker.h"
#include "tests/models.h"
#include "tests/tools/convert_fixture.h"
#include "tests/tools/model_maker.h"
#include "tests/tools/temp_folder.h"

using namespace scree;
using format::Wrap;
using kernels::BlockCache;
using kernels::JpegLevel;
using tests::JpegRecipe;
using tests::ModelMaker;
using tests::TempFolder;

namespace {

JpegRecipe recipe(int width, int height, std::vector<std::pair<int, int>> factors) {
  JpegRecipe made;
  made.width = width;
  made.height = height;
  made.factors = std::move(factors);
  return made;
}

/// Grids side by side, each with another JPEG, wrapping, filter and transform; some of many repeats, some close up.
void make_model(const std::string& path) {
  ModelMaker maker(path);
  const std::vector<JpegRecipe> recipes = {
      recipe(517, 389, {{2, 2}, {1, 1}, {1, 1}}),  recipe(300, 300, {{1, 1}, {1, 1}, {1, 1}}),
      recipe(256, 1000, {{2, 1}, {1, 1}, {1, 1}}), recipe(640, 200, {{1, 1}}),
      recipe(333, 201, {{4, 1}, {1, 1}, {1, 1}}),  recipe(90, 40, {{2, 2}, {1, 1}, {1, 1}})};
  constexpr Wrap kWraps[3] = {Wrap::kRepeat, Wrap::kMirror, Wrap::kClamp};
  for (size_t i = 0; i < recipes.size(); ++i) {
    JpegRecipe jpeg = recipes[i];
    jpeg.is_rgb = i == 1;
    jpeg.restart = i == 2 ? 7 : 0;
    tools::GltfTexture texture =
        maker.texture("i" + std::to_string(i), format::ImageCodec::kJpeg, tests::make_jpeg(jpeg));
    texture.wrap_s = kWraps[i % 3];
    texture.wrap_t = kWraps[(i + 1) % 3];
    texture.mag_filter = i == 4 ? 9728 : 9729;
    tools::GltfMaterial material;
    material.texture = maker.writer().add_texture(texture);
    material.unlit = i % 2 == 0;
    material.double_sided = true;
    material.transform.scale[0] = i == 3 ? 9 : 0.4;
    material.transform.scale[1] = i == 2 ? 0.05 : 1.3;
    material.transform.offset[0] = -0.37 * static_cast<double>(i);
    material.transform.rotation = 0.3 * static_cast<double>(i);
    tests::GridSpec spec;
    spec.uv = true;
    spec.origin = {1.05f * static_cast<float>(i % 3), 0, 1.05f * static_cast<float>(i / 3)};
    maker.node("n" + std::to_string(i),
               maker.mesh("m" + std::to_string(i), {maker.grid(spec, maker.writer().add_material(material))}));
  }
  maker.finish();
}

runtime::Scene must_load(const std::string& path, uint64_t texture_cache) {
  auto file = runtime::SceneFile::open(path);
  REQUIRE(file);
  runtime::SceneOptions options;
  options.texture_cache = texture_cache;
  options.threads = 2;
  auto scene = runtime::Scene::load(std::move(*file), 0, options);
  if (!scene) FAIL(scene.error().message);
  return std::move(*scene);
}

std::vector<uint8_t> draw(const runtime::Scene& scene, uint32_t width, uint32_t samples, uint32_t threads) {
  runtime::CameraOptions camera;
  camera.width = width;
  camera.height = width * 2 / 3;
  const auto view = runtime::make_view(scene.container(), 0, scene.view(), camera);
  REQUIRE(view);
  const auto frame = runtime::Frame::draw(scene, *view, samples, threads);
  if (!frame) FAIL(frame.error().message);
  const auto picture = frame->shade({}, threads);
  REQUIRE(picture);
  return picture->pixels;
}

}  // namespace

TEST_CASE("a picture does not depend on the size of the texture cache", "[jpeg_textures]") {
  const TempFolder folder;
  make_model(folder.file("in.glb"));
  tests::must_convert(tests::options_of(folder));
  const runtime::Scene whole = must_load(folder.file("out.scree"), 0);
  CHECK(whole.block_cache() == nullptr);
  for (const uint64_t bytes : {uint64_t{1}, uint64_t{3000}, uint64_t{40000}, uint64_t{64} << 20}) {
    const runtime::Scene scene = must_load(folder.file("out.scree"), bytes);
    REQUIRE(scene.block_cache() != nullptr);
    CHECK(scene.block_cache()->bytes() <= std::max<uint64_t>(bytes, 64 * format::kJpegMaxGroupBlocks));
    CHECK(scene.block_cache()->decoded() == 0);
    for (const uint32_t width : {60u, 240u, 700u}) {  // coarse levels, between, and magnified
      INFO(bytes << " bytes, " << width << " pixels");
      const auto expected = draw(whole, width, 1, 1);
      CHECK(draw(scene, width, 1, 1) == expected);
      CHECK(draw(scene, width, 1, 4) == expected);
      if (width == 60) CHECK(draw(scene, width, 4, 2) == draw(whole, width, 4, 2));
    }
    if (bytes < 40001) continue;
    // The cache lives on: what was seen is not decoded again.
    const uint64_t decoded = scene.block_cache()->decoded();
    CHECK(decoded > 0);
    (void)draw(scene, 700, 1, 2);
    CHECK(scene.block_cache()->decoded() == decoded);
  }
}

TEST_CASE("real models look the same with any texture cache", "[jpeg_textures]") {
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
    const auto expected = draw(must_load(options.output, 0), 300, 1, 2);
    CHECK(draw(must_load(options.output, 1), 300, 1, 2) == expected);
    CHECK(draw(must_load(options.output, uint64_t{64} << 20), 300, 1, 2) == expected);
  }
}

TEST_CASE("a block cache gives every group's samples to every thread", "[jpeg_textures]") {
  const auto indexed = runtime::index_jpeg(tests::make_jpeg(recipe(200, 150, {{2, 1}, {1, 1}, {1, 1}})));
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
        // MCUs behind the last one of the picture are nobody's.
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
