// The library from many threads at once. scripts/sanitize-threads runs these tests under ThreadSanitizer.
#include <malloc.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <mutex>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "tests/library/shots.h"
#include "tests/sanitized.h"

using namespace scree::tests;

namespace {

constexpr size_t kThreads = 8;

uint64_t resident_bytes() {
  std::ifstream file("/proc/self/statm");
  uint64_t all = 0, resident = 0;
  file >> all >> resident;
  return resident * static_cast<uint64_t>(sysconf(_SC_PAGESIZE));
}

size_t open_files() {
  size_t count = 0;
  for ([[maybe_unused]] const auto& file : std::filesystem::directory_iterator("/proc/self/fd")) ++count;
  return count;
}

size_t mapped_scenes() {
  std::ifstream maps("/proc/self/maps");
  size_t count = 0;
  for (std::string line; std::getline(maps, line);) count += line.find(".scree") != std::string::npos ? 1 : 0;
  return count;
}

scree_scene* load_scene(const std::string& path, uint32_t threads) {
  scree_file* file = nullptr;
  if (scree_open(path.c_str(), &file) != SCREE_OK) return nullptr;
  auto options = sized<scree_load_options>();
  options.backend = SCREE_BACKEND_CPU;
  options.threads = threads;
  options.texture_cache = 1;  // so that blocks of textures are decoded repeatedly
  scree_scene* scene = nullptr;
  const scree_status loaded = scree_load(file, &options, &scene);
  if (scree_close(file) != SCREE_OK || loaded != SCREE_OK) return nullptr;
  return scene;
}

/// The bytes of a layer as one number; 0 if the call fails.
size_t hash_of(scree_view* view, scree_layer layer) {
  auto array = sized<scree_array>();
  if (scree_host_layer(view, layer, &array) != SCREE_OK) return 0;
  return std::hash<std::string_view>()({static_cast<const char*>(array.data), array.bytes}) | 1;
}

/// A scene file, and the layers of every shot as drawn by one thread.
struct ExpectedScene {
  std::string path;
  std::vector<std::array<size_t, std::size(kAllLayers)>> frames;
};

/// Scenes that all threads draw, and that any thread may replace at any time.
class SharedScenes {
 public:
  explicit SharedScenes(const std::vector<ExpectedScene>& expected) {
    for (const ExpectedScene& scene : expected) scenes_.push_back(load_scene(scene.path, 2));
  }
  SharedScenes(const SharedScenes&) = delete;
  SharedScenes& operator=(const SharedScenes&) = delete;
  ~SharedScenes() {
    for (scree_scene* const scene : scenes_) (void)scree_unload(scene);
  }
  scree_scene* get(size_t i) {
    const std::lock_guard<std::mutex> lock(mutex_);
    return scenes_[i];
  }
  bool replace(size_t i, scree_scene* scene) {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      std::swap(scenes_[i], scene);
    }
    return scree_unload(scene) == SCREE_OK;
  }

 private:
  std::mutex mutex_;
  std::vector<scree_scene*> scenes_;
};

/// One of the threads. Every function returns whether the result is right, because Catch's macros may be used by one
/// thread only.
class Drawer {
 public:
  Drawer(const std::vector<ExpectedScene>& expected, const std::vector<Shot>& shots, SharedScenes& shared,
         uint32_t seed)
      : expected_(expected), shots_(shots), shared_(shared), random_(seed) {}
  ~Drawer() { (void)scree_view_destroy(view_); }
  Drawer(const Drawer&) = delete;
  Drawer& operator=(const Drawer&) = delete;

  bool draw_next() {
    if ((view_ == nullptr || below(4) == 0) && !renew()) return false;
    const size_t shot = below(shots_.size());
    switch (below(4)) {
      case 0:
        return draw_batch(shot);
      case 1:
        return draw_and_hold(shot);
      default:
        return draw(shot) && is_right(shot, kAllLayers[below(std::size(kAllLayers))]);
    }
  }

 private:
  size_t below(size_t end) { return random_() % end; }

