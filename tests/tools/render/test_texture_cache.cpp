// The rounds in which a GPU decodes JPEG textures: first on the CPU with caches of every size, then on the GPU. The
// picture equals the picture of completely decoded textures, pixel for pixel.
#include <algorithm>
#include <array>
#include <iterator>
#include <set>
#include <vector>

#include "kernels/shade/resolve_rounds.h"
#include "runtime/draw/device_scene.h"
#include "runtime/scene/camera.h"
#include "runtime/threads/parallel.h"
#include "tests/gpu.h"
#include "tests/models.h"
#include "tests/runtime/frame.h"
#include "tests/tools/convert/convert_fixture.h"
#include "tests/tools/jpeg_model.h"

#ifdef SCREE_HAS_CUDA
#include "kernels/cuda/common/check.h"
#include "kernels/cuda/shade/texture_cache.h"
#endif

using namespace scree;
using namespace kernels;
using tests::load_cached;
using tests::TempFolder;

namespace {

/// Shades pixels as on a CPU.
struct OneLane {
  static constexpr bool kMakesTransforms = true;

  static constexpr uint32_t rank() { return 0; }
  static constexpr uint32_t size() { return 1; }
  static uint32_t ballot(bool value) { return value ? 1 : 0; }
  static uint64_t share(uint64_t value, uint32_t) { return value; }
  static void synchronise() {}
};

std::vector<JpegLevel> levels_of(const runtime::Scene& scene) {
  std::vector<JpegLevel> levels;
  for (const runtime::JpegTexture& jpeg : scene.jpeg_textures())
    levels.insert(levels.end(), jpeg.jpeg_levels().begin(), jpeg.jpeg_levels().end());
  for (uint32_t i = 0; i < levels.size(); ++i) REQUIRE(levels[i].number == i);
  return levels;
}

/// A texture cache in host memory, used as in kernels/cuda/shade/texture_cache.cu.
class HostCache {
 public:
  /// `wanted`: the number of slots that fit into its memory. With several sets it is rounded down to whole sets.
  HostCache(std::vector<JpegLevel> levels, uint64_t wanted, const kernels::JpegGroups& groups)
      : levels_(std::move(levels)) {
    const uint32_t slot_bytes = 4 * groups.pixels;
    const uint32_t slots = TextureCache::slots_for(wanted * slot_bytes, slot_bytes);
    const uint32_t sets = TextureCache::sets_for(slots);
    places_.assign(groups.count, TextureCache::kAbsent);
    keys_.assign(size_t{TextureCache::kWays} * sets, TextureCache::kNoKey);
    stamps_.assign(keys_.size(), TextureCache::kNever);
    std::fill_n(stamps_.begin(), slots, 0);
    colours_.resize(size_t{slots} * groups.pixels);
    requests_.resize(slots);
    cache_ = {places_.data(), keys_.data(), stamps_.data(), colours_.data(), requests_.data(),
              levels_.data(), sets,         slots,          groups.pixels};
  }

  const TextureCache& view() const { return cache_; }
  const std::array<RoundCounters, kernels::kDecodeRounds + 1>& counters() const { return counters_; }

  std::vector<uint8_t> resolve(const kernels::ShadeInputs& in, uint32_t side, const std::vector<uint64_t>& samples,
                               uint32_t threads) {
    const auto width = static_cast<uint32_t>(in.view.width) / side;
    const kernels::PixelTiles tiles{width, 0, static_cast<uint32_t>(in.view.height) / side};
    std::vector<uint8_t> pixels(size_t{4} * width * tiles.row_count, 0xcd);
    const auto resolve_of = [&]<class Shader>(const Shader& shader) {
      return kernels::Resolve<Shader>{shader, tiles, samples.data(), side, nullptr, 4, pixels.data()};
    };
    std::vector<kernels::UnfinishedTile> lists[2];
    for (auto& list : lists) list.resize(tiles.count());
    counters_ = {};
    for (uint32_t round = 0; round < counters_.size(); ++round, ++now_) {
      RoundCounters* const own = &counters_[round];
      const uint32_t count = round == 0 ? tiles.count() : counters_[round - 1].tiles;
      kernels::visit_textured<false>(
          in, kernels::CachedTexels{cache_, own, now_, {}}, [&]<class Shader>(const Shader& shader) {
            const kernels::ShadeRound<kernels::Resolve<Shader>> pass{
                resolve_of(shader), round == 0 ? nullptr : lists[(round - 1) % 2].data(), lists[round % 2].data(), own};
            runtime::parallel_for(count, threads, [&](uint64_t i) { pass(static_cast<uint32_t>(i), OneLane{}); });
          });
      const kernels::DecodeGroups decode{cache_, own, now_};
      runtime::parallel_for(decode.count(), threads, [&](uint64_t i) {
        uint32_t staging[kernels::DecodeGroups::kStagingWords];
        decode(static_cast<uint32_t>(i), static_cast<uint32_t>(i) + 1, OneLane{}, staging);
      });
      check();
    }
    kernels::visit_textured<false>(
        in, kernels::FallbackTexels{cache_, now_ - 1, {}}, [&]<class Shader>(const Shader& shader) {
          const kernels::ShadeRound<kernels::Resolve<Shader>> pass{
              resolve_of(shader), lists[kernels::kDecodeRounds % 2].data(), nullptr, nullptr};
          runtime::parallel_for(counters_.back().tiles, threads,
                                [&](uint64_t i) { pass(static_cast<uint32_t>(i), OneLane{}); });
        });
    return pixels;
  }

