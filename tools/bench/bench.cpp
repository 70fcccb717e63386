#include "tools/bench/bench.h"

#include <algorithm>
#include <cstdio>
#include <new>
#include <span>
#include <utility>

#include "format/container/checksum.h"
#include "runtime/draw/loaded_scene.h"
#include "runtime/draw/view_renderer.h"
#include "runtime/scene/scene.h"
#include "tools/bench/file_cache.h"
#include "tools/bench/file_views.h"
#include "tools/common/load_scene.h"
#include "tools/common/output/progress.h"
#include "tools/common/process/sigbus.h"

namespace scree::bench {
namespace {

/// The bytes of the file that loading reads: all but geometry that the scene does not draw, and pages of textures that
/// are read once pixels show them.
uint64_t read_bytes(const runtime::Scene& scene) {
  uint64_t bytes = scene.file().map().size();
  for (uint64_t i = 0; i < scene.container().pages().size(); ++i) {
    const format::PageRecord& page = scene.container().pages()[i];
    if (page.kind == format::PageKind::kGeometry) bytes -= page.stored_bytes;
  }
  for (uint64_t i = 0; i < scene.drawn_pages().size(); ++i) bytes += scene.drawn_pages().record(i).stored_bytes;
  if (const runtime::BlockPager* const pager = scene.block_pager())
    for (const uint32_t page : pager->file_pages()) bytes -= scene.container().pages()[page].stored_bytes;
  return bytes;
}

/// A scene loaded for drawing, and its last frame.
class BenchScene {
 public:
  explicit BenchScene(const BenchOptions& options) : options_(options) {}

  Result<void> load(const std::string& path, bool on_gpu) {
    runtime::SceneFile file = SCREE_TRY(runtime::SceneFile::open(path));
    runtime::LoadOptions load = tools::load_options(options_, options_.textures);
    load.on = on_gpu ? runtime::DrawOn::kGpu : runtime::DrawOn::kCpu;
    load.gpu = options_.backend.device;
    load.reading = options_.reading;
    load.host_memory = options_.host_memory;
    load.pictures = {options_.size.width, options_.size.height, options_.samples_per_side, &shade_};
    load.camera.eye = runtime::Vec3{};  // file_views() reads the pages if it needs them
    loaded_ = SCREE_TRY(runtime::LoadedScene::load(std::move(file), std::move(load)));
    return {};
  }

  /// Draws and shades a frame. Times in ms.
  struct FrameMs {
    float draw = 0;
    float shade = 0;
  };
  Result<FrameMs> draw(const kernels::View& pixels) {
    const uint32_t side = options_.samples_per_side;
    const kernels::View of_samples = SCREE_TRY(runtime::view_of_samples(pixels, side));
    const kernels::View& view = of_samples;
    sample_count_ = uint64_t{view.width} * view.height;
    if (device() != nullptr) {
      kernels::FrameTimes drawn{};
      SCREE_TRY(device()->draw(view, &drawn, &shade_));
      kernels::ResolveTimes resolved{};
      SCREE_TRY(device()->resolve(view, side, shade_, {}, &resolved));
      return FrameMs{drawn.raster_ms, resolved.resolve_ms};
    }
    samples_.resize(sample_count_);
    rgba_.resize(4 * sample_count_ / (side * side));
    const runtime::Stopwatch draw_watch;
    SCREE_TRY(kernels::draw_cpu(scene().view(), view, samples_, options_.threads));
    const auto draw_ms = static_cast<float>(draw_watch.elapsed().wall_ms);
    const runtime::Stopwatch watch;
    SCREE_TRY(kernels::resolve_cpu(scene().view(), view, side, samples_, shade_, 4, rgba_, options_.threads));
    return FrameMs{draw_ms, static_cast<float>(watch.elapsed().wall_ms)};
  }

  /// Hash of the frame drawn last.
  Result<uint64_t> picture_hash() {
    samples_.resize(sample_count_);
    if (device() != nullptr) SCREE_TRY(device()->read_samples(samples_));
    return format::checksum(std::as_bytes(std::span(samples_)));
  }

  runtime::Scene& scene() { return loaded_->scene(); }
  runtime::DeviceScene* device() const { return loaded_->device(); }
  uint32_t gpu_count() const { return device() != nullptr ? device()->gpu_count() : 1; }
  std::optional<uint64_t> streamed_bytes() const {
    if (device() == nullptr || !device()->stream_stats()) return std::nullopt;
    return device()->stream_stats()->streamed_bytes;
  }
  uint64_t device_bytes() {
    if (device() != nullptr) return device()->stats().device_bytes;
    uint64_t bytes = scene().stats().texture_bytes + scene().stats().jpeg_bytes;
    if (const runtime::BlockPager* pager = scene().block_pager()) bytes += pager->resident_bytes();
    for (uint64_t i = 0; i < scene().drawn_pages().size(); ++i) bytes += scene().drawn_pages().record(i).raw_bytes;
    return bytes;
  }

 private:
  const BenchOptions& options_;
  const kernels::ShadeOptions shade_;
  std::shared_ptr<runtime::LoadedScene> loaded_;
  std::vector<uint64_t> samples_;
  uint64_t sample_count_ = 0;
  std::vector<uint8_t> rgba_;  // of the CPU
};

/// The measured loads from one state of the page cache.
struct LoadSeries {
  LoadResult result;
  std::vector<float> load, first_picture;

