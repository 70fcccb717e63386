#include "runtime/stream_cpu.h"

#include <algorithm>
#include <cstring>
#include <new>
#include <system_error>
#include <utility>

#include "kernels/frame_parts.h"

namespace scree::runtime {

CpuStream::CpuStream(const Scene& scene, Streamer streamer, uint32_t threads)
    : source_(scene),
      streamer_(std::move(streamer)),
      threads_(threads),
      pool_(streamer_.residency().pool_bytes()),
      pages_(streamer_.view().chunk_count, nullptr),
      scene_(streamer_.view()) {
  scene_.pages = pages_.data();
}

CpuStream::~CpuStream() {
  stop_loading();
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
    picture.channels = shade_->background[3] >= 1.0f ? 3 : 4;
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

Result<void> CpuStream::move(std::span<const Residency::Move> moves) {
  for (const Residency::Move& move : moves) std::memmove(pool_.data() + move.to, pool_.data() + move.from, move.bytes);
  return {};
}

Result<void> CpuStream::start_loading(std::span<const Residency::Place> places) {
  std::vector<Residency::Place> own(places.begin(), places.end());
  try {
    loading_.push_back(std::async(std::launch::async,
                                  [this, own = std::move(own)] { return source_.read(own, pool_.data(), threads_); }));
  } catch (const std::system_error&) {  // no thread to be had
    std::promise<Result<void>> done;
    done.set_value(source_.read(places, pool_.data(), threads_));
    loading_.push_back(done.get_future());
  }
  return {};
}

Result<void> CpuStream::finish_loading() {
  Result<void> done = loading_.front().get();
  loading_.pop_front();
  return done;
}

void CpuStream::stop_loading() {
  loading_.clear();  // waits for each
}

Result<kernels::FrameStats> CpuStream::draw(std::span<const Residency::Place> places) {
  for (const Residency::Place& place : places) pages_[place.chunk] = pool_.data() + place.offset;
  Result<kernels::FrameStats> drawn = kernels::draw_part_cpu(scene_, view_, samples_, threads_);
  if (drawn && !colors_.empty())
    if (Result<void> shaded = kernels::shade_part_cpu(scene_, view_, samples_, *shade_, colors_, threads_); !shaded)
      drawn = shaded.error();
  for (const Residency::Place& place : places) pages_[place.chunk] = nullptr;
  return drawn;
}

Result<std::span<const uint32_t>> CpuStream::list() {
  visible_ = VisibleChunks(scene_, view_, threads_);
  return visible_.near_to_far();
}

Result<void> CpuStream::find_depths() {
  codes_.resize(kernels::lay_out(depths_, static_cast<int32_t>(view_.width), static_cast<int32_t>(view_.height)));
  depths_.codes = codes_.data();
  kernels::build_pyramid(depths_, samples_.data());
  return {};
}

}  // namespace scree::runtime
