#include "tools/render/render_path.h"

#include <algorithm>
#include <atomic>
#include <cstdio>
#include <future>
#include <iterator>
#include <memory>
#include <new>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "runtime/draw/device_list.h"
#include "runtime/draw/host_memory.h"
#include "runtime/draw/view_renderer.h"
#include "runtime/images/image.h"
#include "runtime/threads/job_thread.h"
#include "runtime/threads/stopwatch.h"
#include "runtime/threads/workers.h"
#include "tools/common/jobs/ordered_pool.h"
#include "tools/common/load_scene.h"
#include "tools/common/output/json_writer.h"
#include "tools/common/output/output_file.h"
#include "tools/common/output/progress.h"
#include "tools/common/process/ranks.h"
#include "tools/common/process/sigbus.h"
#include "tools/common/process/stop_signal.h"
#include "tools/render/camera_path.h"
#include "tools/render/frame_files.h"
#include "tools/render/outputs.h"
#include "tools/render/ranked_frame.h"
#include "tools/render/shared_frames.h"

namespace scree::tools {
namespace {

using runtime::HostMemory;
using runtime::Layer;
using runtime::Stopwatch;
using runtime::ViewRenderer;

constexpr uint64_t kMostWaitingBytes = uint64_t{4} << 30;  // of drawn frames that are not written yet

/// Frames whose outputs are copied from a GPU to pinned memory, which takes long to make (0.5 ms per MB). If more
/// frames wait to be written, writing is slower than any copy.
constexpr uint64_t kPinnedFrames = 6;

/// A file that is written per frame.
struct Output {
  Layer layer;
  FramePattern pattern;
};

/// The number of a frame, and the rank that writes it.
struct WantedFrame {
  uint64_t frame;
  uint32_t rank;
};

/// The number of a drawn frame, and its outputs.
struct DrawnFrame {
  uint64_t frame = 0;
  std::vector<HostMemory> layers;  // one per output
};

/// After writing a frame.
struct WrittenFrame {
  double wall_ms;
  std::vector<HostMemory> layers;  // free to be used again
};

class PathRenderer {
 public:
  PathRenderer(const RenderOptions& options, const CameraPath& path, Ranks& ranks)
      : options_(options), path_(path), ranks_(ranks), progress_(!options.quiet && ranks.is_first()) {}

  /// Called by all ranks. Opens the scene and checks all outputs and cameras before any frame is drawn. An error is the
  /// lowest rank's.
  Result<void> prepare() {
    Result<void> done = ranks_.agree(choose_frames());
    if (done) done = want_frames();
    if (!done) return done;
    if (!shares_geometry()) return ranks_.agree(prepare_own());
    if (wanted_.empty()) return {};
    taken_ = wanted_;
    if (const Result<uint64_t> rest = share_host_memory(); !rest) return ranks_.agree(rest.error());
    if (options_.backend.gpus != 1)
      return ranks_.agree(Error{ErrorCode::kUsage, "--gpus cannot be used when ranks share the geometry"});
    make_pinned(gpu_of_rank(options_.backend, ranks_.rank_on_host()));
    shared_.emplace(options_, ranks_);
    done = shared_->open(wanted_.size());
    if (done) done = ranks_.agree(check_cameras());
    load_ms_ = shared_->times().load;
    return done;
  }

  Result<void> run() {
    if (!wanted_.empty()) SCREE_TRY(draw_all());
    progress_.erase();
    return report();
  }

 private:
  uint32_t width() const { return options_.camera.width; }
  uint32_t height() const { return options_.camera.height; }
  /// Whether all ranks draw every frame.
  bool shares_geometry() const { return options_.path->shares_geometry && ranks_.count() > 1; }

  /// For frames that this rank draws alone.
  Result<void> prepare_own() {
    if (wanted_.empty()) return {};
    SCREE_TRY(open());
    return check_cameras();
  }

