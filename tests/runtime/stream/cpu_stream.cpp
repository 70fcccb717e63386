#include "tests/runtime/stream/cpu_stream.h"

#include <cstring>
#include <new>
#include <utility>

#include "kernels/frame_parts.h"
#include "runtime/threads/stopwatch.h"

namespace scree::tests {

CpuStream::CpuStream(const Scene& scene, Streamer streamer, uint32_t threads)
    : source_(scene),
      streamer_(std::move(streamer)),
      threads_(threads),
      workers_(threads),
      pool_(streamer_.residency().pool_bytes()),
      pages_(streamer_.view().chunk_count, nullptr),
      scene_(streamer_.view()) {
  scene_.pages = pages_.data();
}

Result<std::unique_ptr<CpuStream>> CpuStream::create(const Scene& scene, uint64_t pool_bytes, uint32_t threads) try {
  const ChunkSource source(scene);
  Result<Streamer> streamer = Streamer::create(scene, pool_bytes, source.chunk_bytes());
  if (!streamer) return streamer.error();
  return std::unique_ptr<CpuStream>(new CpuStream(scene, std::move(*streamer), threads));
} catch (const std::bad_alloc&) {
  return Error{ErrorCode::kMemory, scene.file().path() + ": no memory left for a pool of chunks"};
}

Result<StreamStats> CpuStream::draw_frame(const kernels::View& view, const kernels::ShadeOptions* shade,
                                          const IsOver& is_over) {
  over_.clear();
  blended_ = {};
  Result<StreamStats> stats = streamer_.draw(view, shade, *this, is_over);
  if (!stats || shade == nullptr || !kernels::shows_layers(scene_, *shade)) return stats;
  if (const Result<void> drawn = draw_layers(*stats, is_over); !drawn) return drawn.error();
  return stats;
}

Result<uint64_t> CpuStream::load_rest(const IsOver& is_over) {
  const Result<Streamer::Rest> rest = streamer_.load_rest(*this, is_over);
  if (!rest) return rest.error();
  return rest->left_bytes;
}

/// Draws the layers of blended surfaces. Each layer is streamed like the picture, and shaded part by part.
Result<void> CpuStream::draw_layers(StreamStats& stats, const IsOver& is_over) {
  const kernels::LayerSource source{[&](const kernels::BlendTargets& at, const uint64_t* peeled) -> Result<void> {
                                      layer_ = Layer{&at, peeled};
                                      const Result<StreamStats> drawn = streamer_.draw(view_, &*shade_, *this, is_over);
                                      layer_.reset();
                                      if (!drawn) return drawn.error();
                                      stats.add_layer(*drawn);
                                      return {};
                                    },
                                    [](const kernels::BlendTargets&) { return Result<void>(); }};
  Result<std::vector<float>> over =
      kernels::blend_cpu(view_, samples_, shade_->blend_layers, source, threads_, blended_);
  if (!over) return over.error();
  over_ = std::move(*over);
  return {};
}

Result<std::vector<uint8_t>> CpuStream::picture(uint32_t samples_per_side) const try {
  std::vector<uint8_t> rgba(4 * samples_.size() / (samples_per_side * samples_per_side));
  const Result<void> resolved =
      kernels::shades_from_chunks(shade_->show)
          ? kernels::resolve_colors_cpu(view_, samples_per_side, samples_, colors_, over_, *shade_, 4, rgba, threads_)
          : kernels::resolve_cpu(scene_, view_, samples_per_side, samples_, *shade_, 4, rgba, threads_);
  if (!resolved) return resolved.error();
  return rgba;
} catch (const std::bad_alloc&) {
  return Error{ErrorCode::kMemory, "no memory left for the picture"};
}

Result<void> CpuStream::begin(const kernels::View& view, const kernels::ShadeOptions* shade) {
  if (layer_) return {};
  const uint64_t count = uint64_t{view.width} * view.height;
  view_ = view;
  shade_ = shade != nullptr ? std::optional(*shade) : std::nullopt;
  samples_.assign(count, kernels::kBackground);
  colors_.resize(shade_ && kernels::shades_from_chunks(shade_->show) ? 3 * count : 0);
  return {};
}

Result<std::span<const uint32_t>> CpuStream::list() {
  has_depths_ = false;
  visible_ = VisibleChunks(layer_ ? kernels::blended_view(scene_) : scene_, view_, threads_);
  return visible_.near_to_far();
}

Result<void> CpuStream::start_loading(const Residency::Batch& batch) {
  loading_.push_back(loader_.add([this, batch]() -> Result<double> {
    const Stopwatch watch;
    for (const Residency::Move& move : batch.moves)
      std::memmove(pool_.data() + move.to, pool_.data() + move.from, move.bytes);
    if (Result<void> read = source_.read(batch.loads, pool_.data(), ChunkSource::Reader::kProcessor, workers_); !read)
      return read.error();
    return watch.elapsed().wall_ms;
  }));
  return {};
}

Result<double> CpuStream::finish_loading() {
  std::future<Result<double>> oldest = std::move(loading_.front());
  loading_.pop_front();
  return oldest.get();
}

/// Draws the part at once, because loads run on their own thread.
Result<void> CpuStream::start_drawing(std::span<const Residency::Place> places, PartOptions options) {
  drawn_ = {};
  // The CPU has no hints, so kLikelySeen is empty and kRest has all clusters.
  if (options.share == Share::kLikelySeen) return {};
  const Stopwatch watch;
  for (const Residency::Place& place : places) pages_[place.chunk] = pool_.data() + place.offset;
  Result<void> done;
  if (layer_) {
    const kernels::SceneView blended = kernels::blended_view(scene_);
    done = kernels::draw_layer_cpu(blended, view_, *layer_->at, layer_->peeled, threads_);
    if (done) done = kernels::shade_layer_cpu(blended, view_, *layer_->at, layer_->at->drawn, *shade_, threads_);
  } else {
    const Result<kernels::FrameStats> drawn = kernels::draw_part_cpu(scene_, view_, samples_, threads_);
    done = drawn ? Result<void>() : drawn.error();
    if (done && !colors_.empty()) done = kernels::shade_part_cpu(scene_, view_, samples_, *shade_, colors_, threads_);
    if (done) drawn_.stats = *drawn;
  }
  for (const Residency::Place& place : places) pages_[place.chunk] = nullptr;
  if (!done) return done;
  if (options.finds_depths) find_depths();
  drawn_.ms = watch.elapsed().wall_ms;
  return {};
}

Result<StreamTarget::Drawn> CpuStream::finish_drawing() {
  return drawn_;
}

void CpuStream::stop() {
  loading_.clear();
  loader_.wait();
}

void CpuStream::find_depths() {
  codes_.resize(kernels::lay_out(depths_, static_cast<int32_t>(view_.width), static_cast<int32_t>(view_.height)));
  depths_.codes = codes_.data();
  kernels::build_pyramid(depths_, layer_ ? layer_->at->drawn : samples_.data());
  has_depths_ = true;
}

}  // namespace scree::tests