 private:
  /// Between rounds there are no requests. Every slot with a key has its group's colours, and no other slot is found.
  void check() const {
    CHECK(std::count(places_.begin(), places_.end(), TextureCache::kRequested) == 0);
    const auto there =
        std::count_if(places_.begin(), places_.end(), [](uint8_t place) { return place != TextureCache::kAbsent; });
    CHECK(there == std::count_if(keys_.begin(), keys_.end(), [](uint64_t key) { return key != TextureCache::kNoKey; }));
    std::vector<uint8_t> samples(64 * format::kJpegMaxGroupBlocks);
    uint64_t wrong = 0;
    // A prime step: checks a part of the slots of a large cache, and all slots of a small one.
    const size_t step = keys_.size() > 64 ? 37 : 1;
    for (size_t slot = 0; slot < keys_.size(); slot += step) {
      if (keys_[slot] == TextureCache::kNoKey) continue;
      const uint32_t way = uint32_t{places_.at(keys_[slot])} - 1;
      wrong += cache_.first_slot(keys_[slot], way / TextureCache::kWays) + way % TextureCache::kWays != slot;
      const auto level = std::prev(std::find_if(
          levels_.begin(), levels_.end(), [&](const JpegLevel& other) { return other.first_group > keys_[slot]; }));
      const format::JpegPicture& picture = level->picture;
      const auto group = static_cast<uint32_t>(keys_[slot] - level->first_group);
      format::decode_jpeg_group(picture, group, samples.data());
      const uint32_t mcus = std::min(picture.view.group_mcus, picture.view.mcu_count - group * picture.view.group_mcus);
      const uint32_t* found = colours_.data() + slot * cache_.slot_pixels;
      for (uint32_t mcu = 0; mcu < mcus; ++mcu)
        for (uint32_t y = 0; y < picture.mcu_height; ++y)
          for (uint32_t x = 0; x < picture.mcu_width; ++x)
            wrong += *found++ != format::jpeg_colour(picture, {group, mcu, x, y}, samples.data());
    }
    CHECK(wrong == 0);
  }

  std::vector<JpegLevel> levels_;
  std::vector<uint8_t> places_;
  std::vector<uint64_t> keys_;
  std::vector<uint32_t> stamps_, colours_;
  std::vector<kernels::GroupRequest> requests_;
  std::array<RoundCounters, kernels::kDecodeRounds + 1> counters_{};
  TextureCache cache_{};
  uint32_t now_ = 1;
};

runtime::CameraOptions camera_of(uint32_t width) {
  return {.width = width, .height = width * 2 / 3};
}

/// Views from far away, from near, and a jump to close above one corner and back.
std::vector<kernels::View> views_of(const runtime::Scene& scene) {
  std::vector<kernels::View> views;
  const auto add = [&](const runtime::CameraOptions& camera) {
    views.push_back(must(runtime::make_view(scene, camera)));
  };
  add(camera_of(60));
  add(camera_of(240));
  runtime::CameraOptions close = camera_of(150);
  close.eye = {0.3, 0.4, 0.2};
  close.target = {0.9, 0, 0.8};
  add(close);
  add(camera_of(240));
  kernels::View flat = views[1];
  flat.orthographic = true;
  flat.half_height = 1.2;
  flat.half_width = 1.8;
  flat.z_far = flat.z_near + 100;
  views.push_back(flat);
  return views;
}

std::vector<uint64_t> draw(const runtime::Scene& scene, const kernels::View& view) {
  std::vector<uint64_t> samples(size_t{view.width} * view.height);
  REQUIRE(kernels::draw_cpu(scene.view(), view, samples, 2));
  return samples;
}

/// The picture with completely decoded textures.
std::vector<uint8_t> resolve_whole(const kernels::ShadeInputs& in, uint32_t side,
                                   const std::vector<uint64_t>& samples) {
  const kernels::PixelTiles tiles{static_cast<uint32_t>(in.view.width) / side, 0,
                                  static_cast<uint32_t>(in.view.height) / side};
  std::vector<uint8_t> pixels(size_t{4} * tiles.width * tiles.row_count);
  kernels::visit_shader<false>(in, [&]<class Shader>(const Shader& shader) {
    const kernels::Resolve<Shader> pass{shader, tiles, samples.data(), side, nullptr, 4, pixels.data()};
    for (uint32_t tile = 0; tile < tiles.count(); ++tile) pass(tile, OneLane{});
  });
  return pixels;
}

}  // namespace