  /// Fills wanted_. Each rank has looked for its own share of the files.
  Result<void> want_frames() {
    std::vector<uint64_t> is_there(range_.count());
    for (uint64_t i = 0; i < is_there.size(); ++i)
      is_there[i] = std::binary_search(missing_.begin(), missing_.end(), range_.frame(i)) ? 0 : 1;
    SCREE_TRY(ranks_.least(is_there));
    const uint32_t own_host = ranks_.first_on_host();
    const std::vector<std::byte> bytes = SCREE_TRY(ranks_.share(std::as_bytes(std::span(&own_host, 1))));
    const std::span<const uint32_t> host_of(reinterpret_cast<const uint32_t*>(bytes.data()), ranks_.count());
    for (uint64_t i = 0; i < is_there.size(); ++i) {
      if (is_there[i] != 0) continue;
      if (shares_geometry()) {
        wanted_.push_back({range_.frame(i), rank_of(i)});
      } else if (host_of[rank_of(i)] == own_host) {
        wanted_.push_back({range_.frame(i), ranks_.rank()});
      }
    }
    if (shares_geometry()) return {};
    const std::span<std::atomic<uint64_t>> words =
        SCREE_TRY(ranks_.words_of_host(SharedFrames::words(ranks_.count_on_host())));
    const auto drawing = static_cast<uint32_t>(std::min<uint64_t>(wanted_.size(), ranks_.count_on_host()));
    if (ranks_.rank_on_host() >= drawing) {
      wanted_.clear();
    } else {
      frames_of_host_.emplace(words, wanted_.size(), ranks_.rank_on_host(), drawing);
    }
    return {};
  }

  /// The rank that looks for the files of frame `index` of range_. If ranks share the geometry, it also writes them;
  /// otherwise the ranks of its host draw and write the frame.
  uint32_t rank_of(uint64_t index) const {
    if (options_.path->shares_geometry) return static_cast<uint32_t>(index % ranks_.count());
    return rank_of_frame(index, range_.count(), ranks_.count());
  }

  /// Sets range_, and fills missing_ with the frames of this rank's share of the files.
  Result<void> choose_frames() {
    const std::pair<const std::string*, Layer> wanted[] = {
        {&options_.output, Layer::kColor}, {&options_.depth, Layer::kDepth}, {&options_.visbuffer, Layer::kSamples}};
    for (const auto& [text, layer] : wanted) {
      if (text->empty()) continue;
      const FramePattern pattern = SCREE_TRY(FramePattern::parse("", *text));
      outputs_.push_back({layer, pattern});
    }
    range_ = options_.path->frames;
    const uint64_t count = path_.frame_count();
    if (range_.end == UINT64_MAX) range_.end = std::max(count, range_.first);
    if (range_.end > count || range_.first >= count)
      return Error{ErrorCode::kUsage, "--frames: " + options_.path->file + " has " + std::to_string(count) +
                                          " frames, from 0 on, at " + number(path_.frames_per_second()) +
                                          " per second"};
    if (range_.count() > UINT32_MAX) return Error{ErrorCode::kRange, "--frames: at most 2^32 - 1 frames"};
    for (uint64_t i = 0; i < range_.count(); ++i) {
      if (rank_of(i) != ranks_.rank()) continue;
      const uint64_t frame = range_.frame(i);
      const bool is_there = SCREE_TRY(is_done(frame));
      if (!is_there) missing_.push_back(frame);
    }
    return {};
  }

  /// Whether all files of a frame exist and are complete. Errors: a file that may not be written.
  Result<bool> is_done(uint64_t frame) const {
    bool is_whole = options_.path->resume;
    for (const Output& output : outputs_) {
      const std::string name = output.pattern.name(frame);
      for (const std::string* input : {&options_.file, &options_.path->file, &options_.light.environment})
        if (!input->empty() && is_same_file(name, *input))
          return Error{ErrorCode::kUsage,
                       "frame " + std::to_string(frame) + " would replace " + *input + ", which is read"};
      if (options_.path->resume && !SCREE_TRY(has_whole_frame(output.layer, name, size()))) is_whole = false;
      if (options_.path->resume || options_.existing == format::Existing::kReplace) continue;
      if (const Result<void> checked = check_output_file(name, options_.existing); !checked)
        return Error{checked.error().code, checked.error().message + "; --resume keeps complete frames"};
    }
    return is_whole;
  }

