#include "tools/render/render_path.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <memory>
#include <new>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "runtime/draw/view_renderer.h"
#include "runtime/images/image.h"
#include "runtime/threads/stopwatch.h"
#include "tools/common/json_writer.h"
#include "tools/common/ordered_pool.h"
#include "tools/common/output_file.h"
#include "tools/common/progress.h"
#include "tools/common/sigbus.h"
#include "tools/common/stop_signal.h"
#include "tools/render/camera_path.h"

namespace scree::tools {
namespace {

using runtime::Layer;
using runtime::LoadedScene;
using runtime::Stopwatch;
using runtime::ViewRenderer;

constexpr uint64_t kMostWaitingBytes = uint64_t{4} << 30;  // of frames that are drawn and not yet written

/// An output of every frame.
struct Output {
  Layer layer;
  FramePattern pattern;
};

/// What is read of a frame, and where it goes.
struct DrawnFrame {
  uint64_t frame = 0;
  std::vector<std::vector<std::byte>> layers;  // of the outputs
};

class PathRenderer {
 public:
  PathRenderer(const RenderOptions& options, const CameraPath& path)
      : options_(options), path_(path), progress_(!options.quiet) {}

  Result<void> run() {
    if (const Result<void> done = choose_frames(); !done) return done;
    if (!frames_.empty()) {
      if (const Result<void> done = open(draw_on()); !done) return done;
      if (const Result<void> done = check_cameras(); !done) return done;
      if (const Result<void> done = draw_all(); !done) return done;
    }
    progress_.erase();
    report();
    return {};
  }

 private:
  uint32_t width() const { return options_.camera.width; }
  uint32_t height() const { return options_.camera.height; }

  /// frames_: those that are to be drawn.
  Result<void> choose_frames() {
    const std::pair<const std::string*, Layer> wanted[] = {{&options_.output, Layer::kColor},
                                                           {&options_.depth, Layer::kDepth},
                                                           {&options_.visbuffer, Layer::kSamples}};
    for (const auto& [text, layer] : wanted) {
      if (text->empty()) continue;
      const Result<FramePattern> pattern = FramePattern::parse("", *text);
      if (!pattern) return pattern.error();
      outputs_.push_back({layer, *pattern});
    }
    range_ = options_.path->frames;
    const uint64_t count = path_.frame_count();
    if (range_.end == UINT64_MAX) range_.end = std::max(count, range_.first);
    if (range_.end > count || range_.first >= count)
      return Error{ErrorCode::kUsage, "--frames: " + options_.path->file + " has " + std::to_string(count) +
                                          " frames, from 0 on, at " + number(path_.frames_per_second()) +
                                          " per second"};
    for (uint64_t i = 0; i < range_.count(); ++i) {
      const uint64_t frame = range_.frame(i);
      const Result<bool> is_there = is_done(frame);
      if (!is_there) return is_there.error();
      if (!*is_there) frames_.push_back(frame);
    }
    return {};
  }

  /// Whether all files of a frame are there; errors where one may not be written.
  Result<bool> is_done(uint64_t frame) const {
    bool is_whole = options_.path->resume;
    for (const Output& output : outputs_) {
      const std::string name = output.pattern.name(frame);
      for (const std::string* input : {&options_.file, &options_.path->file})
        if (is_same_file(name, *input))
          return Error{ErrorCode::kUsage, "frame " + std::to_string(frame) + " would replace " + *input +
                                              ", which is read"};
      is_whole = is_whole && has_whole_file(output.layer, name);
      if (options_.path->resume || options_.existing == format::Existing::kReplace) continue;
      if (const Result<void> checked = check_output_file(name, options_.existing); !checked)
        return Error{checked.error().code, checked.error().message + ", --resume leaves frames that are whole"};
    }
    return is_whole;
  }

