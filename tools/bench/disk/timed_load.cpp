#include "tools/bench/disk/timed_load.h"

#include <algorithm>
#include <cstring>
#include <fstream>
#include <new>
#include <optional>
#include <span>
#include <utility>

#include "format/container/checksum.h"
#include "runtime/draw/device_scene.h"
#include "runtime/draw/renderer.h"
#include "runtime/files/direct_file.h"
#include "runtime/scene/scene.h"
#include "runtime/threads/stopwatch.h"
#include "tools/bench/setup/file_views.h"

namespace scree::bench {
namespace {

using runtime::Reading;

/// The ring in host memory; a copy is done when copy() returns.
class HostRing final : public runtime::UploadTarget {
 public:
  HostRing(const runtime::StagingSizes& sizes, std::byte* arena)
      : slot_bytes_(sizes.slot_bytes), memory_(runtime::direct_memory(sizes.bytes())), arena_(arena) {}

  std::byte* slot(uint32_t slot) override { return memory_.get() + slot * slot_bytes_; }
  Result<void> copy(uint32_t slot, uint64_t to, uint64_t bytes) override {
    std::memcpy(arena_ + to, this->slot(slot), bytes);
    return {};
  }
  Result<void> wait(uint32_t) override { return {}; }

 private:
  uint64_t slot_bytes_;
  runtime::DirectMemory memory_;
  std::byte* arena_;
};

/// Bytes that the system could give without swapping; as much as can be named where it does not say.
uint64_t available_memory() {
  std::ifstream info("/proc/meminfo");
  std::string key;
  for (uint64_t kibibytes = 0; info >> key >> kibibytes; info.ignore(64, '\n'))
    if (key == "MemAvailable:") return kibibytes * 1024;
  return ~uint64_t{0};
}

Reading reading_of(LoadWay way) {
  switch (way) {
    case LoadWay::kArenaMapped:
    case LoadWay::kGpuMapped:
      return Reading::kMapped;
    case LoadWay::kArenaBuffered:
    case LoadWay::kGpuBuffered:
      return Reading::kBuffered;
    case LoadWay::kArenaDirect:
    case LoadWay::kGpuDirect:
      return Reading::kDirect;
    case LoadWay::kMap:
    case LoadWay::kGpu:
      break;
  }
  return Reading::kAuto;
}

/// The file without the pages of geometry that the scene does not draw.
uint64_t read_bytes(const runtime::Scene& scene) {
  uint64_t bytes = scene.file().map().size();
  for (uint64_t i = 0; i < scene.container().pages().size(); ++i) {
    const format::PageRecord& page = scene.container().pages()[i];
    if (page.kind == format::PageKind::kGeometry) bytes -= page.stored_bytes;
  }
  for (uint64_t i = 0; i < scene.drawn_pages().size(); ++i) bytes += scene.drawn_pages().record(i).stored_bytes;
  return bytes;
}

uint64_t raw_bytes(const runtime::DrawnPages& pages) {
  uint64_t bytes = 0;
  for (uint64_t i = 0; i < pages.size(); ++i) bytes += pages.record(i).raw_bytes;
  return bytes;
}

/// A scene that is loading, and what it is drawn from in the end.
class Loading {
 public:
  Loading(const std::string& path, LoadWay way, const HostArena& arena, const LoadSettings& settings)
      : path_(path), way_(way), arena_(arena), settings_(settings) {}

  Result<TimedLoad> run() {
    TimedLoad load;
    const runtime::Stopwatch watch;
    if (const auto done = make_resident(load); !done) return done.error();
    const runtime::Duration resident = watch.elapsed();
    load.resident_s = resident.wall_ms * 1e-3;
    load.resident_cpu_s = resident.cpu_ms * 1e-3;
    const Result<std::vector<uint8_t>> pixels = draw();
    if (!pixels) return pixels.error();
    load.first_frame_s = watch.elapsed().wall_ms * 1e-3;
    load.picture = format::checksum(std::as_bytes(std::span(*pixels)));
    load.file_bytes = scene_->file().map().size();
    load.read_bytes = read_bytes(*scene_);
    return load;
  }

 private:
  Result<void> make_resident(TimedLoad& load) {
    runtime::SceneOptions options;
    options.threads = settings_.threads;
    options.pages = way_ == LoadWay::kMap;
    options.texture_cache = runtime::kHostTextureCache;
    Result<runtime::Scene> scene = runtime::Scene::open(path_, options);
    if (!scene) return scene.error();
    scene_.emplace(std::move(*scene));
    const uint64_t textures = scene_->stats().texture_bytes + scene_->stats().jpeg_bytes;
    load.device_bytes = raw_bytes(scene_->drawn_pages()) + textures;
    switch (way_) {
      case LoadWay::kMap:
        return {};
      case LoadWay::kArenaMapped:
      case LoadWay::kArenaBuffered:
      case LoadWay::kArenaDirect:
        return fill_arena(load);
      case LoadWay::kGpuMapped:
      case LoadWay::kGpuBuffered:
      case LoadWay::kGpuDirect:
      case LoadWay::kGpu:
        break;
    }
    Result<runtime::DeviceScene> device = runtime::DeviceScene::upload(*scene_, 0, settings_.threads, reading_of(way_));
    if (!device) return device.error();
    device_.emplace(std::move(*device));
    load.device_bytes = device_->stats().device_bytes;
    load.direct_bytes = device_->stats().counts.direct_bytes;
    return {};
  }