  FrameSize size() const { return {width(), height(), options_.samples_per_side}; }
  uint64_t pixels() const { return size().pixels(); }
  uint64_t samples() const { return size().samples(); }
  /// Bytes of a layer of a frame, as it is read.
  uint64_t bytes_of(Layer layer) const { return layer == Layer::kSamples ? samples() * 8 : pixels() * 4; }

  Result<void> open() {
    const Stopwatch watch;
    report_sigbus("render", options_.file);
    runtime::SceneFile file = SCREE_TRY(runtime::SceneFile::open(options_.file));
    BackendOptions backend = options_.backend;
    backend.device = gpu_of_rank(backend, ranks_.rank_on_host());
    runtime::LoadOptions load = options_.load_options();
    load.camera.eye = runtime::Vec3{};  // every frame has an eye
    load.host_memory = SCREE_TRY(share_host_memory());
    make_pinned(backend.device);
    load.accept = [&](const runtime::Scene& scene, runtime::LoadOptions&) {
      return accept_scene("render", scene, options_.light, options_.quiet);
    };
    scene_ = SCREE_TRY(load_scene("render", std::move(file), backend, std::move(load), options_.quiet));
    const Result<void> made = make_renderer();
    load_ms_ += watch.elapsed().wall_ms;
    return made;
  }

  Result<void> make_renderer() {
    Result<std::unique_ptr<ViewRenderer>> renderer = ViewRenderer::create(scene_);
    if (!renderer) return at(options_.file, with_cpu_advice(renderer.error()));
    renderer_ = std::move(*renderer);
    renderer_->cast_shadows(options_.light.shadow_side);
    return {};
  }

  /// Sets most_waiting_, the largest number of drawn frames that are not written yet. Returns the rest of
  /// --host-memory, or 0 without that option. Error kMemory: --host-memory is too small for one frame.
  Result<uint64_t> share_host_memory() {
    uint64_t bytes = 0;
    for (const Output& output : outputs_)
      bytes += bytes_of(output.layer) + (output.layer == Layer::kColor ? pixels() * 4 : 0);
    const uint64_t side = options_.light.shadow_side;
    const uint64_t own = (samples() + side * side) * sizeof(uint64_t) + pixels() * 3 * sizeof(float);  // renderer
    const uint64_t allowed = options_.host_memory;
    if (allowed != 0 && allowed <= own + bytes)
      return at(options_.file, Error{ErrorCode::kMemory, "a frame takes " + std::to_string(own + bytes) +
                                                             " bytes of host memory, but --host-memory allows " +
                                                             std::to_string(allowed)});
    const uint64_t waiting = allowed == 0 ? kMostWaitingBytes : std::min(kMostWaitingBytes, (allowed - own) / 2);
    most_waiting_ = std::clamp<uint64_t>(waiting / bytes, 1, options_.threads);
    return allowed == 0 ? 0 : allowed - own - most_waiting_ * bytes;
  }

  Result<kernels::View> view_of(uint64_t frame) const {
    const PathKey key = path_.at(frame);
    runtime::CameraOptions camera = options_.camera;
    camera.eye = key.eye;
    camera.target = key.target;
    camera.up = key.up;
    camera.fov_degrees = key.fov_degrees;
    const Result<kernels::View> view = runtime::make_view(scene(), camera);
    if (view) return view;
    const ErrorCode code =
        view.error().code == ErrorCode::kUsage ? ErrorCode::kRange : view.error().code;  // the path's
    return Error{code, options_.path->file + ": frame " + std::to_string(frame) + ", at " + number(key.t) +
                           " s: " + view.error().message};
  }