TEST_CASE("rounds of decoding give the picture of completely decoded textures, with any cache", "[texture_cache]") {
  const TempFolder folder;
  tests::make_jpeg_model(folder.file("in.glb"));
  convert::ConvertOptions options = tests::options_of(folder);
  options.encoding = GENERATE(convert::Encoding::kIndexed, convert::Encoding::kClustered);
  tests::must_convert(options);
  const runtime::Scene whole = load_cached(folder.file("out.scree"), 0);
  const runtime::Scene scene = load_cached(folder.file("out.scree"), 1);
  const kernels::SrgbTables srgb = kernels::make_srgb_tables();
  const std::vector<kernels::View> views = views_of(whole);
  std::vector<std::vector<uint64_t>> samples;
  std::vector<std::vector<uint8_t>> expected;
  for (const kernels::View& view : views) {
    samples.push_back(draw(whole, view));
    expected.push_back(
        resolve_whole(make_shade_inputs(whole.view(), view, {}, nullptr, &srgb, nullptr), 1, samples.back()));
  }
  REQUIRE(scene.jpeg_groups().pixels > 0);
  for (const uint64_t slots : {1u, 2u, 7u, 8u, 9u, 40u, 300u, 100000u}) {
    for (const uint32_t threads : {1u, 4u}) {
      HostCache cache(levels_of(scene), slots, scene.jpeg_groups());
      CHECK(cache.view().slot_count <= slots);
      CHECK(cache.view().slot_count + TextureCache::kWays > slots);
      uint64_t left = 0;  // tiles whose pixels were decoded one by one
      for (size_t i = 0; i < views.size(); ++i) {
        INFO(slots << " slots, " << threads << " threads, view " << i);
        const kernels::ShadeInputs in = make_shade_inputs(scene.view(), views[i], {}, nullptr, &srgb, nullptr);
        CHECK(cache.resolve(in, 1, samples[i], threads) == expected[i]);
        left += cache.counters().back().tiles;
        if (slots < 100000) continue;
        // Everything fits: there is one round of decoding, and none if the groups are cached.
        CHECK(cache.counters()[1].tiles == 0);
        CHECK(cache.counters()[0].decoded == cache.counters()[0].requests);
        CHECK(cache.resolve(in, 1, samples[i], threads) == expected[i]);
        CHECK(cache.counters()[0].requests == 0);
      }
      if (slots < 10) CHECK(left > 0);
      if (slots == 100000) CHECK(left == 0);
      if (views[0].width % 2 == 0 && threads == 4) {  // four samples per pixel
        const kernels::ShadeInputs in = make_shade_inputs(scene.view(), views[0], {}, nullptr, &srgb, nullptr);
        const kernels::ShadeInputs of_whole = make_shade_inputs(whole.view(), views[0], {}, nullptr, &srgb, nullptr);
        CHECK(cache.resolve(in, 2, samples[0], threads) == resolve_whole(of_whole, 2, samples[0]));
      }
    }
  }
}

