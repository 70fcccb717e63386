#include "tools/render/render_ranks.h"

#include <algorithm>
#include <bit>
#include <cstdio>
#include <new>
#include <optional>
#include <string>
#include <utility>

#include "kernels/blend.h"
#include "kernels/frame_parts.h"
#include "runtime/draw/device_scene.h"
#include "runtime/draw/renderer.h"
#include "runtime/draw/shadow_map.h"
#include "runtime/scene/scene.h"
#include "runtime/threads/first_error.h"
#include "runtime/threads/parallel.h"
#include "runtime/threads/stopwatch.h"
#include "tools/common/backend.h"
#include "tools/common/json_writer.h"
#include "tools/common/options.h"
#include "tools/common/output_file.h"
#include "tools/common/sigbus.h"
#include "tools/common/stop_signal.h"
#include "tools/render/exr.h"
#include "tools/render/layers.h"
#include "tools/render/outputs.h"

namespace scree::tools {
namespace {

using runtime::Stopwatch;

class RankedPicture {
 public:
  RankedPicture(const RenderOptions& options, Ranks& ranks) : options_(options), ranks_(ranks) {}

  /// Loads and draws this rank's part. Errors concern this rank alone.
  Result<void> draw() {
    if (const Result<void> done = check(); !done) return done;
    if (const Result<void> done = load(); !done) return done;
    samples_.resize(uint64_t{view_.width} * view_.height);
    if (const Result<void> done = place_sun(); !done) return done;
    for (uint32_t i = 0; i < options_.frames; ++i) {
      const Stopwatch watch;
      if (const Result<void> done = draw_frame(); !done) return done;
      draw_ms_ = watch.elapsed().wall_ms;
    }
    return check_not_cut(scene_->file().map());
  }

  /// Combines the parts of all ranks, and writes the outputs at rank 0.
  Result<void> compose() {
    const Stopwatch watch;
    if (const Result<void> done = ranks_.least(samples_); !done) return done;
    if (const Result<void> done = ranks_.least(shadows_); !done) return done;
    exchange_ms_ = watch.elapsed().wall_ms;
    const bool has_colors = options_.writes_exr() ? options_.layers.color : !options_.output.empty();
    if (has_colors && kernels::shades_from_chunks(options_.shade.show))
      if (const Result<void> done = shade(); !done) return done;
    const LayersOfFrame source{[&](runtime::PixelLayer layer, std::span<std::byte> out) { return read(layer, out); },
                               [&](kernels::BlendCounts&) { return linear(); }};
    Result<FrameLayers> layers = make_layers(options_, *scene_, source, false);
    if (!layers) return at(options_.file, layers.error());
    outputs_.layers = std::move(*layers);
    if (ranks_.is_first())
      if (const Result<void> done = write(); !done) return done;
    return report();
  }

 private:
  Result<void> check() const {
    const std::pair<const char*, bool> others[] = {{"--stats", options_.stats}, {"--gpus", options_.backend.gpus != 1}};
    for (const auto& [name, is_given] : others)
      if (is_given)
        return Error{ErrorCode::kUsage, std::string(name) + " cannot be used when " + std::to_string(ranks_.count()) +
                                            " ranks draw one picture"};
    if (options_.writes_exr())
      if (const Result<void> supported = check_exr_support(); !supported) return at(options_.output, supported.error());
    if (!ranks_.is_first()) return {};
    for (const auto& [name, path] : options_.outputs())
      if (const Result<void> checked = check_output_file(path, options_.existing); !checked) return checked;
    return {};
  }