  Result<void> check_cameras() const {
    for (const WantedFrame& wanted : wanted_) SCREE_TRY(view_of(wanted.frame));
    return {};
  }

  Result<void> draw_all() {
    progress_.stage("render", shared_ ? missing_.size() : wanted_.size(), "frames");
    const StopOnSignal handlers("existing frames are complete; --resume draws the others");
    convert::WorkerPool pool(options_.threads, nullptr);
    convert::OrderedResults<WrittenFrame> written(pool, false);
    const auto take = [&]() -> Result<void> {
      WrittenFrame done = SCREE_TRY(written.take());
      write_ms_ += done.wall_ms;
      std::move(done.layers.begin(), done.layers.end(), std::back_inserter(free_));
      ++done_;
      progress_.update(shared_ ? done_ : frames_of_host_->count_written(), 0);
      return {};
    };
    // The last frame that was drawn, while its outputs are copied from a GPU beside the drawing of the next one.
    std::optional<DrawnFrame> read;
    struct EndReads {
      PathRenderer& path;
      ~EndReads() { (void)path.end_reads(); }
    } const at_end{*this};  // before the memory of `read` is freed
    const auto write_last = [&]() -> Result<void> {
      if (!read) return {};
      SCREE_TRY(check_unchanged(scene().file().map()));
      const auto job = std::make_shared<DrawnFrame>(std::move(*read));
      read.reset();
      // If few frames wait, the GPU is the limit, and the last frame should not wait for one thread.
      runtime::Workers* const all = written.size() < options_.threads / 2 ? &workers_ : nullptr;
      written.submit([this, job, all](uint32_t) { return write(*job, all); }, 0);
      return {};
    };
    for (size_t next = 0;;) {
      const bool is_stopped = StopOnSignal::flag()->load();
      const bool is_full = written.size() + (read ? 1 : 0) >= most_waiting_;
      const bool draws = !is_stopped && !is_full && take_frame(next);
      if (!draws && !read && written.size() == 0) {
        if (is_stopped && (next < taken_.size() || (frames_of_host_ && frames_of_host_->has_left())))
          return Error{ErrorCode::kFile, "interrupted"};
        return {};
      }
      if (written.ready() || (!draws && !read)) {
        SCREE_TRY(take());
        continue;
      }
      std::optional<DrawnFrame> drawn;
      const Result<void> done = draws ? draw(next, drawn) : end_reads();
      if (!done && !shared_ && done.error().code == ErrorCode::kDevice &&
          options_.backend.choice == BackendChoice::kAuto) {
        // If the GPU fails, the CPU draws the same pictures, also the last one, which may not be read whole.
        if (!options_.quiet) warn_of_cpu("render", name_of(*scene_->gpu()) + ": " + done.error().message);
        renderer_.reset();
        SCREE_TRY(scene_->use_cpu());
        SCREE_TRY(make_renderer());
        if (read) --next;
        read.reset();
        continue;
      }
      if (!done) return shared_ ? done : at(options_.file, with_cpu_advice(done.error()));
      SCREE_TRY(write_last());
      if (!draws) continue;
      ++next;
      read = std::move(drawn);
      if (!reads_later()) SCREE_TRY(write_last());
    }
  }

  /// Whether there is a frame taken_[number]: takes it if ranks draw different frames.
  bool take_frame(size_t number) {
    if (number < taken_.size()) return true;
    const std::optional<uint64_t> taken = frames_of_host_ ? frames_of_host_->take() : std::nullopt;
    if (taken) taken_.push_back(wanted_[*taken]);
    return taken.has_value();
  }

  /// Whether outputs are copied beside the next frame. A CPU has them at once.
  bool reads_later() const { return shared_ ? shared_->has_gpu() : scene_->gpu().has_value(); }
  Result<void> end_reads() {
    if (shared_) return shared_->end_reads();
    return renderer_ != nullptr ? renderer_->end_reads() : Result<void>();
  }