  Result<void> fill_arena(TimedLoad& load) {
    const runtime::DrawnPages& pages = scene_->drawn_pages();
    const runtime::MappedFile& map = scene_->file().map();
    runtime::UploadPlan plan;
    plan.add_pages(pages);
    if (plan.bytes() > arena_.bytes()) return Error{ErrorCode::kRange, path_ + ": has become larger"};
    const Reading reading = reading_of(way_);
    const runtime::StagingSizes sizes = runtime::staging_for(plan, reading, settings_.threads);
    HostRing ring(sizes, arena_.data());
    const auto counts = runtime::run_upload(plan, map, ring, sizes, reading, settings_.threads);
    if (!counts) return at(path_, counts.error());
    load.direct_bytes = counts->direct_bytes;
    pages_.assign(scene_->container().pages().size(), nullptr);
    for (uint64_t i = 0; i < pages.size(); ++i) pages_[pages.page(i)] = arena_.data() + plan.page_offset(i);
    return {};
  }

  /// The first picture's pixels, RGBA.
  Result<std::vector<uint8_t>> draw() {
    std::vector<std::string> names;
    if (!settings_.view.empty()) names.push_back(settings_.view);
    const Result<std::vector<NamedView>> views = file_views(*scene_, path_, names, settings_.size);
    if (!views) return views.error();
    const kernels::View& view = views->front().frames[0];
    const kernels::ShadeOptions shade;
    if (pages_.empty()) {
      const auto frame = runtime::Frame::draw(*scene_, view, 1, settings_.threads, device_ ? &*device_ : nullptr);
      if (!frame) return at(path_, frame.error());
      Result<runtime::Picture> picture = frame->shade(shade, settings_.threads);
      if (!picture) return at(path_, picture.error());
      return std::move(picture->pixels);
    }
    kernels::SceneView scene = scene_->view();
    scene.pages = pages_.data();
    const uint64_t count = uint64_t{view.width} * view.height;
    std::vector<uint64_t> samples(count);
    if (const auto drawn = kernels::draw_cpu(scene, view, samples, settings_.threads); !drawn)
      return at(path_, drawn.error());
    std::vector<uint8_t> pixels(4 * count);
    const auto resolved = kernels::resolve_cpu(scene, view, 1, samples, shade, 4, pixels, settings_.threads);
    if (!resolved) return at(path_, resolved.error());
    return pixels;
  }

  const std::string& path_;
  LoadWay way_;
  const HostArena& arena_;
  const LoadSettings& settings_;
  std::optional<runtime::Scene> scene_;
  std::optional<runtime::DeviceScene> device_;
  std::vector<const std::byte*> pages_;  // of an arena, by number
};

}  // namespace

const char* load_way_name(LoadWay way) {
  switch (way) {
    case LoadWay::kMap:
      return "map";
    case LoadWay::kArenaMapped:
      return "ring, mapped";
    case LoadWay::kArenaBuffered:
      return "ring, buffered";
    case LoadWay::kArenaDirect:
      return "ring, direct";
    case LoadWay::kGpuMapped:
      return "GPU, mapped";
    case LoadWay::kGpuBuffered:
      return "GPU, buffered";
    case LoadWay::kGpuDirect:
      return "GPU, direct";
    case LoadWay::kGpu:
      break;
  }
  return "GPU";
}

Result<HostArena> HostArena::allocate(uint64_t bytes) {
  static_assert(runtime::DirectFile::kAlignment % format::kPageAlignment == 0);
  HostArena arena;
  const uint64_t available = available_memory();
  if (bytes <= available) {
    try {
      arena.memory_ = runtime::direct_memory(std::max<uint64_t>(bytes, 1));
    } catch (const std::bad_alloc&) {  // told below
    }
  }
  if (arena.memory_ == nullptr)
    return Error{ErrorCode::kMemory, "its pages take " + tools::format_bytes(bytes) + ", but " +
                                         tools::format_bytes(available) + " of memory are available"};
  arena.bytes_ = bytes;
  std::memset(arena.memory_.get(), 0xff, bytes);
  return Result<HostArena>(std::move(arena));
}

Result<uint64_t> arena_bytes(const std::string& path) {
  runtime::SceneOptions options;
  options.pages = false;
  options.textures = false;
  const Result<runtime::Scene> scene = runtime::Scene::open(path, options);
  if (!scene) return scene.error();
  runtime::UploadPlan plan;
  plan.add_pages(scene->drawn_pages());
  return plan.bytes();
}

Result<TimedLoad> timed_load(const std::string& path, LoadWay way, const HostArena& arena,
                             const LoadSettings& settings) {
  try {
    return Loading(path, way, arena, settings).run();
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::kMemory, path + ": no memory left to load it"};
  }
}

}  // namespace scree::bench