  Result<void> load() {
    const Stopwatch watch;
    report_sigbus("render", options_.file);
    Result<runtime::SceneFile> file = runtime::SceneFile::open(options_.file);
    if (!file) return file.error();
    const Result<uint32_t> index = file->find_scene(options_.scene);
    if (!index) return index.error();
    runtime::SceneOptions load = options_.scene_options();
    load.pages = false;
    Result<runtime::Scene> scene = runtime::Scene::load(std::move(*file), *index, load);
    if (!scene) return scene.error();
    scene_.emplace(std::move(*scene));
    const bool is_quiet = options_.quiet || !ranks_.is_first();
    if (const auto accepted = accept_scene("render", *scene_, options_.light, is_quiet); !accepted) return accepted;
    // A default view of a small scene is fitted to its vertices, so every rank then reads all pages.
    if (runtime::view_reads_vertices(scene_->view(), options_.camera))
      if (const Result<void> loaded = scene_->load_pages(options_.threads); !loaded) return loaded;
    const Result<kernels::View> view = runtime::make_view(scene_->container(), *index, scene_->view(), options_.camera);
    if (!view) return at(options_.file, view.error());
    view_ = *view;
    view_.width *= options_.samples_per_side;
    view_.height *= options_.samples_per_side;
    scene_view_ = scene_->view();
    pages_.assign(scene_->container().pages().size(), nullptr);
    scene_view_.pages = pages_.data();
    shade_ = options_.shade;
    const runtime::DrawnPages& drawn = scene_->drawn_pages();
    owners_ = runtime::owners_of_pages(drawn, ranks_.count());
    for (uint64_t i = 0; i < drawn.size(); ++i)
      if (owners_[i] == ranks_.rank()) own_bytes_ += static_cast<double>(drawn.record(i).stored_bytes);
    Result<void> loaded = open_gpu();
    // The CPU draws layers of blended surfaces, and makes normals and texture coordinates.
    const bool reads_surfaces = !options_.normals.empty() || !options_.uvs.empty() ||
                                (options_.writes_exr() && (options_.layers.normal || options_.layers.uv));
    if (loaded && (!device_ || reads_surfaces || kernels::shows_layers(scene_view_, options_.shade)))
      loaded = load_own_pages();
    load_ms_ = watch.elapsed().wall_ms;
    return loaded;
  }

  /// Uploads this rank's pages to its GPU, if it has one and --backend allows it.
  Result<void> open_gpu() {
    BackendOptions backend = options_.backend;
    backend.device = gpu_of_rank(backend, ranks_.rank_on_host());
    const Result<std::optional<runtime::Gpu>> gpu = choose_gpu("render", backend, options_.quiet || !ranks_.is_first());
    if (!gpu) return at(options_.file, with_cpu_advice(gpu.error()));
    if (!gpu->has_value()) return {};
    runtime::PictureNeeds pictures{options_.camera.width, options_.camera.height, options_.samples_per_side,
                                   options_.output.empty() ? nullptr : &options_.shade};
    pictures.shadow_side = options_.light.shadow_side;
    const runtime::PageShare share{owners_, ranks_.rank()};
    Result<runtime::DeviceScene> uploaded = runtime::DeviceScene::upload(
        *scene_, options_.device_memory, options_.threads, options_.reading, options_.textures.device_cache(),
        options_.host_memory, pictures, nullptr, 1, false, &share);
    if (!uploaded && uploaded.error().code != ErrorCode::kDevice) return uploaded.error();
    if (!uploaded) return falls_back(uploaded.error());
    device_ = std::move(*uploaded);
    return {};
  }

  /// After an error of the GPU: with --backend auto the CPU does the rest.
  Result<void> falls_back(const Error& error) {
    if (error.code != ErrorCode::kDevice || options_.backend.choice != BackendChoice::kAuto)
      return at(options_.file, with_cpu_advice(error));
    if (!options_.quiet) warn_of_cpu("render", ranks_.named(error).message);
    sun_on_gpu_.reset();
    device_.reset();
    return {};
  }

  template <class OnGpu, class OnCpu>
  Result<void> on_gpu_or_cpu(const OnGpu& on_gpu, const OnCpu& on_cpu) {
    if (device_) {
      const Result<void> done = on_gpu();
      if (done) return done;
      if (const Result<void> goes_on = falls_back(done.error()); !goes_on) return goes_on;
      if (const Result<void> loaded = load_own_pages(); !loaded) return loaded;
    }
    return on_cpu();
  }

  Result<void> load_own_pages() {
    if (!unpacked_.empty()) return {};
    const runtime::DrawnPages& drawn = scene_->drawn_pages();
    const format::Container& container = scene_->container();
    unpacked_.resize(drawn.size());
    runtime::FirstError failure;
    runtime::parallel_for(drawn.size(), options_.threads, [&](uint64_t i) {
      if (owners_[i] != ranks_.rank() || failure.is_superseded(i)) return;
      const auto raw = container.load_page(drawn.page(i), unpacked_[i]);
      if (!raw) return failure.report(i, raw.error());
      if (const Result<void> checked = drawn.check(i, *raw); !checked) return failure.report(i, checked.error());
      pages_[drawn.page(i)] = raw->data();
    });
    return failure.any() ? Result<void>(at(options_.file, failure.error())) : Result<void>();
  }