  /// Draws taken_[number], and begins to read its outputs into `drawn`, if this rank writes the frame. The outputs of
  /// the frame before are then read whole.
  Result<void> draw(size_t number, std::optional<DrawnFrame>& drawn) {
    const WantedFrame wanted = taken_[number];
    const kernels::View view = SCREE_TRY(view_of(wanted.frame));
    Result<void> done = shared_ ? draw_shared(view, number) : draw_alone(view);
    if (!done || wanted.rank != ranks_.rank()) return done;
    const Stopwatch watch;
    drawn.emplace().frame = wanted.frame;
    for (const Output& output : outputs_) drawn->layers.push_back(take_memory(bytes_of(output.layer)));
    for (size_t i = 0; i < outputs_.size() && done; ++i) {
      const std::span<std::byte> out = drawn->layers[i].bytes();
      done = shared_ ? read_shared(outputs_[i].layer, out) : renderer_->read_later(outputs_[i].layer, out);
    }
    if (!done) (void)end_reads();  // before the memory is freed
    shade_ms_ += watch.elapsed().wall_ms;
    const kernels::BlendCounts& blended = shared_ ? shared_->blended() : renderer_->blended();
    if (blended.samples_left_out != 0) ++frames_with_more_layers_;
    return done;
  }

  Result<void> draw_alone(const kernels::View& view) {
    const std::optional<Layer> colors = options_.output.empty() ? std::nullopt : std::optional(Layer::kColor);
    SCREE_TRY(renderer_->draw(view, options_.samples_per_side, options_.shade, colors));
    draw_ms_ += renderer_->draw_time().wall_ms;
    shadow_ms_ += renderer_->shadow_time().wall_ms;
    return end_reads();
  }

  /// The same with all ranks, for taken_[number].
  Result<void> draw_shared(const kernels::View& view, size_t number) {
    std::optional<kernels::View> next;
    if (number + 1 < taken_.size()) next = SCREE_TRY(view_of(taken_[number + 1].frame));
    SCREE_TRY(shared_->draw(view, taken_[number].rank, next));
    SCREE_TRY(end_reads());
    SCREE_TRY(shared_->shade());
    // Means over the ranks, when the report adds them up.
    draw_ms_ += shared_->times().draw / ranks_.count();
    shade_ms_ += shared_->times().shade / ranks_.count();
    exchange_ms_ += shared_->times().exchange / ranks_.count();
    return {};
  }

  Result<void> read_shared(Layer layer, std::span<std::byte> out) {
    if (layer == Layer::kDepth) return shared_->read_depth(out);
    if (layer == Layer::kColor) return shared_->read_picture({reinterpret_cast<uint32_t*>(out.data()), pixels()});
    const std::span<const std::byte> bytes = std::as_bytes(shared_->samples());
    std::copy(bytes.begin(), bytes.end(), out.begin());
    return {};
  }

  /// Begins to make pinned memory for outputs, which takes long, while the scene is loaded. `gpu`: as for use_gpu().
  void make_pinned(const std::string& gpu) {
    if (options_.backend.choice == BackendChoice::kCpu) return;
    const uint64_t frames = std::min<uint64_t>({kPinnedFrames, most_waiting_ + 1, wanted_.size()});
    pinned_ = pinning_.add([this, frames, gpu] {
      std::vector<HostMemory> made;
      if (!runtime::use_gpu(gpu)) return made;
      for (uint64_t i = 0; i < frames; ++i)
        for (const Output& output : outputs_) made.push_back(HostMemory::pinned(bytes_of(output.layer)));
      return made;
    });
  }

  /// Memory for an output, if possible that of a frame before.
  HostMemory take_memory(uint64_t bytes) {
    if (pinned_.valid()) free_ = pinned_.get();
    const auto found = std::find_if(free_.begin(), free_.end(), [&](const auto& one) { return one.size() == bytes; });
    if (found == free_.end()) return HostMemory::plain(bytes);
    HostMemory taken = std::move(*found);
    free_.erase(found);
    return taken;
  }