  void add(float load_ms, float first_ms, double share) {
    result.cached_share = load.empty()     ? share
                          : result.is_cold ? std::max(result.cached_share, share)
                                           : std::min(result.cached_share, share);
    load.push_back(load_ms);
    first_picture.push_back(first_ms);
  }
  LoadResult finish() {
    result.load = summarize(load);
    result.first_picture = summarize(first_picture);
    return result;
  }
};

class FileBench {
 public:
  FileBench(const std::string& path, const BenchOptions& options, bool has_gpu)
      : path_(path), options_(options), has_gpu_(has_gpu), progress_(!options.quiet) {
    result_.file = path;
  }

  Result<FileResult> run() {
    SCREE_TRY(measure_loads());
    runtime::Scene& scene = loaded_->scene();
    const kernels::SceneView& drawn = scene.view();
    result_.file_bytes = scene.file().map().size();
    result_.gpus = loaded_->gpu_count();
    result_.drawn_triangles = drawn.instance_base[drawn.instance_count];
    for (uint64_t m = 0; m < drawn.mesh_count; ++m) result_.unique_triangles += drawn.meshes[m].triangle_count;
    progress_.stage(path_ + ": drawing", views_.size(), "views");
    for (const FileView& view : views_) {
      progress_.update(result_.views.size(), 0);
      result_.views.push_back(SCREE_TRY(measure_view(view)));
    }
    progress_.erase();
    SCREE_TRY(tools::check_unchanged(scene.file().map()));
    return result_;
  }

 private:
  /// Loads alternate between the disk and the page cache, so that other load on the machine slows both down equally. If
  /// the system hides which pages are cached, loads are measured without changing the cache.
  Result<void> measure_loads() {
    std::vector<LoadSeries> all(2);
    all[0].result.is_cold = true;
    const Result<double> cached = cached_share(path_);
    if (!cached) {
      if (cached.error().code != ErrorCode::kUnsupported) return cached.error();
      warn(cached.error().message + "; loads from the disk are not measured");
      all.erase(all.begin());
    }
    progress_.stage(path_ + ": loading", options_.repeats * all.size(), "loads");
    uint64_t loads = 0;
    for (uint32_t i = 0; i < options_.repeats; ++i) {
      for (LoadSeries& series : all) {
        progress_.update(loads++, 0);
        double share = 1;
        if (cached) share = SCREE_TRY(series.result.is_cold ? drop_from_cache(path_) : bring_to_cache(path_));
        SCREE_TRY(load(series, share));
      }
    }
    progress_.erase();
    for (LoadSeries& series : all) result_.loads.push_back(series.finish());
    return {};
  }

  Result<void> load(LoadSeries& series, double share) {
    loaded_.reset();
    const runtime::Stopwatch watch;
    loaded_.emplace(options_);
    SCREE_TRY(loaded_->load(path_, has_gpu_));
    const auto load_ms = static_cast<float>(watch.elapsed().wall_ms);
    views_ = SCREE_TRY(file_views(loaded_->scene(), path_, options_.cameras, options_.size, options_.threads));
    SCREE_TRY_AT(path_, loaded_->draw(views_.front().view));
    series.add(load_ms, static_cast<float>(watch.elapsed().wall_ms), share);
    series.result.read_bytes = read_bytes(loaded_->scene());
    series.result.device_bytes = loaded_->device_bytes();
    return {};
  }

  Result<ViewResult> measure_view(const FileView& view) {
    ViewResult result{.name = view.name};
    std::vector<float> shade;
    const auto draw_one = [&]() -> Result<float> {
      const auto ms = SCREE_TRY(loaded_->draw(view.view));
      shade.push_back(ms.shade);
      return ms.draw;
    };
    const float first = SCREE_TRY_AT(path_, draw_one());
    result.first_ms = static_cast<double>(first);
    const std::vector<float> times = SCREE_TRY_AT(path_, timed_frames(options_.frames, options_.warmup, draw_one));
    result.frames = static_cast<uint32_t>(times.size());
    result.draw = summarize(times);
    result.shade = summarize(std::span(shade).last(times.size()));
    result.streamed_bytes = loaded_->streamed_bytes();
    result.picture = SCREE_TRY_AT(path_, loaded_->picture_hash());
    return result;
  }

  void warn(const std::string& message) {
    if (options_.quiet) return;
    progress_.erase();
    std::fprintf(stderr, "scree bench: warning: %s\n", message.c_str());
  }

  const std::string& path_;
  const BenchOptions& options_;
  const bool has_gpu_;
  tools::Progress progress_;
  std::optional<BenchScene> loaded_;
  std::vector<FileView> views_;
  FileResult result_;
};

}  // namespace

Result<FileResult> measure_file(const std::string& path, const BenchOptions& options, bool has_gpu) try {
  return FileBench(path, options, has_gpu).run();
} catch (const std::bad_alloc&) {
  return Error{ErrorCode::kMemory, path + ": no memory left to load or draw it"};
}

Result<void> run_bench(const BenchOptions& options) {
  if (!options.csv.empty()) SCREE_TRY(check_rows(options));
  const std::optional<runtime::Gpu> gpu = SCREE_TRY(tools::choose_gpu("bench", options.backend, options.quiet));
  BenchReport report{options, gpu.has_value() ? gpu_machine(*gpu) : cpu_machine(), {}};
  Result<void> done;
  for (const std::string& file : options.files) {
    tools::report_sigbus("bench", file);
    Result<FileResult> measured = measure_file(file, options, gpu.has_value());
    if (!measured) {
      done = measured.error();
      break;
    }
    report.files.push_back(std::move(*measured));
  }
  if (report.files.empty()) return done;
  std::fputs((options.json ? bench_json(report) : bench_text(report)).c_str(), stdout);
  if (!options.csv.empty()) SCREE_TRY(append_rows(report));
  return done;
}

}  // namespace scree::bench