  /// Whether a file begins and ends as one of a frame of this size does.
  bool has_whole_file(Layer layer, const std::string& name) const {
    std::error_code failed;
    const uint64_t bytes = std::filesystem::file_size(name, failed);
    if (failed) return false;
    if (layer == Layer::kSamples) return bytes == samples() * sizeof(uint64_t);
    std::string head(64, '\0'), tail(12, '\0');
    std::ifstream file(name, std::ios::binary);
    file.read(head.data(), static_cast<std::streamsize>(std::min<uint64_t>(head.size(), bytes)));
    if (layer == Layer::kDepth) {
      const std::string begin = "Pf\n" + std::to_string(width()) + " " + std::to_string(height()) + "\n-1.0\n";
      return file && head.starts_with(begin) && bytes == begin.size() + pixels() * sizeof(float);
    }
    if (!file || bytes < 45 || !file.seekg(-12, std::ios::end) || !file.read(tail.data(), 12)) return false;
    std::string begin("\x89PNG\r\n\x1a\n\0\0\0\rIHDR", 16);
    for (const uint32_t side : {width(), height()})
      for (int shift = 24; shift >= 0; shift -= 8) begin += static_cast<char>(side >> shift & 0xff);
    return head.starts_with(begin) && tail == std::string("\0\0\0\0IEND\xae\x42\x60\x82", 12);
  }

  uint64_t pixels() const { return uint64_t{width()} * height(); }
  uint64_t samples() const { return pixels() * options_.samples_per_side * options_.samples_per_side; }

  runtime::DrawOn draw_on() const {
    switch (options_.backend.choice) {
      case BackendChoice::kCpu:
        return runtime::DrawOn::kCpu;
      case BackendChoice::kCuda:
        return runtime::DrawOn::kGpu;
      default:
        return runtime::DrawOn::kAuto;
    }
  }

  Result<void> open(runtime::DrawOn on) {
    const Stopwatch watch;
    if (on == runtime::DrawOn::kAuto) {  // its line says why there is no GPU
      const Result<std::optional<runtime::Gpu>> gpu = choose_gpu("render", options_.backend, options_.quiet);
      if (!gpu) return at(options_.file, gpu.error());
      if (!gpu->has_value()) on = runtime::DrawOn::kCpu;
    }
    report_sigbus("render", options_.file);
    Result<runtime::SceneFile> file = runtime::SceneFile::open(options_.file);
    if (!file) return file.error();
    const bool has_color = !options_.output.empty();
    runtime::LoadOptions load;
    load.scene = options_.scene;
    load.on = on;
    load.gpu = options_.backend.device;
    load.threads = options_.threads;
    load.textures = has_color && options_.shade.show == kernels::Show::kTexture;
    load.texture_cache = options_.texture_cache.value_or(0);
    load.device_memory = options_.device_memory;
    load.reading = options_.reading;
    load.pictures = {width(), height(), options_.samples_per_side, has_color ? &options_.shade : nullptr};
    if (const Result<uint64_t> rest = share_host_memory(); rest)
      load.host_memory = *rest;
    else
      return rest.error();
    const bool is_first = scene_ == nullptr;
    renderer_.reset();
    scene_.reset();
    Result<std::shared_ptr<LoadedScene>> scene = LoadedScene::load(std::move(*file), load);
    if (!scene) return with_advice(scene.error());
    scene_ = std::move(*scene);
    if (!options_.quiet && is_first)
      for (const std::string& warning : scene_->scene().warnings())
        std::fprintf(stderr, "scree render: warning: %s: %s\n", options_.file.c_str(), warning.c_str());
    if (!options_.quiet && !scene_->why_cpu().empty()) warn_of_cpu("render", scene_->why_cpu());
    Result<std::unique_ptr<ViewRenderer>> renderer = ViewRenderer::create(scene_);
    if (!renderer) return at(options_.file, with_advice(renderer.error()));
    renderer_ = std::move(*renderer);
    load_ms_ += watch.elapsed().wall_ms;
    return {};
  }

  /// most_waiting_: frames that may wait for being written. Returns what --host-memory leaves for the rest, 0 without
  /// it. Error kMemory: it does not hold one frame.
  Result<uint64_t> share_host_memory() {
    uint64_t bytes = 0;
    for (const Output& output : outputs_)
      bytes += output.layer == Layer::kSamples ? samples() * 8 : pixels() * (output.layer == Layer::kColor ? 8 : 4);
    const uint64_t own = samples() * sizeof(uint64_t) + pixels() * 3 * sizeof(float);  // the renderer's
    const uint64_t allowed = options_.host_memory;
    if (allowed != 0 && allowed <= own + bytes)
      return at(options_.file, Error{ErrorCode::kMemory, "a frame takes " + std::to_string(own + bytes) +
                                                             " bytes of host memory, but --host-memory allows " +
                                                             std::to_string(allowed)});
    const uint64_t waiting = allowed == 0 ? kMostWaitingBytes : std::min(kMostWaitingBytes, (allowed - own) / 2);
    most_waiting_ = std::clamp<uint64_t>(waiting / bytes, 1, options_.threads);
    return allowed == 0 ? 0 : allowed - own - most_waiting_ * bytes;
  }