  /// Writes the files of a frame. `workers`: null, or threads that encode pictures together.
  Result<WrittenFrame> write(DrawnFrame& drawn, runtime::Workers* workers) const {
    const Stopwatch watch;
    const format::Existing existing = options_.path->resume ? format::Existing::kReplace : options_.existing;
    for (size_t i = 0; i < outputs_.size(); ++i) {
      const std::string name = outputs_[i].pattern.name(drawn.frame);
      const std::span<const std::byte> bytes = drawn.layers[i].bytes();
      if (outputs_[i].layer == Layer::kColor) {
        SCREE_TRY(write_picture(options_, name, bytes, workers, existing));
      } else if (outputs_[i].layer == Layer::kDepth) {
        const std::span<const float> depths(reinterpret_cast<const float*>(bytes.data()), pixels());
        SCREE_TRY(runtime::write_pfm(name, width(), height(), depths, existing));
      } else {
        const std::span<const uint64_t> words(reinterpret_cast<const uint64_t*>(bytes.data()), samples());
        SCREE_TRY(runtime::write_visibility(name, words, existing));
      }
    }
    return WrittenFrame{watch.elapsed().wall_ms, std::move(drawn.layers)};
  }

  static std::string number(double value) {
    char text[32];
    std::snprintf(text, sizeof text, "%g", value);
    return text;
  }

  const runtime::Scene& scene() const { return shared_ ? shared_->scene() : scene_->scene(); }

  /// `gpus`: of all ranks, if they share the geometry.
  std::string drawn_on(uint32_t gpus) const {
    if (shared_) return RankedFrame::processors(gpus, ranks_.count());
    return scene_ == nullptr ? "nothing" : name_of_device(*scene_);
  }

  /// Prints the report of all ranks, at rank 0. Loading is the mean over ranks; drawing, shading and writing are sums
  /// over all frames (per frame in the text); the total time is rank 0's.
  Result<void> report() {
    double sums[] = {static_cast<double>(done_),
                     load_ms_,
                     draw_ms_,
                     shade_ms_,
                     write_ms_,
                     static_cast<double>(frames_with_more_layers_),
                     shadow_ms_,
                     exchange_ms_,
                     shared_ && shared_->has_gpu() ? 1.0 : 0.0};
    SCREE_TRY(ranks_.sum(sums));
    if (!ranks_.is_first()) return {};
    const double frames = sums[0];
    const auto drawn = static_cast<uint64_t>(frames);
    const uint64_t count = range_.count(), there = count - drawn;
    const auto with_more_layers = static_cast<uint64_t>(sums[5]);
    if (!options_.quiet)
      warn_of_layers("render", options_.file, with_more_layers, "frame", options_.shade.blend_layers);
    if (options_.json) {
      const std::string text = json_object([&](JsonWriter& json) {
        json.member("file", options_.file);
        json.member("path", options_.path->file);
        json.member("frames", drawn);
        json.member("frames_there", there);
        json.member("width", width());
        json.member("height", height());
        json.member("samples_per_side", options_.samples_per_side);
        json.member("device", drawn_on(static_cast<uint32_t>(sums[8])));
        json.member("ranks", ranks_.count());
        json.member("frames_with_more_layers", with_more_layers);
        json.member("load_ms", sums[1] / ranks_.count());
        json.member("wall_ms", watch_.elapsed().wall_ms);
        if (options_.light.shadow_side != 0) json.member("shadow_ms", sums[6]);
        json.member("draw_ms", sums[2]);
        json.member("shade_ms", sums[3]);
        json.member("write_ms", sums[4]);
        if (shared_) json.member("exchange", shared_->way());
        if (shared_) json.member("exchange_ms", sums[7]);
      });
      std::printf("%s\n", text.c_str());
      return {};
    }
    if (options_.quiet) return {};
    const bool has_shadows = options_.light.shadow_side != 0 && !shared_;  // otherwise they are a part of drawing
    std::string line = options_.file + ": ";
    if (there > 0) line += std::to_string(there) + " of " + std::to_string(count) + " frames exist";
    if (drawn > 0) {
      char rates[200], shadows[40] = "", exchange[60] = "";
      if (has_shadows) std::snprintf(shadows, sizeof shadows, "shadows %.1f ms, ", sums[6] / frames);
      if (shared_)
        std::snprintf(exchange, sizeof exchange, "exchange by %s %.2f ms, ", shared_->way(), sums[7] / frames);
      std::snprintf(rates, sizeof rates, " (each: %sdrawing %.1f ms, shading %.1f ms, %swriting %.1f ms of one thread)",
                    shadows, sums[2] / frames, sums[3] / frames, exchange, sums[4] / frames);
      line += (there > 0 ? ", " : "") + std::to_string(drawn) + (drawn == 1 ? " frame of " : " frames of ") +
              std::to_string(width()) + " x " + std::to_string(height()) + " in " +
              format_duration(watch_.elapsed().wall_ms / 1000) + " on " + drawn_on(static_cast<uint32_t>(sums[8])) +
              (ranks_.count() > 1 ? ", in " + std::to_string(ranks_.count()) + " ranks" : "") + rates;
    } else if (there == 0) {
      line += "there is no frame in this share";
    }
    if (count > 0) {
      line += " -> ";
      for (const Output& output : outputs_) line += (&output == outputs_.data() ? "" : ", ") + names_of(output);
    }
    std::printf("%s\n", line.c_str());
    return {};
  }