  /// Fills sun_, and makes room for its samples.
  Result<void> place_sun() {
    if (options_.light.shadow_side == 0) return {};
    const std::optional<kernels::SunShadow> sun = runtime::sun_of(*scene_, view_, options_.light.shadow_side);
    if (!sun) return {};
    sun_ = *sun;
    shadows_.resize(uint64_t{sun_.view.width} * sun_.view.height);
    sun_.samples = shadows_.data();
    shade_.sun = &sun_;
    return {};
  }

  /// Fills samples_, and shadows_ if there are any.
  Result<void> draw_frame() {
    return on_gpu_or_cpu([&] { return draw_on_gpu(); },
                         [&] {
                           const Result<void> picture = draw_on_cpu(view_, samples_);
                           return picture && !shadows_.empty() ? draw_on_cpu(sun_.view, shadows_) : picture;
                         });
  }

  Result<void> draw_on_cpu(const kernels::View& view, std::span<uint64_t> samples) {
    std::fill(samples.begin(), samples.end(), kernels::kBackground);
    const auto drawn = kernels::draw_part_cpu(scene_view_, view, samples, options_.threads);
    return drawn ? Result<void>() : at(options_.file, drawn.error());
  }

  Result<void> draw_on_gpu() {
    const auto draw = [](auto& device, const kernels::View& view, std::span<uint64_t> samples) -> Result<void> {
      const Result<kernels::FrameStats> drawn = device.draw(view);
      return drawn ? device.read_samples(samples) : Result<void>(drawn.error());
    };
    if (!shadows_.empty()) {
      if (!sun_on_gpu_) {
        Result<runtime::DeviceView> first = device_->add_view(*scene_);  // the one that `device_` draws
        Result<runtime::DeviceView> second = device_->add_view(*scene_);
        if (!first) return first.error();
        if (!second) return second.error();
        sun_on_gpu_ = std::move(*second);
      }
      if (const Result<void> drawn = draw(*sun_on_gpu_, sun_.view, shadows_); !drawn) return drawn;
    }
    return draw(*device_, view_, samples_);
  }

  /// Fills colors_ of all samples at rank 0. Each rank leaves the samples of other ranks at 0.
  Result<void> shade() {
    const Stopwatch watch;
    const Result<void> shaded = on_gpu_or_cpu([&] { return shade_on_gpu(); }, [&] { return shade_on_cpu(); });
    if (!shaded) return shaded;
    if (const Result<void> whole = check_not_cut(scene_->file().map()); !whole) return whole;
    shade_ms_ = watch.elapsed().wall_ms;
    const Stopwatch gather_watch;
    const Result<void> gathered = ranks_.gather(std::span(colors_));
    exchange_ms_ += gather_watch.elapsed().wall_ms;
    if (!gathered || !kernels::shows_layers(scene_view_, options_.shade)) return gathered;
    return draw_layers();
  }

  Result<void> shade_on_cpu() {
    colors_.assign(3 * samples_.size(), 0.0f);
    const auto shaded = kernels::shade_part_cpu(scene_view_, view_, samples_, shade_, colors_, options_.threads);
    return shaded ? shaded : at(options_.file, shaded.error());
  }

  Result<void> shade_on_gpu() {
    colors_.resize(3 * samples_.size());
    kernels::ShadeOptions shade = shade_;
    kernels::SunShadow sun = sun_;
    if (sun_on_gpu_) {
      if (const Result<void> written = sun_on_gpu_->write_samples(shadows_); !written) return written;
      const Result<const uint64_t*> samples = sun_on_gpu_->samples();
      if (!samples) return samples.error();
      sun.samples = *samples;
      shade.sun = &sun;
    }
    const Result<void> written = device_->write_samples(samples_);
    return written ? device_->read_colors(view_, shade, colors_) : written;
  }