  /// Switches to another view: of a shared scene, or of a scene that this thread opens and immediately closes.
  bool renew() {
    if (scree_view_destroy(view_) != SCREE_OK) return false;
    view_ = nullptr;
    while (view_ == nullptr) {
      scene_ = below(expected_.size());
      const bool is_own = below(4) == 0;
      scree_scene* const loaded =
          is_own || below(8) == 0 ? load_scene(expected_[scene_].path, below(2) == 0 ? 1 : 2) : nullptr;
      if (loaded != nullptr && !is_own && !shared_.replace(scene_, loaded)) return false;
      scree_scene* const drawn = is_own ? loaded : shared_.get(scene_);
      const scree_status made = scree_view_create(drawn, &view_);
      if (is_own && (made != SCREE_OK || scree_unload(loaded) != SCREE_OK)) return false;
      // Another thread may have replaced the scene meanwhile.
      if (made != SCREE_OK && made != SCREE_ERROR_HANDLE) return false;
    }
    return true;
  }

  bool draw(size_t shot) { return scree_draw(view_, &shots_[shot].camera, &shots_[shot].options) == SCREE_OK; }

  bool is_right(size_t shot, scree_layer layer) {
    return hash_of(view_, layer) == expected_[scene_].frames[shot][layer];
  }

  bool draw_batch(size_t shot) {
    const std::array<scree_camera, 2> cameras{shots_[shot].camera, shots_[shot].camera};
    scree_layer layer = kAllLayers[below(std::size(kAllLayers))];
    if (layer == SCREE_SAMPLES || layer == SCREE_LINEAR) layer = SCREE_COLOR;
    if (scree_draw_batch(view_, cameras.data(), 2, &shots_[shot].options, kPixelLayers) != SCREE_OK) return false;
    auto array = sized<scree_array>();
    if (scree_host_layer(view_, layer, &array) != SCREE_OK) return false;
    for (size_t i = 0; i < 2; ++i) {
      const std::string_view one(static_cast<const char*>(array.data) + i * (array.bytes / 2), array.bytes / 2);
      if ((std::hash<std::string_view>()(one) | 1) != expected_[scene_].frames[shot][layer]) return false;
    }
    return true;
  }

  /// Holds a layer longer than its view, whose scene another thread may have unloaded.
  bool draw_and_hold(size_t shot) {
    if (!draw(shot)) return false;
    auto pick = sized<scree_pick_info>();
    if (scree_pick(view_, 0, 0, &pick) != SCREE_OK) return false;
    if (scree_shade(view_, &shots_[(shot + 1) % shots_.size()].options) != SCREE_OK) return false;
    if (hash_of(view_, SCREE_COLOR) == 0) return false;
    if (scree_shade(view_, &shots_[shot].options) != SCREE_OK) return false;
    auto array = sized<scree_array>();
    scree_memory* memory = nullptr;
    if (scree_host_layer(view_, SCREE_COLOR, &array) != SCREE_OK) return false;
    if (scree_hold(view_, &array, &memory) != SCREE_OK || scree_view_destroy(view_) != SCREE_OK) return false;
    view_ = nullptr;
    const std::string_view bytes(static_cast<const char*>(array.data), array.bytes);
    const bool is_kept = (std::hash<std::string_view>()(bytes) | 1) == expected_[scene_].frames[shot][SCREE_COLOR];
    return scree_release(memory) == SCREE_OK && is_kept;
  }

  const std::vector<ExpectedScene>& expected_;
  const std::vector<Shot>& shots_;
  SharedScenes& shared_;
  std::mt19937 random_;
  scree_view* view_ = nullptr;
  size_t scene_ = 0;  // the scene of the view
};

}  // namespace