  std::string names_of(const Output& output) const {
    const std::string first = output.pattern.name(range_.frame(0));
    return range_.count() == 1 ? first : first + " to " + output.pattern.name(range_.frame(range_.count() - 1));
  }

  const RenderOptions& options_;
  const CameraPath& path_;
  Ranks& ranks_;
  Progress progress_;
  std::vector<Output> outputs_;
  FrameRange range_;                            // of all ranks
  std::vector<uint64_t> missing_;               // frames of this rank's share of the files
  std::vector<WantedFrame> wanted_;             // frames to be drawn: by the ranks of this host, or by all ranks
  std::optional<SharedFrames> frames_of_host_;  // indices of wanted_, unless all ranks draw every frame
  std::vector<WantedFrame> taken_;              // frames that this rank has drawn or will draw next
  std::shared_ptr<runtime::LoadedScene> scene_;
  std::unique_ptr<ViewRenderer> renderer_;
  std::optional<RankedFrame> shared_;  // instead, if the ranks share the geometry
  uint64_t most_waiting_ = 1;
  runtime::Workers workers_{options_.threads};
  std::vector<HostMemory> free_;                 // memory of frames that are written
  std::future<std::vector<HostMemory>> pinned_;  // of frames to come
  runtime::JobThread<std::vector<HostMemory>> pinning_;
  uint64_t done_ = 0;
  uint64_t frames_with_more_layers_ = 0;  // frames with more layers of blended surfaces than are drawn
  Stopwatch watch_;
  double load_ms_ = 0, shadow_ms_ = 0, draw_ms_ = 0, shade_ms_ = 0, exchange_ms_ = 0, write_ms_ = 0;
};

}  // namespace

Result<void> render_path(const RenderOptions& options) {
  Ranks ranks = SCREE_TRY(Ranks::join());
  if (ranks.count() > 1) end_silently_on_signal();
  Result<void> done;
  try {
    const Result<CameraPath> path = CameraPath::read(options.path->file, options.path->frames_per_second);
    done = ranks.agree(path ? Result<void>() : path.error());
    if (done) {
      PathRenderer renderer(options, *path, ranks);
      done = renderer.prepare();
      if (done) done = renderer.run();
    }
  } catch (const std::bad_alloc&) {
    done = Error{ErrorCode::kMemory, options.file + ": no memory left for its frames"};
  }
  if (!done) return ranks.named(done.error());
  ranks.leave();
  return {};
}

}  // namespace scree::tools
