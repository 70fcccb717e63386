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
#include "runtime/draw/renderer.h"
#include "runtime/draw/shadow_map.h"
#include "runtime/images/image.h"
#include "runtime/scene/scene.h"
#include "runtime/threads/first_error.h"
#include "runtime/threads/parallel.h"
#include "runtime/threads/stopwatch.h"
#include "tools/common/json_writer.h"
#include "tools/common/options.h"
#include "tools/common/output_file.h"
#include "tools/common/sigbus.h"
#include "tools/common/stop_signal.h"

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
    const Stopwatch watch;
    samples_.assign(uint64_t{view_.width} * view_.height, kernels::kBackground);
    const auto drawn = kernels::draw_part_cpu(scene_view_, view_, samples_, options_.threads);
    if (!drawn) return at(options_.file, drawn.error());
    if (const Result<void> done = draw_shadows(); !done) return done;
    draw_ms_ = watch.elapsed().wall_ms;
    return check_not_cut(scene_->file().map());
  }

  /// Combines the parts of all ranks, and writes the outputs at rank 0.
  Result<void> compose() {
    const Stopwatch watch;
    if (const Result<void> done = ranks_.least(samples_); !done) return done;
    if (const Result<void> done = ranks_.least(shadows_); !done) return done;
    exchange_ms_ = watch.elapsed().wall_ms;
    const bool is_shaded = !options_.output.empty() && kernels::shades_from_chunks(options_.shade.show);
    if (is_shaded)
      if (const Result<void> done = shade(); !done) return done;
    if (ranks_.is_first())
      if (const Result<void> done = write(); !done) return done;
    return report();
  }

 private:
  Result<void> check() const {
    const std::pair<const char*, bool> others[] = {{"--pick", !options_.picks.empty()},
                                                   {"--stats", options_.stats},
                                                   {"--list-cameras", options_.list_cameras},
                                                   {"--frames", options_.frames != 1},
                                                   {"--normals", !options_.normals.empty()},
                                                   {"--uvs", !options_.uvs.empty()},
                                                   {"an .exr picture", options_.writes_exr()},
                                                   {"--backend cuda", options_.backend.choice == BackendChoice::kCuda}};
    for (const auto& [name, is_given] : others)
      if (is_given)
        return Error{ErrorCode::kUsage, std::string(name) + " cannot be used when " + std::to_string(ranks_.count()) +
                                            " ranks draw one picture on their CPUs"};
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
    const Result<void> loaded = load_own_pages();
    load_ms_ = watch.elapsed().wall_ms;
    return loaded;
  }

  Result<void> load_own_pages() {
    const runtime::DrawnPages& drawn = scene_->drawn_pages();
    const format::Container& container = scene_->container();
    const std::vector<uint32_t> owners = runtime::owners_of_pages(drawn, ranks_.count());
    pages_.assign(container.pages().size(), nullptr);
    unpacked_.resize(drawn.size());
    runtime::FirstError failure;
    runtime::parallel_for(drawn.size(), options_.threads, [&](uint64_t i) {
      if (owners[i] != ranks_.rank() || failure.is_superseded(i)) return;
      const auto raw = container.load_page(drawn.page(i), unpacked_[i]);
      if (!raw) return failure.report(i, raw.error());
      if (const Result<void> checked = drawn.check(i, *raw); !checked) return failure.report(i, checked.error());
      pages_[drawn.page(i)] = raw->data();
    });
    for (uint64_t i = 0; i < drawn.size(); ++i)
      if (owners[i] == ranks_.rank()) own_bytes_ += static_cast<double>(drawn.record(i).stored_bytes);
    if (failure.any()) return at(options_.file, failure.error());
    scene_view_ = scene_->view();
    scene_view_.pages = pages_.data();
    return {};
  }

  /// Fills shadows_ and shade_.sun: this rank's part of the map.
  Result<void> draw_shadows() {
    shade_ = options_.shade;
    if (options_.light.shadow_side == 0) return {};
    const std::optional<kernels::SunShadow> sun = runtime::sun_of(*scene_, view_, options_.light.shadow_side);
    if (!sun) return {};
    sun_ = *sun;
    shadows_.assign(uint64_t{sun_.view.width} * sun_.view.height, kernels::kBackground);
    sun_.samples = shadows_.data();
    shade_.sun = &sun_;
    const auto drawn = kernels::draw_part_cpu(scene_view_, sun_.view, shadows_, options_.threads);
    return drawn ? Result<void>() : at(options_.file, drawn.error());
  }

  /// Fills colors_ of all samples at rank 0. Each rank leaves the samples of other ranks at 0, so the sums are the
  /// colours.
  Result<void> shade() {
    const Stopwatch watch;
    colors_.assign(3 * samples_.size(), 0.0f);
    if (const auto shaded = kernels::shade_part_cpu(scene_view_, view_, samples_, shade_, colors_, options_.threads);
        !shaded)
      return at(options_.file, shaded.error());
    if (const Result<void> whole = check_not_cut(scene_->file().map()); !whole) return whole;
    shade_ms_ = watch.elapsed().wall_ms;
    const Stopwatch gather_watch;
    const Result<void> summed = ranks_.sum(std::span(colors_));
    exchange_ms_ += gather_watch.elapsed().wall_ms;
    if (!summed || !kernels::shows_layers(scene_view_, options_.shade)) return summed;
    return draw_layers();
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
          const Result<void> summed = ranks_.sum(std::span(at.colors, 3 * uint64_t{at.sample_count}));
          if (!shaded) return shaded;
          return joined ? summed : joined;
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

  Result<void> write() {
    const StopOnSignal handlers;
    if (!options_.output.empty()) {
      const uint32_t channels = runtime::picture_channels(options_.shade);
      std::vector<uint8_t> pixels(uint64_t{width()} * height() * channels);
      const Result<void> resolved =
          kernels::shades_from_chunks(options_.shade.show)
              ? kernels::resolve_colors_cpu(view_, options_.samples_per_side, samples_, colors_, over_, options_.shade,
                                            channels, pixels, options_.threads)
              : kernels::resolve_cpu(scene_view_, view_, options_.samples_per_side, samples_, options_.shade, channels,
                                     pixels, options_.threads);
      if (!resolved) return at(options_.file, resolved.error());
      if (const auto done = runtime::write_png(options_.output, width(), height(), channels, pixels, options_.existing);
          !done)
        return done;
      note_written(options_.output);
    }
    if (!options_.depth.empty()) {
      std::vector<float> depths(uint64_t{width()} * height());
      kernels::LayerTargets targets{};
      targets.depth = depths.data();
      if (const auto made =
              kernels::layers_cpu(scene_view_, view_, options_.samples_per_side, samples_, targets, options_.threads);
          !made)
        return at(options_.file, made.error());
      if (const auto done = runtime::write_pfm(options_.depth, width(), height(), depths, options_.existing); !done)
        return done;
      note_written(options_.depth);
    }
    if (!options_.visbuffer.empty()) {
      if (const auto done = runtime::write_visibility(options_.visbuffer, samples_, options_.existing); !done)
        return done;
      note_written(options_.visbuffer);
    }
    return {};
  }

  Result<void> report() {
    double sums[] = {load_ms_, draw_ms_, shade_ms_, own_bytes_};
    if (const Result<void> summed = ranks_.sum(std::span<double>(sums)); !summed) return summed;
    if (!ranks_.is_first()) return {};
    const double each = 1.0 / ranks_.count();
    if (options_.json) {
      std::string text;
      JsonWriter json(text);
      json.begin_object();
      json.member("file", options_.file);
      json.member("width", width());
      json.member("height", height());
      json.member("samples_per_side", options_.samples_per_side);
      json.member("ranks", ranks_.count());
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
      std::printf(
          "%s: %u x %u on the CPUs of %u ranks (each: loading %s of pages %.0f ms, drawing %.1f ms, shading %.1f ms; "
          "exchange %.1f ms) -> %s\n",
          options_.file.c_str(), width(), height(), ranks_.count(),
          format_bytes(static_cast<uint64_t>(sums[3] * each)).c_str(), sums[0] * each, sums[1] * each, sums[2] * each,
          exchange_ms_, places.c_str());
    }
    return {};
  }

  const RenderOptions& options_;
  Ranks& ranks_;
  std::optional<runtime::Scene> scene_;
  std::vector<std::vector<std::byte>> unpacked_;  // of this rank's compressed pages
  std::vector<const std::byte*> pages_;           // by page number; null: another rank's
  kernels::SceneView scene_view_{};               // with this rank's pages only
  kernels::View view_{};                          // width and height in samples
  std::vector<uint64_t> samples_;
  kernels::ShadeOptions shade_;  // of options_, with the sun
  kernels::SunShadow sun_{};
  std::vector<uint64_t> shadows_;  // its samples; empty without shadows
  std::vector<float> colors_;
  std::vector<float> over_;  // colours of blended surfaces; empty if there are none
  kernels::BlendCounts blended_;
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
