#include "runtime/draw/stream_cpu.h"

#include <algorithm>
#include <cstring>
#include <new>
#include <utility>

#include "kernels/frame_parts.h"
#include "runtime/threads/stopwatch.h"

namespace scree::runtime {

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

Result<std::unique_ptr<CpuStream>> CpuStream::create(const Scene& scene, uint64_t pool_bytes, uint32_t threads) {
  try {
    const ChunkSource source(scene);
    Result<Streamer> streamer = Streamer::create(scene, pool_bytes, source.chunk_bytes());
    if (!streamer) return streamer.error();
    return std::unique_ptr<CpuStream>(new CpuStream(scene, std::move(*streamer), threads));
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::kMemory, scene.file().path() + ": no memory left for a pool of chunks"};
  }
}

Result<StreamStats> CpuStream::draw_frame(const kernels::View& view, const kernels::ShadeOptions* shade) {
  return streamer_.draw(view, shade, *this);
}

Result<Picture> CpuStream::picture(uint32_t samples_per_side) const {
  if (!shade_) return Error{ErrorCode::kRange, "the frame was not drawn to be shaded"};
  try {
    Picture picture;
    picture.width = view_.width / samples_per_side;
    picture.height = view_.height / samples_per_side;
    picture.channels = picture_channels(*shade_);
    picture.pixels.resize(uint64_t{picture.width} * picture.height * picture.channels);
    const Result<void> resolved = kernels::shades_from_chunks(shade_->show)
                                      ? kernels::resolve_colors_cpu(view_, samples_per_side, samples_, colors_, *shade_,
                                                                    picture.channels, picture.pixels, threads_)
                                      : kernels::resolve_cpu(scene_, view_, samples_per_side, samples_, *shade_,
                                                             picture.channels, picture.pixels, threads_);
    if (!resolved) return resolved.error();
    return picture;
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::kMemory, "no memory left for the picture"};
  }
}

Result<void> CpuStream::begin(const kernels::View& view, const kernels::ShadeOptions* shade) {
  const uint64_t count = uint64_t{view.width} * view.height;
  view_ = view;
  shade_ = shade != nullptr ? std::optional(*shade) : std::nullopt;
  samples_.assign(count, kernels::kBackground);
  colors_.resize(shade_ && kernels::shades_from_chunks(shade_->show) ? 3 * count : 0);
  return {};
}

Result<std::span<const uint32_t>> CpuStream::list() {
  has_depths_ = false;
  visible_ = VisibleChunks(scene_, view_, threads_);
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

/// All of it: the loads have their own thread.
Result<void> CpuStream::start_drawing(std::span<const Residency::Place> places, PartOptions options) {
  drawn_ = {};
  if (options.share == Share::kLikelySeen) return {};  // which it does not know; kRest is all then
  const Stopwatch watch;
  for (const Residency::Place& place : places) pages_[place.chunk] = pool_.data() + place.offset;
  const Result<kernels::FrameStats> drawn = kernels::draw_part_cpu(scene_, view_, samples_, threads_);
  Result<void> done = drawn ? Result<void>() : drawn.error();
  if (done && !colors_.empty()) done = kernels::shade_part_cpu(scene_, view_, samples_, *shade_, colors_, threads_);
  for (const Residency::Place& place : places) pages_[place.chunk] = nullptr;
  if (!done) return done;
  if (options.finds_depths) find_depths();
  drawn_ = {*drawn, watch.elapsed().wall_ms};
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
  kernels::build_pyramid(depths_, samples_.data());
  has_depths_ = true;
}

}  // namespace scree::runtime
