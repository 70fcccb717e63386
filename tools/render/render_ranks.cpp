#include "tools/render/render_ranks.h"

#include <cstdio>
#include <new>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "runtime/scene/scene.h"
#include "tools/common/options/options.h"
#include "tools/common/output/json_writer.h"
#include "tools/common/output/output_file.h"
#include "tools/common/process/stop_signal.h"
#include "tools/render/exr.h"
#include "tools/render/outputs.h"
#include "tools/render/ranked_frame.h"

namespace scree::tools {
namespace {

class RankedPicture {
 public:
  RankedPicture(const RenderOptions& options, Ranks& ranks)
      : options_(options), ranks_(ranks), frame_(options, ranks) {}

  /// Draws the picture, and writes the outputs at rank 0.
  Result<void> run() {
    SCREE_TRY(ranks_.agree(check()));
    SCREE_TRY(frame_.open(options_.frames));
    const runtime::Scene& scene = frame_.scene();
    const Result<kernels::View> view = runtime::make_view(scene, options_.camera);
    SCREE_TRY(ranks_.agree(view ? Result<void>() : at(options_.file, view.error())));
    for (uint32_t i = 1; i <= options_.frames; ++i) {
      SCREE_TRY(frame_.draw(*view, 0, i < options_.frames ? std::optional(*view) : std::nullopt));
      SCREE_TRY(frame_.shade());
    }
    if (!options_.quiet && ranks_.is_first())
      warn_of_layers("render", options_.file, frame_.blended().samples_left_out, "sample", frame_.blended().layers);
    outputs_.layers = SCREE_TRY(frame_.layers());
    if (ranks_.is_first()) SCREE_TRY(write());
    return report();
  }

 private:
  uint32_t width() const { return options_.camera.width; }
  uint32_t height() const { return options_.camera.height; }

  Result<void> check() const {
    const std::pair<const char*, bool> others[] = {{"--stats", options_.stats}, {"--gpus", options_.backend.gpus != 1}};
    for (const auto& [name, is_given] : others)
      if (is_given)
        return Error{ErrorCode::kUsage, std::string(name) + " cannot be used when " + std::to_string(ranks_.count()) +
                                            " ranks draw one picture"};
    if (options_.writes_exr()) SCREE_TRY_AT(options_.output, check_exr_support());
    if (!ranks_.is_first()) return {};
    for (const auto& [name, path] : options_.outputs()) SCREE_TRY(check_output_file(path, options_.existing));
    return {};
  }

  Result<void> write() {
    std::vector<uint32_t> rgba;
    if (!options_.output.empty() && !options_.writes_exr()) {
      rgba.resize(uint64_t{width()} * height());
      SCREE_TRY(frame_.read_picture(rgba));
      SCREE_TRY(frame_.end_reads());
    }
    outputs_.rgba = std::as_bytes(std::span(rgba));
    outputs_.samples = frame_.samples();
    SCREE_TRY(write_outputs(options_, frame_.scene().file().map(), outputs_));
    picks_ = SCREE_TRY(find_picks(options_, frame_.scene(), frame_.view(), frame_.samples()));
    if (!options_.json) print_picks(frame_.scene().container(), picks_);
    return {};
  }

  Result<void> report() {
    const RankedFrame::Times& times = frame_.times();
    double sums[] = {times.load, times.draw, times.shade, frame_.page_bytes(), frame_.has_gpu() ? 1.0 : 0.0};
    SCREE_TRY(ranks_.sum(std::span<double>(sums)));
    if (!ranks_.is_first()) return {};
    const double each = 1.0 / ranks_.count();
    const auto gpus = static_cast<uint32_t>(sums[4]);
    if (options_.json) {
      const std::string text = json_object([&](JsonWriter& json) {
        json.member("file", options_.file);
        json.member("width", width());
        json.member("height", height());
        json.member("samples_per_side", options_.samples_per_side);
        json.member("ranks", ranks_.count());
        json.member("gpus", gpus);
        json.member("page_bytes", static_cast<uint64_t>(sums[3]));
        json.member("blended_layers", uint64_t{frame_.blended().layers});
        json.member("samples_with_more_layers", frame_.blended().samples_left_out);
        json.member("load_ms", sums[0] * each);
        json.member("connect_ms", times.connect);
        json.member("draw_ms", sums[1] * each);
        json.member("shade_ms", sums[2] * each);
        json.member("exchange", frame_.way());
        json.member("exchange_ms", times.exchange);
        write_picks(json, frame_.scene().container(), picks_);
      });
      std::printf("%s\n", text.c_str());
    } else if (!options_.quiet) {
      std::string places;
      for (const auto& [name, path] : options_.outputs())
        if (!path.empty()) places += (places.empty() ? "" : ", ") + path;
      std::printf(
          "%s: %u x %u on %s of %u ranks (each: loading %s of pages %.0f ms, drawing %.1f ms, shading %.1f ms; "
          "exchange by %s %.2f ms) -> %s\n",
          options_.file.c_str(), width(), height(), RankedFrame::processors(gpus, ranks_.count()).c_str(),
          ranks_.count(), format_bytes(static_cast<uint64_t>(sums[3] * each)).c_str(), sums[0] * each, sums[1] * each,
          sums[2] * each, frame_.way(), times.exchange, places.c_str());
    }
    return {};
  }

  const RenderOptions& options_;
  Ranks& ranks_;
  RankedFrame frame_;
  FrameOutputs outputs_;
  std::vector<FoundPick> picks_;
};

}  // namespace

Result<void> render_ranks(const RenderOptions& options, Ranks& ranks) {
  end_silently_on_signal();
  Result<void> done;
  try {
    RankedPicture picture(options, ranks);
    done = picture.run();
  } catch (const std::bad_alloc&) {
    done = Error{ErrorCode::kMemory, options.file + ": no memory left for its picture"};
  }
  if (!done) return ranks.named(done.error());
  ranks.leave();
  return {};
}

}  // namespace scree::tools