  /// Fills over_ at rank 0. Every rank draws and shades its own part of each layer.
  Result<void> draw_layers() {
    const kernels::SceneView blended = kernels::blended_view(scene_view_);
    const kernels::LayerSource source{
        [&](const kernels::BlendTargets& at, const uint64_t* peeled) -> Result<void> {
          const Result<void> drawn = kernels::draw_layer_cpu(blended, view_, at, peeled, options_.threads);
          const Result<void> joined = ranks_.least({at.drawn, at.sample_count});
          return drawn ? joined : drawn;
        },
        [&](const kernels::BlendTargets& at) -> Result<void> {
          std::fill_n(at.colors, 3 * uint64_t{at.sample_count}, 0.0f);
          std::fill_n(at.alphas, at.sample_count, -1.0f);
          const Result<void> shaded = kernels::shade_layer_cpu(blended, view_, at, at.layer, shade_, options_.threads);
          // All ranks need the alphas, so that they end a sample's layers at the same layer.
          std::vector<uint64_t> alphas(at.sample_count);
          for (size_t i = 0; i < alphas.size(); ++i)
            alphas[i] = at.alphas[i] >= 0 ? std::bit_cast<uint32_t>(at.alphas[i]) : UINT64_MAX;
          const Result<void> joined = ranks_.least(alphas);
          for (size_t i = 0; i < alphas.size(); ++i)
            at.alphas[i] = std::bit_cast<float>(static_cast<uint32_t>(alphas[i]));
          const Result<void> gathered = ranks_.gather(std::span(at.colors, 3 * uint64_t{at.sample_count}));
          if (!shaded) return shaded;
          return joined ? gathered : joined;
        }};
    Result<std::vector<float>> over =
        kernels::blend_cpu(view_, samples_, options_.shade.blend_layers, source, options_.threads, blended_);
    if (!over) return at(options_.file, over.error());
    over_ = std::move(*over);
    if (!options_.quiet && ranks_.is_first())
      warn_of_layers("render", options_.file, blended_.samples_left_out, "sample", blended_.layers);
    return {};
  }

  uint32_t width() const { return options_.camera.width; }
  uint32_t height() const { return options_.camera.height; }

  /// The values of a layer, which need the owner's page if they are of surfaces. Complete at rank 0.
  Result<void> read(runtime::PixelLayer layer, std::span<std::byte> out) {
    const auto make = [&](runtime::PixelLayer of, std::span<const uint64_t> samples, std::byte* values) {
      return kernels::layers_cpu(scene_view_, view_, options_.samples_per_side, samples, runtime::target_of(of, values),
                                 options_.threads);
    };
    if (layer != runtime::PixelLayer::kNormal && layer != runtime::PixelLayer::kUv)
      return make(layer, samples_, out.data());
    std::vector<int64_t> triangles(uint64_t{width()} * height());
    if (const auto found =
            make(runtime::PixelLayer::kTriangle, samples_, reinterpret_cast<std::byte*>(triangles.data()));
        !found)
      return found;
    // A pixel whose triangle another rank has becomes background here, whose values are 0.
    const uint64_t side = options_.samples_per_side;
    std::vector<uint64_t> own = samples_;
    runtime::parallel_for(height(), options_.threads, [&](uint64_t y) {
      for (uint64_t x = 0; x < width(); ++x) {
        const int64_t triangle = triangles[y * width() + x];
        if (triangle < 0 || has_page_of(static_cast<uint64_t>(triangle))) continue;
        for (uint64_t j = 0; j < side; ++j)
          std::fill_n(own.begin() + static_cast<ptrdiff_t>((y * side + j) * view_.width + x * side), side,
                      kernels::kBackground);
      }
    });
    if (const Result<void> made = make(layer, own, out.data()); !made) return made;
    if (const Result<void> whole = check_not_cut(scene_->file().map()); !whole) return whole;
    return ranks_.gather({reinterpret_cast<float*>(out.data()), out.size() / sizeof(float)});
  }

  bool has_page_of(uint64_t triangle) const {
    return pages_[scene_view_.chunks[kernels::find_triangle(scene_view_, triangle).chunk].page] != nullptr;
  }

  /// As Frame::linear(), at rank 0.
  Result<std::vector<float>> linear() {
    if (!ranks_.is_first()) return std::vector<float>();
    runtime::PictureLight light =
        runtime::light_of_cpu(scene_view_, view_, options_.samples_per_side, samples_, shade_, options_.threads);
    light.colors = [&](std::span<float> colors) -> Result<void> {
      std::copy(colors_.begin(), colors_.end(), colors.begin());
      return {};
    };
    light.over = [&](std::vector<float>& over, kernels::BlendCounts&) -> Result<void> {
      over = over_;
      return {};
    };
    kernels::BlendCounts blended;
    std::vector<float> out(uint64_t{4} * width() * height());
    const Result<void> made = runtime::linear_picture(scene_view_, view_, options_.samples_per_side, samples_, shade_,
                                                      options_.threads, light, out, blended);
    if (!made) return made.error();
    return out;
  }