TEST_CASE("groups that do not fit into the cache are decoded pixel by pixel", "[texture_cache]") {
  const TempFolder folder;
  tests::make_jpeg_model(folder.file("in.glb"));
  tests::must_convert(tests::options_of(folder));
  const runtime::Scene whole = load_cached(folder.file("out.scree"), 0);
  const runtime::Scene scene = load_cached(folder.file("out.scree"), 1);
  const kernels::SrgbTables srgb = kernels::make_srgb_tables();
  const kernels::View view = views_of(whole)[2];
  const std::vector<uint64_t> samples = draw(whole, view);
  const auto expected = resolve_whole(make_shade_inputs(whole.view(), view, {}, nullptr, &srgb, nullptr), 1, samples);
  const kernels::JpegGroups groups = scene.jpeg_groups();
  for (const bool none_fits : {true, false}) {
    std::vector<JpegLevel> levels = levels_of(scene);
    // Every second level has one group more than the cache expects.
    for (size_t i = 0; i < levels.size(); i += 2) --levels[i].group_count;
    kernels::SceneView changed = scene.view();
    std::vector<kernels::TextureView> textures(changed.textures,
                                               changed.textures + scene.file().container().textures().size());
    for (kernels::TextureView& texture : textures)
      if (texture.jpeg_level_count != 0) texture.jpeg = levels.data() + texture.jpeg[0].number;
    changed.textures = textures.data();
    HostCache cache(levels, 100000, {groups.count, none_fits ? groups.pixels - 1 : groups.pixels});
    CHECK(cache.resolve(make_shade_inputs(changed, view, {}, nullptr, &srgb, nullptr), 1, samples, 2) == expected);
    CHECK((cache.counters()[0].requests == 0) == none_fits);
    CHECK(cache.counters().back().tiles > 0);
  }
}

TEST_CASE("a texture cache keeps recent groups, and evicts the least recent one", "[texture_cache]") {
  constexpr uint32_t kSlots = 64;
  std::vector<uint8_t> places(10000, TextureCache::kAbsent);
  std::vector<uint64_t> keys(kSlots, TextureCache::kNoKey);
  std::vector<uint32_t> stamps(kSlots, 0), colours(kSlots * 64);
  std::vector<kernels::GroupRequest> requests(kSlots);
  const TextureCache cache{places.data(), keys.data(), stamps.data(), colours.data(), requests.data(), nullptr, 8,
                           kSlots,        64};
  const auto allocate_slot = [&](uint64_t key, uint32_t now) { return cache.allocate_slot({key, 0, 0}, now); };
  uint32_t placed = 0;
  for (uint32_t i = 0; i < kSlots; ++i) {
    const uint32_t slot = allocate_slot(i, 1);
    if (slot == TextureCache::kNoSlot) continue;
    ++placed;
    CHECK(cache.find_slot(i) == slot);
    CHECK(cache.colours_of(slot) == colours.data() + size_t{slot} * 64);
  }
  CHECK(placed > kSlots * 3 / 4);  // two sets of eight slots per key
  std::set<uint64_t> kept;
  for (uint32_t i = 0; i < kSlots; i += 2)
    if (const uint32_t slot = cache.find_slot(i); slot != TextureCache::kNoSlot) {
      cache.mark(slot, 2);
      kept.insert(i);
    }
  // Round 2 requests twice as many groups as fit. The groups that the round has used stay.
  for (uint32_t i = 1000; i < 1000 + 2 * kSlots; ++i) (void)allocate_slot(i, 2);
  for (const uint64_t key : kept) CHECK(cache.find_slot(key) != TextureCache::kNoSlot);
  CHECK(allocate_slot(5000, 2) == TextureCache::kNoSlot);
  for (uint32_t i = 1; i < kSlots; i += 2) CHECK(cache.find_slot(i) == TextureCache::kNoSlot);
  // The slot with the older of two stamps in a set is evicted.
  const uint64_t key = 6000;
  for (uint32_t slot = 0; slot < kSlots; ++slot) stamps[slot] = 7;
  const uint32_t oldest = cache.first_slot(key, 1) + 5;
  stamps[oldest] = 6;
  CHECK(allocate_slot(key, 9) == oldest);
}