  /// An error of the device says what to do.
  Error with_advice(Error error) const {
    if (error.code == ErrorCode::kDevice && error.message.find("--backend cpu") == std::string::npos)
      error.message += "; --backend cpu draws without a GPU";
    return error;
  }

  Result<kernels::View> view_of(uint64_t frame) const {
    const PathKey key = path_.at(frame);
    runtime::CameraOptions camera = options_.camera;
    camera.eye = key.eye;
    camera.target = key.target;
    camera.up = key.up;
    camera.fov_degrees = key.fov_degrees;
    const Result<kernels::View> view = scene_->view(camera);
    if (view) return view;
    return Error{view.error().code, options_.path->file + ": frame " + std::to_string(frame) + ", at " +
                                        number(key.t) + " s: " + view.error().message};
  }

  Result<void> check_cameras() const {
    for (const uint64_t frame : frames_)
      if (const Result<kernels::View> view = view_of(frame); !view) return view.error();
    return {};
  }

  Result<void> draw_all() {
    const Stopwatch watch;
    progress_.stage("render", frames_.size(), "frames");
    const StopOnSignal handlers("frames that are there are whole, --resume goes on");
    convert::WorkerPool pool(options_.threads, nullptr);
    convert::OrderedResults<double> written(pool, false);
    const auto take = [&]() -> Result<void> {
      const Result<double> wall_ms = written.take();
      if (!wall_ms) return wall_ms.error();
      write_ms_ += *wall_ms;
      progress_.update(++done_, 0);
      return {};
    };
    for (size_t next = 0; next < frames_.size() || written.size() > 0;) {
      const bool is_stopped = StopOnSignal::flag()->load();
      if (is_stopped && written.size() == 0) return Error{ErrorCode::kFile, "interrupted"};
      if (is_stopped || next == frames_.size() || written.size() >= most_waiting_ || written.ready()) {
        if (const Result<void> taken = take(); !taken) return taken;
        continue;
      }
      Result<DrawnFrame> drawn = draw(frames_[next]);
      if (!drawn && drawn.error().code == ErrorCode::kDevice && options_.backend.choice == BackendChoice::kAuto) {
        // Whatever the GPU fails in, the CPU draws the same pictures.
        if (!options_.quiet) warn_of_cpu("render", drawn.error().message);
        if (const Result<void> opened = open(runtime::DrawOn::kCpu); !opened) return opened;
        continue;
      }
      if (!drawn) return at(options_.file, with_advice(drawn.error()));
      if (const Result<void> whole = check_not_cut(scene_->scene().file().map()); !whole) return whole;
      const auto job = std::make_shared<const DrawnFrame>(std::move(*drawn));
      written.submit([this, job](uint32_t) { return write(*job); }, 0);
      ++next;
    }
    wall_ms_ = watch.elapsed().wall_ms;
    return {};
  }

  Result<DrawnFrame> draw(uint64_t frame) {
    const Result<kernels::View> view = view_of(frame);
    if (!view) return view.error();
    if (const Result<void> done = renderer_->draw(*view, options_.samples_per_side, options_.shade); !done)
      return done.error();
    draw_ms_ += renderer_->draw_time().wall_ms;
    const Stopwatch watch;
    DrawnFrame drawn;
    drawn.frame = frame;
    for (const Output& output : outputs_) {
      std::vector<std::byte>& bytes = drawn.layers.emplace_back(renderer_->layer_bytes(output.layer));
      if (const Result<void> read = renderer_->read(output.layer, bytes); !read) return read.error();
    }
    shade_ms_ += watch.elapsed().wall_ms;
    return drawn;
  }

  /// Milliseconds that it took.
  Result<double> write(const DrawnFrame& drawn) const {
    const Stopwatch watch;
    const format::Existing existing = options_.path->resume ? format::Existing::kReplace : options_.existing;
    for (size_t i = 0; i < outputs_.size(); ++i) {
      const std::string name = outputs_[i].pattern.name(drawn.frame);
      const std::vector<std::byte>& bytes = drawn.layers[i];
      Result<void> done;
      if (outputs_[i].layer == Layer::kColor) {
        done = write_color(name, bytes, existing);
      } else if (outputs_[i].layer == Layer::kDepth) {
        const std::span<const float> depths(reinterpret_cast<const float*>(bytes.data()), pixels());
        done = runtime::write_pfm(name, width(), height(), depths, existing);
      } else {
        const std::span<const uint64_t> words(reinterpret_cast<const uint64_t*>(bytes.data()), samples());
        done = runtime::write_visibility(name, words, existing);
      }
      if (!done) return done.error();
    }
    return watch.elapsed().wall_ms;
  }

