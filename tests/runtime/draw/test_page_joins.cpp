// Split pages of streamed chunks, which a GPU joins in its pool. Samples and errors equal the CPU's.
#include <algorithm>
#include <cmath>
#include <optional>
#include <random>
#include <set>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "runtime/draw/device_list.h"
#include "runtime/draw/device_scene.h"
#include "runtime/draw/page_joins.h"
#include "runtime/stream/chunk_source.h"
#include "tests/gpu.h"
#include "tests/models.h"
#include "tests/runtime/damaged_page.h"
#include "tests/runtime/frame.h"
#include "tests/runtime/load_scene.h"
#include "tests/runtime/paged_scene.h"
#include "tests/runtime/soup.h"

#if defined(SCREE_EMULATED_CUDA)
#include "tests/emulator/machine.h"
#endif

namespace scree::tests {
namespace {

using format::SealedPage;
using kernels::View;
using namespace runtime;
using tests::Frame;

constexpr Encoding kClusters{.clusters = Clusters::kClustered};

/// The bytes of the drawn chunks in split pages, and in all pages.
std::pair<uint64_t, uint64_t> joinable_bytes(const Scene& scene) {
  uint64_t split = 0, all = 0;
  const std::vector<uint64_t> bytes = runtime::ChunkSource(scene).chunk_bytes();
  for (uint64_t c = 0; c < bytes.size(); ++c) {
    const format::PageRecord& page = scene.container().pages()[scene.container().chunks()[c].page];
    split += page.codec == format::PageCodec::kSplit ? bytes[c] : 0;
    all += bytes[c];
  }
  return {split, all};
}

/// Uploads with a pool for the whole scene.
Result<DeviceScene> upload_with_joins(const Scene& scene, uint64_t host_memory = 0) {
  return DeviceScene::upload(scene, 0, 3, Reading::kMapped, 0, host_memory, {}, nullptr, 1, true);
}

bool draws_as_cpu(DeviceScene& device, const Scene& scene, const Scene& whole, const View& view) {
  const Frame expected = must_draw(whole, view);
  Frame frame = must_draw(scene, view, 1, &device);
  must(frame.read_samples());
  return std::ranges::equal(frame.samples(), expected.samples());
}

}  // namespace

TEST_CASE("a GPU joins the split pages of streamed chunks", "[cuda][stream]") {
  if (!has_gpu()) return;
  const TempFolder folder;
  const std::string path = folder.file("a.scree");
  PagedScene paged{.drawn_twice = true};
  for (const uint64_t page_bytes : {9000, 40000}) {
    for (const uint32_t zstd_every : {1u, 2u}) {
      CAPTURE(page_bytes, zstd_every);
      paged.page_bytes = page_bytes;
      paged.zstd_every = zstd_every;
      paged.write(path, clustered_meshes(40));
      const Scene whole = must_load(path), scene = must_load(path, {.threads = 2, .pages = false});
      const auto [split, all] = joinable_bytes(scene);
      REQUIRE(split > 0);
      CHECK((zstd_every == 1 || split < all));
      const View view = must_view(whole, {.width = 120, .height = 80});
      std::optional<DeviceScene> made = must(upload_with_joins(scene));
      DeviceScene& device = *made;
      CHECK(draws_as_cpu(device, scene, whole, view));
      REQUIRE(device.stream_stats());
      CHECK(device.stream_stats()->joined_bytes > 0);
      CHECK(device.stream_stats()->joined_bytes <= split);
      if (split == all) CHECK(device.stream_stats()->joined_bytes == device.stream_stats()->streamed_bytes);
      while (must(device.load_rest()) != 0) {
      }
      CHECK_FALSE(device.is_streamed());
      CHECK(draws_as_cpu(device, scene, whole, view));
      made.reset();
      // With little pinned memory there are fewer slots, or the CPU joins the pages.
      for (const uint64_t host_memory : {uint64_t{1} << 20, uint64_t{150} << 10}) {
#if defined(SCREE_EMULATED_CUDA)
        emulator::reset_peaks();
#endif
        DeviceScene small = must(upload_with_joins(scene, host_memory));
        CHECK(draws_as_cpu(small, scene, whole, view));
#if defined(SCREE_EMULATED_CUDA)
        CHECK(emulator::pinned_memory().peak <= host_memory);
#endif
      }
    }
  }
}

TEST_CASE("chunks that a GPU joins are dropped and joined again", "[cuda][stream]") {
  if (!has_gpu()) return;
  const TempFolder folder;
  const std::string path = folder.file("large.scree");
  PagedScene paged{.page_bytes = 3000, .zstd_every = 1};
  std::mt19937 random(3);
  std::vector<std::pair<Soup, Encoding>> meshes;
  for (int i = 0; i < 3; ++i) {
    meshes.emplace_back(grid(40, 0.1 * i), kClusters);
    meshes.emplace_back(triangles_around(4500, random), Encoding{.float32 = true});
  }
  paged.write(path, meshes);
  const Scene whole = must_load(path), scene = must_load(path, {.threads = 2, .pages = false});
  const uint64_t least = least_device_memory(refusal(DeviceScene::upload(scene, 1, 2, Reading::kAuto, 0)).message);
  const auto [split, all] = joinable_bytes(scene);
  // An eighth of this memory is for joins.
  const uint64_t more = 8 * (uint64_t{24} << 10);
  REQUIRE(all > more + more / 8);
  DeviceScene device = must(DeviceScene::upload(scene, least + more, 2, Reading::kAuto, 0));
  REQUIRE(device.is_streamed());
  CHECK(device.stats().device_bytes <= least + more);
  uint64_t joined = 0;
  for (int i = 0; i < 4; ++i) {
    runtime::CameraOptions camera{.width = 60, .height = 40};
    camera.eye = runtime::Vec3{i % 2 == 0 ? 4.0 : -4.0, 1, i % 2 == 0 ? 6.0 : -6.0};
    camera.target = runtime::Vec3{0, 0, 0};
    CHECK(draws_as_cpu(device, scene, whole, must_view(whole, camera)));
    joined += must(device.stream_stats()).joined_bytes;
  }
  CHECK(joined > split);
}

TEST_CASE("no slot is joined twice", "[cuda][stream]") {
  if (!has_gpu()) return;
  constexpr uint32_t kSlots = kernels::kMostJoinSlots;
  const PageJoins::Sizes sizes =
      PageJoins::sizes_for({2048, 4096, UINT64_MAX, kSlots}, uint64_t{1} << 20, uint64_t{1} << 20);
  REQUIRE(sizes.region_bytes >= kSlots * 1024);
  const kernels::DeviceBuffer arena = must(kernels::DeviceBuffer::allocate(kSlots * 256, "a test"));
  const auto sync = [] { must(kernels::cuda_check(cudaDeviceSynchronize(), "a test")); };
  const auto fill = [&](int value) {
    must(kernels::cuda_check(cudaMemset(arena.data(), value, kSlots * 256), "a test"));
    sync();
  };
  const auto holds = [&](int value) {
    std::vector<std::byte> bytes(kSlots * 256);
    must(kernels::cuda_check(cudaMemcpy(bytes.data(), arena.data(), bytes.size(), cudaMemcpyDeviceToHost), "a test"));
    return std::ranges::all_of(bytes, [&](std::byte byte) { return byte == static_cast<std::byte>(value); });
  };
  int device = 0;
  must(kernels::cuda_check(cudaGetDevice(&device), "a test"));
  PageJoins joins;
  must(joins.open(sizes, device, arena.data()));
  // Each load fills a region, so that the next region is open when the load ends. From the fifth load on, that region
  // was full once before.
  for (uint32_t load = 0; load < 6; ++load) {
    fill(1);
    must(joins.begin(load, nullptr, nullptr));
    for (uint32_t i = 0; i < kSlots; ++i) {
      const PageJoins::Slot slot = must(joins.take());
      std::fill_n(slot.memory.begin(), 256, std::byte{2});
      runtime::JoinPlan plan;
      plan.add_copy({0, uint64_t{256} * i}, 256);
      CHECK(must(joins.join(slot, 256, plan)));
    }
    sync();
    CHECK(holds(2));
    fill(3);
    must(joins.end(nullptr));
    sync();
    CHECK(holds(3));
    CHECK(joins.has_joined(load));
  }
}

TEST_CASE("any thread may start joins on the scene's GPU", "[cuda][stream]") {
  const EmulatedGpus gpus("9.0,9.0");
  if (!has_gpus(2)) return;
  must(set_current_gpu(1));
  const PageJoins::Sizes sizes =
      PageJoins::sizes_for({2048, 4096, UINT64_MAX, 2}, uint64_t{1} << 20, uint64_t{64} << 10);
  const kernels::DeviceBuffer arena = must(kernels::DeviceBuffer::allocate(sizes.slots * 256, "a test"));
  PageJoins joins;
  must(joins.open(sizes, 1, arena.data()));
  must(joins.begin(0, nullptr, nullptr));
  const auto join = [&](uint32_t i) -> Result<void> {
    const PageJoins::Slot slot = SCREE_TRY(joins.take());
    runtime::JoinPlan plan;
    plan.add_copy({0, uint64_t{256} * i}, 256);
    CHECK(SCREE_TRY(joins.join(slot, 256, plan)));
    return {};
  };
  for (uint32_t i = 0; i < sizes.slots; ++i) must(join(i));
  Result<void> joined;
  std::thread([&] {  // its current GPU is the first one
    for (uint32_t i = 0; i < kernels::kMostJoinSlots && joined; ++i) joined = join(i % sizes.slots);
  })
      .join();
  CHECK(joined);
  must(joins.end(nullptr));
  must(kernels::cuda_check(cudaDeviceSynchronize(), "a test"));
  CHECK(joins.has_joined(0));
  must(set_current_gpu(0));
}

TEST_CASE("chunks are joined behind the moves of all earlier loads", "[cuda][stream]") {
  if (!has_gpu()) return;
  const TempFolder folder;
  const std::string path = folder.file("moved.scree");
  PagedScene paged{.page_bytes = 3000, .zstd_every = 1, .image_every = 10000};
  std::mt19937 random(5);
  std::vector<std::pair<Soup, Encoding>> meshes;  // of one chunk each
  for (int i = 0; i < 800; ++i)
    meshes.emplace_back(grid(static_cast<uint32_t>(2 + random() % 11), 0.01 * (i % 40)), kClusters);
  paged.write(path, meshes);
  const Scene whole = must_load(path), scene = must_load(path, {.threads = 2, .pages = false});
  const uint64_t least = least_device_memory(refusal(DeviceScene::upload(scene, 1, 2, Reading::kAuto, 0)).message);
  // An eighth of this memory is for joins.
  const uint64_t more = 8 * (uint64_t{24} << 10);
  REQUIRE(joinable_bytes(scene).first > 2 * more);
  uint64_t moved = 0;
  DeviceScene device = must(DeviceScene::upload(scene, least + more, 2, Reading::kAuto, 0));
  REQUIRE(device.is_streamed());
  for (int i = 0; i < (kEmulatesGpu ? 12 : 60); ++i) {  // some of their loads only move chunks
    runtime::CameraOptions camera{.width = 60, .height = 40};
    const double angle = 2.4 * i;
    camera.eye = runtime::Vec3{7 * std::cos(angle), 1, 7 * std::sin(angle)};
    camera.target = runtime::Vec3{0, 0, 0};
    CHECK(draws_as_cpu(device, scene, whole, must_view(whole, camera)));
    CHECK(device.stream_stats()->joined_bytes == device.stream_stats()->streamed_bytes);
    moved += device.stream_stats()->moved_bytes;
  }
  CHECK(moved > 0);
}

TEST_CASE("damaged split pages of streamed chunks give the CPU's errors", "[cuda][stream]") {
  if (!has_gpu()) return;
  const TempFolder folder;
  const std::string path = folder.file("bad.scree");
  std::mt19937 random(3);
  const std::vector<std::pair<Soup, Encoding>> meshes = clustered_meshes(40);
  uint32_t refused = 0;
  std::set<uint64_t> accepted;
  for (int i = 0; i < (kEmulatesGpu ? 16 : 300); ++i) {
    PagedScene paged{.zstd_every = 1, .image_every = 1000};
    const uint32_t damaged = random() % 8;
    paged.change = [&](uint32_t number, SealedPage& page) {
      if (page.record.codec != format::PageCodec::kSplit || number % 8 != damaged) return;
      damage_split_page(page, random);
    };
    paged.write(path, meshes);
    Scene whole = must_load(path, {.pages = false});
    const Result<void> loaded = whole.load_pages(2);
    const Scene scene = must_load(path, {.threads = 2, .pages = false});
    // All chunks are kept in host memory, and were joined before.
    Result<DeviceScene> kept = upload_with_joins(scene, uint64_t{64} << 20);
    REQUIRE(bool(kept) == bool(loaded));
    if (kept) {
      CHECK(draws_as_cpu(*kept, scene, whole, must_view(whole, {.width = 60, .height = 40})));
      CHECK(kept->stream_stats()->joined_bytes == 0);  // this frame joined nothing
    } else {
      CHECK(kept.error().message == loaded.error().message);
    }
    DeviceScene device = must(upload_with_joins(scene));
    if (loaded) {  // the positions may differ
      CHECK(draws_as_cpu(device, scene, whole, must_view(whole, {.width = 60, .height = 40})));
      accepted.insert(device.stream_stats()->joined_bytes);
      continue;
    }
    ++refused;
    for (int again = 0; again < 2; ++again) {
      CHECK(path + ": " + refusal(device.load_rest()).message == loaded.error().message);
      CHECK(device.is_streamed());  // the scene does not count as loaded
    }
  }
  CHECK(refused > 3);
  CHECK(!accepted.empty());
}

TEST_CASE("memory for joining streamed chunks stays within its limits", "[stream]") {
  const uint64_t page = uint64_t{2} << 20;
  for (const uint64_t device : {uint64_t{0}, uint64_t{1} << 20, uint64_t{8} << 20, uint64_t{1} << 30})
    for (const uint64_t pinned : {uint64_t{0}, uint64_t{3} << 20, uint64_t{1} << 30})
      for (const uint32_t threads : {1u, 16u, 128u}) {
        for (const uint64_t slots : {uint64_t{0}, uint64_t{3}, UINT64_MAX}) {
          const PageJoins::Sizes sizes = PageJoins::sizes_for({page / 2, page, slots, threads}, device, pinned);
          CAPTURE(device, pinned, threads, slots);
          CHECK(sizes.any() == (device >= uint64_t{8} << 20 && pinned >= uint64_t{3} << 20 && slots != 0));
          CHECK(sizes.device_bytes() <= std::min(device, uint64_t{320} << 20));
          CHECK(sizes.pinned_bytes() <= pinned);
          CHECK(sizes.slots <= slots);
          if (sizes.any()) CHECK(sizes.region_bytes >= sizes.whole_slot());
        }
      }
  CHECK_FALSE(PageJoins::sizes_for({0, 0, 4, 4}, page, page).any());
}

}  // namespace scree::tests
