#include "runtime/stream_cuda.h"

#include <algorithm>
#include <system_error>
#include <utility>

#include "format/bytes.h"
#include "kernels/frame_parts.h"
#include "runtime/visible_chunks.h"

namespace scree::runtime {

using kernels::cuda_check;

namespace {

uint64_t room_of(uint64_t bytes) {
  return format::align_up(bytes, Residency::kAlignment);
}

/// `use(first, bytes)` for every run that lies side by side both where it comes from and where it goes to.
template <class Piece, class Use>
Result<void> each_run(std::span<const Piece> pieces, const Use& use) {
  for (size_t first = 0; first < pieces.size();) {
    uint64_t bytes = pieces[first].bytes;
    size_t next = first + 1;
    for (; next < pieces.size(); ++next) {
      const uint64_t step = room_of(bytes);
      if (pieces[next].from != pieces[first].from + step || pieces[next].to != pieces[first].to + step) break;
      bytes = step + pieces[next].bytes;
    }
    if (Result<void> done = use(pieces[first], bytes); !done) return done;
    first = next;
  }
  return {};
}

}  // namespace

CudaStream::CudaStream(const Scene& scene, Streamer streamer, uint64_t bounce_bytes, uint32_t threads)
    : source_(scene), streamer_(std::move(streamer)), threads_(threads), bounce_bytes_(bounce_bytes) {}

uint64_t CudaStream::bounce_bytes(uint64_t largest_chunk, uint64_t room) {
  constexpr uint64_t kEnough = uint64_t{32} << 20;
  return std::max(room_of(largest_chunk), std::min(room / 32, kEnough));
}

CudaStream::~CudaStream() {
  stop_loading();
  for (cudaEvent_t event : loaded_)
    if (event != nullptr) (void)cudaEventDestroy(event);
  if (copies_ != nullptr) (void)cudaStreamDestroy(copies_);
}

Result<void> CudaStream::open(const kernels::SceneView& device, kernels::CudaFrames& frames,
                              kernels::CudaResolver& resolver, uint64_t host_bytes) {
  scene_ = device;
  frames_ = &frames;
  resolver_ = &resolver;
  const Residency& residency = streamer_.residency();
  Result<void> done = cuda_check(cudaGetDevice(&device_), "asking for the current GPU");
  // Passes may read a few bytes past a chunk.
  if (done) done = pool_.reserve(residency.pool_bytes() + Residency::kAlignment, "allocating the pool of chunks");
  if (done) done = bounce_.reserve(bounce_bytes_, "allocating room to move chunks");
  if (done) done = visible_.open(streamer_.view(), scene_);
  const uint64_t table_bytes = scene_.chunk_count * sizeof(std::byte*);
  if (done) done = pages_.allocate(table_bytes, "allocating pinned memory");
  if (done) std::fill_n(pages_.data(), table_bytes, std::byte{0});
  // Not ordered with the streams that draw: the host waits for a load before it has it drawn.
  if (done) done = cuda_check(cudaStreamCreateWithFlags(&copies_, cudaStreamNonBlocking), "making a stream");
  for (cudaEvent_t& event : loaded_)
    if (done)
      done = cuda_check(cudaEventCreateWithFlags(&event, cudaEventDisableTiming | cudaEventBlockingSync),
                        "making an event");
  if (done) done = keep_in_host_memory(host_bytes);
  const bool all_kept = std::find(kept_at_.begin(), kept_at_.end(), kNotPinned) == kept_at_.end();
  for (kernels::PinnedBuffer& staging : staging_)
    if (done && !all_kept) done = staging.allocate(streamer_.most_batch_bytes(), "allocating pinned memory");
  return done;
}

Result<void> CudaStream::keep_in_host_memory(uint64_t host_bytes) {
  const Residency& residency = streamer_.residency();
  kept_at_.assign(scene_.chunk_count, kNotPinned);
  std::vector<Residency::Place> places;
  uint64_t end = 0;
  for (uint64_t c = 0; c < scene_.chunk_count; ++c) {
    const auto chunk = static_cast<uint32_t>(c);
    const uint64_t bytes = residency.chunk_bytes(chunk);
    if (end + room_of(bytes) > host_bytes) break;
    kept_at_[c] = end;
    if (bytes != 0) places.push_back({chunk, end, bytes});
    end += room_of(bytes);
  }
  if (places.empty()) return {};
  if (Result<void> done = kept_.allocate(end, "allocating pinned memory for chunks"); !done) return done;
  return source_.read(places, kept_.data(), threads_);
}

Result<StreamStats> CudaStream::draw_frame(const kernels::View& view, const kernels::ShadeOptions* shade,
                                           uint64_t* samples) {
  samples_ = samples;
  return streamer_.draw(view, shade, *this);
}

Result<void> CudaStream::begin(const kernels::View& view, const kernels::ShadeOptions* shade) {
  const uint64_t count = uint64_t{view.width} * view.height;
  view_ = view;
  shades_ = shade != nullptr && kernels::shades_from_chunks(shade->show);
  if (shades_) shade_ = *shade;
  // What the last frame moved in the end.
  Result<void> done = cuda_check(cudaStreamSynchronize(copies_), "moving chunks");
  if (done && shades_) done = colors_.reserve(3 * count * sizeof(float), "allocating the samples' colours");
  static_assert(kernels::kBackground == ~uint64_t{0});
  if (done) done = cuda_check(cudaMemsetAsync(samples_, 0xff, count * sizeof(uint64_t), nullptr), "clearing");
  return done;
}

Result<void> CudaStream::move(std::span<const Residency::Move> moves) {
  return each_run(moves,
                  [&](const Residency::Move& first, uint64_t bytes) { return move_run(first.from, first.to, bytes); });
}

/// To a smaller offset. Copies do not overlap themselves: they go piece by piece, as far as the way is long, or through
/// memory apart where that is longer.
Result<void> CudaStream::move_run(uint64_t from, uint64_t to, uint64_t bytes) {
  const auto copy = [&](std::byte* target, const std::byte* source, uint64_t count) {
    return cuda_check(cudaMemcpyAsync(target, source, count, cudaMemcpyDeviceToDevice, copies_), "moving chunks");
  };
  const bool bounces = from - to < bytes && from - to < bounce_bytes_;
  const uint64_t piece = bounces ? bounce_bytes_ : from - to;
  for (uint64_t done = 0; done < bytes; done += piece) {
    const uint64_t count = std::min(piece, bytes - done);
    const std::byte* source = pool_.data() + from + done;
    if (bounces) {
      if (Result<void> copied = copy(bounce_.data(), source, count); !copied) return copied;
      source = bounce_.data();
    }
    if (Result<void> copied = copy(pool_.data() + to + done, source, count); !copied) return copied;
  }
  return {};
}

Result<void> CudaStream::start_loading(std::span<const Residency::Place> places) {
  std::vector<Residency::Place> own(places.begin(), places.end());
  // Neighbours in the pool go as one copy where they lie side by side in host memory too.
  std::sort(own.begin(), own.end(),
            [](const Residency::Place& a, const Residency::Place& b) { return a.offset < b.offset; });
  const uint32_t number = loads_++ % kLoadsAhead;
  try {
    std::future<Result<void>> issued = std::async(
        std::launch::async, [this, number, own = std::move(own)]() mutable { return load(std::move(own), number); });
    loading_.push_back({std::move(issued), number});
    return {};
  } catch (const std::system_error&) {
    return Error{ErrorCode::kMemory, "no thread left to load chunks"};
  }
}

/// The places are sorted by offset. On a thread of its own; the loads before have other staging memory.
Result<void> CudaStream::load(std::vector<Residency::Place> places, uint32_t number) {
  // The current device is each thread's own.
  if (auto done = cuda_check(cudaSetDevice(device_), "choosing the GPU"); !done) return done;
  std::byte* const staging = staging_[number].data();
  uint64_t staged_end = 0;
  for (size_t next = 0; next < places.size();) {
    const uint64_t piece = staged_end;
    std::vector<Residency::Place> missing;
    std::vector<Copy> copies;
    for (; next < places.size() && (copies.empty() || staged_end - piece < kPieceBytes); ++next) {
      const Residency::Place& place = places[next];
      const bool kept = kept_at_[place.chunk] != kNotPinned;
      copies.push_back({kept ? kept_.data() + kept_at_[place.chunk] : staging + staged_end, place.offset, place.bytes});
      if (kept) continue;
      missing.push_back({place.chunk, staged_end, place.bytes});
      staged_end += room_of(place.bytes);
    }
    if (Result<void> read = source_.read(missing, staging, threads_); !read) return read;
    if (Result<void> copied = copy_runs(copies); !copied) return copied;
  }
  return cuda_check(cudaEventRecord(loaded_[number], copies_), "recording a load");
}

Result<void> CudaStream::copy_runs(std::span<const Copy> copies) {
  return each_run(copies, [&](const Copy& first, uint64_t bytes) -> Result<void> {
    if (bytes == 0) return {};
    return cuda_check(cudaMemcpyAsync(pool_.data() + first.to, first.from, bytes, cudaMemcpyHostToDevice, copies_),
                      "copying chunks to the device");
  });
}

Result<void> CudaStream::finish_loading() {
  Load load = std::move(loading_.front());
  loading_.pop_front();
  if (Result<void> issued = load.issued.get(); !issued) return issued;
  return cuda_check(cudaEventSynchronize(loaded_[load.number]), "loading chunks");
}

void CudaStream::stop_loading() {
  loading_.clear();  // waits for the threads
  if (copies_ != nullptr) (void)cudaStreamSynchronize(copies_);
}

Result<kernels::FrameStats> CudaStream::draw(std::span<const Residency::Place> places) {
  auto* const table = reinterpret_cast<const std::byte**>(pages_.data());
  const uint64_t table_bytes = scene_.chunk_count * sizeof(std::byte*);
  for (const Residency::Place& place : places) table[place.chunk] = pool_.data() + place.offset;
  Result<void> done = cuda_check(
      cudaMemcpyAsync(const_cast<std::byte**>(scene_.pages), table, table_bytes, cudaMemcpyHostToDevice, nullptr),
      "listing the chunks of a batch");
  kernels::FrameStats stats{};
  if (done) {
    kernels::DrawOptions options;
    options.is_part = true;
    const Result<kernels::FrameStats> drawn = frames_->draw(view_, samples_, options);
    if (!drawn) {
      done = drawn.error();
    } else {
      stats = *drawn;
    }
  }
  if (done && shades_)
    done = resolver_->shade_part(scene_, view_, samples_, frames_->transforms(), shade_,
                                 reinterpret_cast<float*>(colors_.data()), nullptr);
  // Also before the table may change.
  if (done) done = cuda_check(cudaStreamSynchronize(nullptr), "drawing a batch");
  for (const Residency::Place& place : places) table[place.chunk] = nullptr;
  if (!done) return done.error();
  return stats;
}

Result<std::span<const uint32_t>> CudaStream::list() {
  const Result<std::span<const uint32_t>> nearest = visible_.find_nearest(view_);
  if (!nearest) return nearest.error();
  near_to_far_ = order_by_depth(*nearest);
  return std::span<const uint32_t>(near_to_far_);
}

Result<void> CudaStream::find_depths() {
  const Result<std::span<const uint8_t>> shown = visible_.find_shown(samples_);
  if (!shown) return shown.error();
  shown_ = *shown;
  return {};
}

}  // namespace scree::runtime