  Result<void> write() {
    if (!options_.output.empty() && !options_.writes_exr()) {
      runtime::Picture& picture = outputs_.picture.emplace();
      picture.width = width();
      picture.height = height();
      picture.channels = runtime::picture_channels(options_.shade);
      picture.pixels.resize(uint64_t{width()} * height() * picture.channels);
      const Result<void> resolved =
          kernels::shades_from_chunks(options_.shade.show)
              ? kernels::resolve_colors_cpu(view_, options_.samples_per_side, samples_, colors_, over_, options_.shade,
                                            picture.channels, picture.pixels, options_.threads)
              : kernels::resolve_cpu(scene_view_, view_, options_.samples_per_side, samples_, options_.shade,
                                     picture.channels, picture.pixels, options_.threads);
      if (!resolved) return at(options_.file, resolved.error());
    }
    if (const auto written = write_outputs(options_, scene_->file().map(), outputs_, samples_); !written)
      return written.error();
    return print_picks(options_, *scene_, view_, samples_);
  }

  Result<void> report() {
    double sums[] = {load_ms_, draw_ms_, shade_ms_, own_bytes_, device_ ? 1.0 : 0.0};
    if (const Result<void> summed = ranks_.sum(std::span<double>(sums)); !summed) return summed;
    if (!ranks_.is_first()) return {};
    const double each = 1.0 / ranks_.count();
    const auto gpus = static_cast<uint32_t>(sums[4]);
    if (options_.json) {
      std::string text;
      JsonWriter json(text);
      json.begin_object();
      json.member("file", options_.file);
      json.member("width", width());
      json.member("height", height());
      json.member("samples_per_side", options_.samples_per_side);
      json.member("ranks", ranks_.count());
      json.member("gpus", gpus);
      json.member("page_bytes", static_cast<uint64_t>(sums[3]));
      json.member("blended_layers", uint64_t{blended_.layers});
      json.member("samples_with_more_layers", blended_.samples_left_out);
      json.member("load_ms", sums[0] * each);
      json.member("draw_ms", sums[1] * each);
      json.member("shade_ms", sums[2] * each);
      json.member("exchange_ms", exchange_ms_);
      json.end_object();
      std::printf("%s\n", text.c_str());
    } else if (!options_.quiet) {
      std::string places;
      for (const auto& [name, path] : options_.outputs())
        if (!path.empty()) places += (places.empty() ? "" : ", ") + path;
      const std::string processors = gpus == 0                ? "the CPUs"
                                     : gpus == ranks_.count() ? "the GPUs"
                                                              : std::to_string(gpus) + " GPUs and the CPUs";
      std::printf(
          "%s: %u x %u on %s of %u ranks (each: loading %s of pages %.0f ms, drawing %.1f ms, shading %.1f ms; "
          "exchange %.1f ms) -> %s\n",
          options_.file.c_str(), width(), height(), processors.c_str(), ranks_.count(),
          format_bytes(static_cast<uint64_t>(sums[3] * each)).c_str(), sums[0] * each, sums[1] * each, sums[2] * each,
          exchange_ms_, places.c_str());
    }
    return {};
  }

  const RenderOptions& options_;
  Ranks& ranks_;
  std::optional<runtime::Scene> scene_;
  std::vector<uint32_t> owners_;                // of the drawn pages
  std::optional<runtime::DeviceScene> device_;  // with this rank's pages; none if the CPU draws
  std::optional<runtime::DeviceView> sun_on_gpu_;
  std::vector<std::vector<std::byte>> unpacked_;  // of this rank's compressed pages
  std::vector<const std::byte*> pages_;           // by page number; null: another rank's, or only on the GPU
  kernels::SceneView scene_view_{};               // with this rank's pages only
  kernels::View view_{};                          // width and height in samples
  std::vector<uint64_t> samples_;
  kernels::ShadeOptions shade_;  // of options_, with the sun
  kernels::SunShadow sun_{};
  std::vector<uint64_t> shadows_;  // its samples; empty without shadows
  std::vector<float> colors_;
  std::vector<float> over_;  // colours of blended surfaces; empty if there are none
  kernels::BlendCounts blended_;
  FrameOutputs outputs_;
  double load_ms_ = 0, draw_ms_ = 0, shade_ms_ = 0, exchange_ms_ = 0, own_bytes_ = 0;
};

}  // namespace

Result<void> render_ranks(const RenderOptions& options, Ranks& ranks) {
  end_silently_on_signal();
  Result<void> done;
  try {
    RankedPicture picture(options, ranks);
    done = ranks.agree(picture.draw());
    if (done) done = picture.compose();
  } catch (const std::bad_alloc&) {
    done = Error{ErrorCode::kMemory, options.file + ": no memory left for its picture"};
  }
  if (!done) return ranks.named(done.error());
  ranks.leave();
  return {};
}

}  // namespace scree::tools