TEST_CASE("a group is requested once, and requests beyond the limit are dropped", "[texture_cache]") {
  for (const uint32_t slots : {1u, 8u, 1024u}) {
    std::vector<uint64_t> keys(std::max(slots, TextureCache::kWays), TextureCache::kNoKey);
    std::vector<uint32_t> stamps(keys.size(), TextureCache::kNever);
    std::vector<uint8_t> places(4 * size_t{slots} + 8, TextureCache::kAbsent);
    std::vector<kernels::GroupRequest> requests(slots);
    const TextureCache cache{
        places.data(), keys.data(), stamps.data(), nullptr, requests.data(), nullptr, TextureCache::sets_for(slots),
        slots,         64};
    RoundCounters counters{};
    runtime::parallel_for(8, 8, [&](uint64_t thread) {
      for (uint32_t i = 0; i < 20000; ++i) cache.request_group({(i * 7 + thread) % (slots / 2 + 1), 3, i}, &counters);
    });
    CHECK(counters.requests == slots / 2 + 1);
    std::set<uint64_t> requested;
    for (uint32_t i = 0; i < counters.requests; ++i) requested.insert(requests[i].key);
    CHECK(requested.size() == counters.requests);
    for (uint64_t key = 0; key < 4 * uint64_t{slots} + 8; ++key) cache.request_group({key, 3, 0}, &counters);
    CHECK(counters.requests > slots);
    CHECK(static_cast<uint32_t>(std::count(places.begin(), places.end(), TextureCache::kRequested)) == slots);
    for (uint32_t i = 0; i < slots; ++i) {
      CHECK(places[requests[i].key] == TextureCache::kRequested);
      CHECK(requests[i].level == 3);
      (void)cache.allocate_slot(requests[i], 1);
    }
    CHECK(std::count(places.begin(), places.end(), TextureCache::kRequested) == 0);
  }
}

TEST_CASE("on the GPU, JPEG textures equal completely decoded ones, with caches of any size", "[cuda]") {
  if (!tests::has_gpu()) return;
  const TempFolder folder;
  tests::make_jpeg_model(folder.file("in.glb"));
  std::vector<std::string> inputs = {folder.file("in.glb")};
  if (!tests::models_path().empty() && !tests::kEmulatesGpu) {
    const auto helmet = tests::models_path() / "scenes" / "DamagedHelmet" / "DamagedHelmet.glb";
    if (std::filesystem::exists(helmet)) inputs.push_back(helmet.string());
  }
  const auto encoding = GENERATE(convert::Encoding::kIndexed, convert::Encoding::kClustered);
  if (tests::kEmulatesGpu && encoding == convert::Encoding::kIndexed) return;  // the emulator is slow
  for (const std::string& input : inputs) {
    convert::ConvertOptions options = tests::options_of(folder);
    options.encoding = encoding;
    options.input = input;
    tests::must_convert(options);
    const runtime::Scene whole = load_cached(options.output, 0), scene = load_cached(options.output, 1);
    const uint64_t slot_bytes = 4 * scene.jpeg_groups().pixels;
    REQUIRE(slot_bytes > 0);
    auto of_whole = must(runtime::DeviceScene::upload(whole, 0, 2));
    REQUIRE_FALSE(of_whole.texture_counts()->has_value());
    const std::vector<kernels::View> views = views_of(whole);
    for (const uint64_t bytes : {uint64_t{1}, 7 * slot_bytes, 8 * slot_bytes, uint64_t{100000}, uint64_t{1} << 20,
                                 runtime::kDeviceTextureCache}) {
      if (tests::kEmulatesGpu && bytes != 8 * slot_bytes && bytes != runtime::kDeviceTextureCache) continue;
      auto device = must(runtime::DeviceScene::upload(scene, 0, 2, runtime::Reading::kAuto, bytes));
      uint64_t most_left = 0;  // tiles whose pixels were decoded one by one
      for (uint32_t frame = 0; frame < 2 * views.size(); ++frame) {
        INFO(input << ", " << bytes << " bytes, frame " << frame);
        const kernels::View& view = views[frame % views.size()];
        for (const uint32_t side : {1u, 2u}) {
          const auto draw_on = [&](runtime::DeviceScene& on, const runtime::Scene& from) {
            return tests::must_picture(from, view, side, &on);
          };
          const std::vector<uint8_t> expected = draw_on(of_whole, whole);
          CHECK(draw_on(device, scene) == expected);
          const auto counts = must(device.texture_counts());
          REQUIRE(counts.has_value());
          most_left = std::max<uint64_t>(most_left, counts->tiles);
          if (bytes == runtime::kDeviceTextureCache) CHECK(counts->tiles == 0);
        }
        if (bytes != runtime::kDeviceTextureCache) continue;
        // Blocks that are used again are cached, so nothing is decoded.
        const auto again = tests::must_draw(scene, view, 1, &device);
        REQUIRE(again.shade({}, 2));
        CHECK((*device.texture_counts())->asked == 0);
        // The picture equals the CPU's to one level.
        const auto on_cpu = tests::must_picture(scene, view);
        CHECK(tests::differing(on_cpu, must(again.shade({}, 2))) <= on_cpu.size() / 10000);
      }
      if (bytes == 1) CHECK(most_left > 0);
    }
  }
}