TEST_CASE("eight threads draw random frames of scenes that they open and close", "[library][threads]") {
  const TempFolder folder;
  // SCREE_THREAD_FRAMES=10000 is the long run.
  const char* const frames = std::getenv("SCREE_THREAD_FRAMES");
  const size_t count = frames != nullptr ? std::stoul(frames) : kIsSanitized ? 160 : 4000;
  const std::vector<Shot> shots = random_shots(std::min<size_t>(60, count / 20), 2);
  std::vector<ExpectedScene> expected;
  // Models with JPEG and other textures, several instances, layers of glass, several materials, and masks.
  for (const char* const model :
       {"textured_cube.glb", "two_instances.gltf", "glass.glb", "materials.gltf", "masked.glb"}) {
    ExpectedScene& scene = expected.emplace_back();
    scene.path = packed(folder, model);
    const Opened opened(scene.path);
    for (const Shot& shot : shots) {
      must(scree_draw(opened.view, &shot.camera, &shot.options));
      auto& frame = scene.frames.emplace_back();
      for (const scree_layer layer : kAllLayers) frame[layer] = hash_of(opened.view, layer);
    }
  }

  constexpr size_t kRounds = 4;
  const size_t files_before = open_files();
  std::atomic<size_t> wrong{0};
  uint64_t settled = 0;
  for (size_t round = 0; round < kRounds; ++round) {
    {
      SharedScenes shared(expected);
      std::vector<std::thread> threads;
      for (size_t t = 0; t < kThreads; ++t)
        threads.emplace_back([&, t] {
          Drawer drawer(expected, shots, shared, static_cast<uint32_t>(round * kThreads + t));
          for (size_t i = t; i < count / kRounds; i += kThreads)
            if (!drawer.draw_next()) ++wrong;
        });
      for (std::thread& thread : threads) thread.join();
    }
    (void)malloc_trim(0);
    if (round == 0) settled = resident_bytes();
  }
  CHECK(wrong == 0);
  CHECK(open_files() == files_before);
  const uint64_t last = resident_bytes();
  if (frames != nullptr) WARN(count << " frames: " << settled << " bytes after a quarter, " << last << " at the end");
  // Sanitizers keep freed memory. The allocator's pools differ by some MiB from run to run, while a leak per frame
  // would count hundreds of times.
  if (!kIsSanitized) CHECK(last < settled + (uint64_t{8} << 20));
  CHECK(mapped_scenes() == 0);
}

TEST_CASE("two views of one scene are drawn by two threads at once", "[library][threads]") {
  const TempFolder folder;
  const Opened opened(packed(folder, "two_instances.gltf"));
  const std::vector<Shot> shots = random_shots(kIsSanitized ? 10 : 100, 12);
  std::vector<std::string> expected;
  for (const Shot& shot : shots) {
    must(scree_draw(opened.view, &shot.camera, &shot.options));
    expected.push_back(frame_of(opened.view));
  }
  scree_view* views[2] = {};
  for (scree_view*& view : views) must(scree_view_create(opened.scene, &view));
  std::atomic<size_t> wrong{0};
  std::vector<std::thread> threads;
  for (size_t t = 0; t < 2; ++t)
    threads.emplace_back([&, t] {
      for (size_t n = 0; n < shots.size(); ++n) {
        const size_t i = t == 0 ? n : shots.size() - 1 - n;
        bool good = scree_draw(views[t], &shots[i].camera, &shots[i].options) == SCREE_OK;
        std::string bytes;
        for (const scree_layer layer : kAllLayers) {
          auto array = sized<scree_array>();
          good = good && scree_host_layer(views[t], layer, &array) == SCREE_OK;
          if (good) bytes.append(static_cast<const char*>(array.data), array.bytes);
        }
        if (!good || bytes != expected[i]) ++wrong;
      }
    });
  for (std::thread& thread : threads) thread.join();
  CHECK(wrong == 0);
  for (scree_view* const view : views) must(scree_view_destroy(view));
}

TEST_CASE("a file is closed while other threads read its records", "[library][threads]") {
  const TempFolder folder;
  const std::string path = packed(folder);
  std::atomic<scree_file*> current{nullptr};
  std::atomic<bool> ends{false};
  std::atomic<size_t> wrong{0};
  std::vector<std::thread> threads;
  for (size_t t = 0; t < 2; ++t)
    threads.emplace_back([&] {
      while (!ends) {
        scree_file* const file = current;
        if (file == nullptr) continue;
        auto info = sized<scree_file_info>();
        const scree_status status = scree_get_file_info(file, &info);
        if (status == SCREE_OK ? info.triangles != 12 : status != SCREE_ERROR_HANDLE) ++wrong;
      }
    });
  for (size_t i = 0; i < (kIsSanitized ? 2000 : 20000); ++i) {
    scree_file* file = nullptr;
    must(scree_open(path.c_str(), &file));
    current = file;
    must(scree_close(file));
  }
  ends = true;
  for (std::thread& thread : threads) thread.join();
  CHECK(wrong == 0);
}