  /// With alpha where the background is not opaque, as a single picture is written.
  Result<void> write_color(const std::string& name, std::span<const std::byte> rgba, format::Existing existing) const {
    const uint32_t channels = options_.shade.background[3] >= 1.0f ? 3 : 4;
    std::vector<uint8_t> packed(pixels() * channels);
    for (uint64_t i = 0; i < pixels(); ++i) std::memcpy(packed.data() + i * channels, rgba.data() + i * 4, channels);
    return runtime::write_png(name, width(), height(), channels, packed, existing);
  }

  static std::string number(double value) {
    char text[32];
    std::snprintf(text, sizeof text, "%g", value);
    return text;
  }

  std::string drawn_on() const {
    if (scene_ == nullptr) return "nothing";
    if (scene_->gpu()) return name_of(*scene_->gpu());
    return "the CPU, " + std::to_string(options_.threads) + (options_.threads == 1 ? " thread" : " threads");
  }

  void report() const {
    const uint64_t there = range_.count() - frames_.size();
    if (options_.json) {
      std::string text;
      JsonWriter json(text);
      json.begin_object();
      json.member("file", options_.file);
      json.member("path", options_.path->file);
      json.member("frames", uint64_t{frames_.size()});
      json.member("frames_there", there);
      json.member("width", width());
      json.member("height", height());
      json.member("samples_per_side", options_.samples_per_side);
      json.member("device", drawn_on());
      json.member("load_ms", load_ms_);
      json.member("wall_ms", wall_ms_);
      json.member("draw_ms", draw_ms_);
      json.member("shade_ms", shade_ms_);
      json.member("write_ms", write_ms_);
      json.end_object();
      std::printf("%s\n", text.c_str());
      return;
    }
    if (options_.quiet) return;
    std::string line = options_.file + ": ";
    if (there > 0) line += std::to_string(there) + " of " + std::to_string(range_.count()) + " frames are there";
    if (!frames_.empty()) {
      const auto count = static_cast<double>(frames_.size());
      char rates[160];
      std::snprintf(rates, sizeof rates, " (each: drawing %.1f ms, shading %.1f ms, writing %.1f ms of one thread)",
                    draw_ms_ / count, shade_ms_ / count, write_ms_ / count);
      line += (there > 0 ? ", " : "") + std::to_string(frames_.size()) +
              (frames_.size() == 1 ? " frame of " : " frames of ") + std::to_string(width()) + " x " +
              std::to_string(height()) + " in " + format_duration(wall_ms_ / 1000) + " on " + drawn_on() + rates;
    } else if (there == 0) {
      line += "no frame falls to this share";
    }
    if (range_.count() > 0) {
      line += " -> ";
      for (const Output& output : outputs_) line += (&output == outputs_.data() ? "" : ", ") + names_of(output);
    }
    std::printf("%s\n", line.c_str());
  }

  std::string names_of(const Output& output) const {
    const std::string first = output.pattern.name(range_.frame(0));
    return range_.count() == 1 ? first : first + " to " + output.pattern.name(range_.frame(range_.count() - 1));
  }

  const RenderOptions& options_;
  const CameraPath& path_;
  Progress progress_;
  std::vector<Output> outputs_;
  FrameRange range_;
  std::vector<uint64_t> frames_;  // to be drawn
  std::shared_ptr<LoadedScene> scene_;
  std::unique_ptr<ViewRenderer> renderer_;
  uint64_t most_waiting_ = 1;
  uint64_t done_ = 0;
  double load_ms_ = 0, wall_ms_ = 0, draw_ms_ = 0, shade_ms_ = 0, write_ms_ = 0;
};

}  // namespace

Result<void> render_path(const RenderOptions& options) {
  const Result<CameraPath> path = CameraPath::read(options.path->file, options.path->frames_per_second);
  if (!path) return path.error();
  try {
    return PathRenderer(options, *path).run();
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::kMemory, options.file + ": no memory left for its frames"};
  }
}

}  // namespace scree::tools