TEST_CASE("a GPU's picture does not depend on the memory for pages of JPEGs", "[cuda][texel_pager]") {
  if (!tests::has_gpu()) return;
  const TempFolder folder;
  tests::make_jpeg_model(folder.file("in.glb"));
  const convert::ConvertOptions options = tests::options_of(folder);
  tests::must_convert(options);
  const auto draw_on = [](runtime::DeviceScene* on, const runtime::Scene& from, const kernels::View& view) {
    return tests::must_picture(from, view, 1, on);
  };
  const runtime::Scene whole = load_cached(options.output, 1);
  auto of_whole = must(runtime::DeviceScene::upload(whole, 0, 2));
  const uint64_t all = load_cached(options.output, 1, 1).block_pager()->all_bytes();
  for (const uint64_t memory : {uint64_t{1} << 40, all / 2}) {
    // 64 KiB of pinned memory hold none of the large pages.
    for (const uint64_t host_memory : {uint64_t{0}, uint64_t{1} << 16}) {
      for (const uint64_t cache : {uint64_t{1}, runtime::kDeviceTextureCache}) {
        if (tests::kEmulatesGpu && (host_memory == 0) != (cache == 1)) continue;
        const runtime::Scene scene = load_cached(options.output, 1, memory);
        auto device = must(runtime::DeviceScene::upload(scene, 0, 2, runtime::Reading::kAuto, cache, host_memory));
        const runtime::BlockPager* const pager = device.block_pager();
        REQUIRE(pager != nullptr);
        for (const kernels::View& view : views_of(scene)) {
          CAPTURE(memory, host_memory, cache, view.width);
          const auto expected = draw_on(&of_whole, whole, view);
          CHECK(draw_on(&device, scene, view) == expected);
          CHECK(pager->resident_bytes() <= memory);
          if (memory != uint64_t{1} << 40) continue;
          const uint64_t read = pager->stats().read_pages;
          CHECK(draw_on(&device, scene, view) == expected);
          CHECK(pager->stats().read_pages == read);
        }
        CHECK(pager->stats().read_pages != 0);
      }
    }
  }
}

#ifdef SCREE_HAS_CUDA
TEST_CASE("the GPU and the CPU decode every group of a JPEG to the same samples", "[cuda]") {
  if (!tests::has_gpu()) return;
  const TempFolder folder;
  tests::make_jpeg_model(folder.file("in.glb"));
  tests::must_convert(tests::options_of(folder));
  const runtime::Scene scene = load_cached(folder.file("out.scree"), 1);
  auto device = must(runtime::DeviceScene::upload(scene, 0, 2));
  const uint32_t slot_bytes = scene.jpeg_slot_bytes();
  const std::vector<JpegLevel> levels = levels_of(scene);
  std::vector<kernels::TextureView> textures(scene.view().texture_count);
  REQUIRE(kernels::cuda_check(cudaMemcpy(textures.data(), device.device_view().textures,
                                         textures.size() * sizeof textures[0], cudaMemcpyDeviceToHost),
                              "reading the textures"));
  uint64_t looked = 0;
  for (size_t t = 0; t < textures.size(); ++t) {
    for (uint32_t l = 0; l < textures[t].jpeg_level_count; ++l, ++looked) {
      const format::JpegPicture& picture = scene.view().textures[t].jpeg[l].picture;
      const uint32_t groups = (picture.view.mcu_count - 1) / picture.view.group_mcus + 1;
      std::vector<uint8_t> expected(size_t{groups} * slot_bytes, 0);
      for (uint32_t group = 0; group < groups; ++group)
        format::decode_jpeg_group(picture, group, expected.data() + size_t{group} * slot_bytes);
      auto out = must(kernels::DeviceBuffer::allocate(expected.size(), "allocating samples"));
      REQUIRE(kernels::cuda_check(cudaMemset(out.data(), 0, expected.size()), "clearing samples"));
      REQUIRE(kernels::CudaTextureCache::decode(textures[t].jpeg + l, groups, reinterpret_cast<uint8_t*>(out.data()),
                                                slot_bytes, nullptr));
      std::vector<uint8_t> found(expected.size());
      REQUIRE(kernels::cuda_check(cudaMemcpy(found.data(), out.data(), found.size(), cudaMemcpyDeviceToHost),
                                  "reading samples"));
      INFO("texture " << t << ", level " << l);
      CHECK(found == expected);
    }
  }
  CHECK(looked > 6);
}
#endif
