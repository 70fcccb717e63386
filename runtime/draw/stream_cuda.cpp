#include "runtime/draw/stream_cuda.h"

#include <algorithm>
#include <chrono>
#include <new>
#include <utility>

#include "format/bytes.h"
#include "kernels/frame_parts.h"
#include "runtime/stream/visible_chunks.h"

namespace scree::runtime {

using kernels::cuda_check;

namespace {

uint64_t room_of(uint64_t bytes) {
  return format::align_up(bytes, Residency::kAlignment);
}

/// Calls `use(first, bytes)` for every run of pieces that are neighbours both at their source and at their target.
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
    SCREE_TRY(use(pieces[first], bytes));
    first = next;
  }
  return {};
}

}  // namespace

CudaStream::CudaStream(const Scene& scene, Streamer streamer, uint64_t bounce_bytes, const PageJoins::Sizes& joins,
                       uint32_t threads)
    : source_(scene),
      streamer_(std::move(streamer)),
      workers_(threads),
      bounce_bytes_(bounce_bytes),
      join_sizes_(joins) {}

uint64_t CudaStream::bounce_bytes(uint64_t largest_chunk, uint64_t room) {
  constexpr uint64_t kEnough = uint64_t{32} << 20;
  constexpr uint64_t kUnit = Residency::kAlignment;
  return std::max(room_of(largest_chunk), std::min(room / 32, kEnough) / kUnit * kUnit);
}

uint64_t CudaStream::kept_bytes(std::span<const uint64_t> chunk_bytes) {
  uint64_t all = 0;
  for (const uint64_t bytes : chunk_bytes) all += room_of(bytes);
  return all;
}

CudaStream::~CudaStream() {
  stop();
}

Result<void> CudaStream::open(const kernels::SceneView& device, kernels::CudaFrames& frames,
                              kernels::CudaFrames* blend_frames, kernels::CudaResolver& resolver,
                              kernels::CudaTextureCache* cache, DeviceBlockPager* pager, const SharedRoom& room,
                              uint64_t host_bytes) {
  scene_ = device;
  frames_ = &frames;
  blend_frames_ = blend_frames;
  blended_scene_ = kernels::blended_view(device);
  resolver_ = &resolver;
  cache_ = cache;
  pager_ = pager;
  room_ = room;
  const Residency& residency = streamer_.residency();
  SCREE_TRY(cuda_check(cudaGetDevice(&device_), "asking for the current GPU"));
  room_.bytes = residency.pool_bytes() + room_.room;
  // Passes may read a few bytes past a chunk.
  SCREE_TRY(pool_.reserve(room_.bytes + Residency::kAlignment, "allocating the pool of chunks"));
  if (pager_ != nullptr) SCREE_TRY(pager_->use_room(room_end(), room_.room));
  SCREE_TRY(bounce_.reserve(bounce_bytes_, "allocating room to move chunks"));
  SCREE_TRY(visible_.open(streamer_.view(), scene_));
  SCREE_TRY(pages_.open(scene_, scene_.chunk_count));
  // Not ordered with the streams that draw, because the host waits for a load before it submits its drawing.
  for (kernels::DeviceStream* const stream : {&copies_, &moves_}) SCREE_TRY(stream->make(cudaStreamNonBlocking));
  for (Events& events : events_)
    for (kernels::DeviceEvent* const event : {&events.moved, &events.begun, &events.loaded}) SCREE_TRY(event->make());
  for (kernels::DeviceEvent& event : staged_) SCREE_TRY(event.make());
  for (kernels::DeviceEvent* const event : {&drawing_begun_, &drawing_ended_}) SCREE_TRY(event->make());
  SCREE_TRY(keep_in_host_memory(host_bytes));
  if (join_sizes_.any()) SCREE_TRY(joins_.emplace().open(join_sizes_, device_, pool_.data()));
  if (needs_staging()) SCREE_TRY(open_staging());
  return draw_nothing();
}

/// Whether the GPU joins a chunk.
bool CudaStream::is_joined(uint32_t chunk) const {
  return joins_ && kept_at_[chunk] == kNotPinned && source_.can_send(chunk);
}

/// Whether chunks are copied through pinned batches.
bool CudaStream::needs_staging() const {
  for (uint64_t c = 0; c < kept_at_.size(); ++c) {
    const auto chunk = static_cast<uint32_t>(c);
    if (kept_at_[c] == kNotPinned && streamer_.residency().chunk_bytes(chunk) != 0 && !is_joined(chunk)) return true;
  }
  return false;
}

Result<void> CudaStream::open_staging() {
  for (kernels::PinnedBuffer& staging : staging_)
    if (staging.data() == nullptr)
      SCREE_TRY(staging.allocate_for_copies(streamer_.most_batch_bytes(), "allocating pinned memory"));
  return {};
}

/// Draws a frame of one sample without chunks. When a kernel first runs, CUDA loads its code and makes room for its
/// stacks. That takes 10 ms for a frame's kernels, and is done here.
Result<void> CudaStream::draw_nothing() {
  const kernels::View view{.eye = {0, 0, 0},
                           .right = {1, 0, 0},
                           .up = {0, 1, 0},
                           .forward = {0, 0, -1},
                           .half_width = 1,
                           .half_height = 1,
                           .z_near = 1,
                           .z_far = 2,
                           .width = 1,
                           .height = 1};
  kernels::DeviceBuffer sample = SCREE_TRY(kernels::DeviceBuffer::allocate(sizeof(uint64_t), "allocating a sample"));
  samples_ = reinterpret_cast<uint64_t*>(sample.data());
  const kernels::ShadeOptions shade;
  SCREE_TRY(begin(view, &shade));
  SCREE_TRY(list());
  SCREE_TRY(start_drawing({}, {Share::kAll, true}));
  SCREE_TRY(finish_drawing());
  shades_ = false;
  samples_ = nullptr;
  return {};
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
  SCREE_TRY(kept_.allocate_for_copies(end, "allocating pinned memory for chunks"));
  const auto read_all = [&] { return source_.read(places, kept_.data(), ChunkSource::Reader::kDevice, workers_); };
  // The pool is empty yet. A part of it serves to join split pages, whose chunks are then copied back. The pinned
  // memory of later joins is free too.
  const uint64_t pool = residency.pool_bytes() / Residency::kAlignment * Residency::kAlignment;
  const PageJoins::Sizes sizes =
      PageJoins::sizes_for(source_, static_cast<uint32_t>(workers_.count()), pool / 2,
                           std::min(host_bytes - end + join_sizes_.pinned_bytes(), PageJoins::kMostPinned));
  if (!sizes.any()) return read_all();
  const uint64_t room = pool - sizes.device_bytes();
  PageJoins joins;
  SCREE_TRY(joins.open(sizes, device_, pool_.data(), pool_.data() + room));
  for (size_t first = 0; first < places.size();) {
    size_t last = first;
    uint64_t bytes = 0;
    for (; last < places.size() && bytes + room_of(places[last].bytes) <= std::min(room, kPieceBytes); ++last)
      bytes += room_of(places[last].bytes);
    last = std::max(last, first + 1);  // a chunk that is not joined may be larger
    // After an error all pages are read here, so that the message is that of the first bad page.
    if (auto done = keep(std::span(places).subspan(first, last - first), joins); !done)
      return done.error().code == ErrorCode::kDevice ? done : read_all();
    first = last;
  }
  return {};
}

/// Keeps chunks in host memory. Chunks of split pages are joined in the pool, which must be empty.
Result<void> CudaStream::keep(std::span<const Residency::Place> places, PageJoins& joins) {
  const auto read = [&](std::span<const Residency::Place> wanted) {
    return source_.read(wanted, kept_.data(), ChunkSource::Reader::kDevice, workers_);
  };
  std::vector<Residency::Place> others;
  std::vector<Residency::Place> joined;  // in the pool
  std::vector<Piece> pieces;             // from the pool to kept_
  uint64_t end = 0;
  for (const Residency::Place& place : places) {
    if (!source_.can_send(place.chunk)) {
      others.push_back(place);
      continue;
    }
    joined.push_back({place.chunk, end, place.bytes});
    pieces.push_back({pool_.data() + end, place.offset, place.bytes});
    end += room_of(place.bytes);
  }
  SCREE_TRY(read(others));
  if (joined.empty()) return {};
  Result<void> done = joins.begin(0, nullptr, nullptr);
  if (done) done = source_.send(joined, joins, workers_);
  const Result<void> ended = joins.end(copies_);
  if (done) done = ended;
  if (done)
    done = each_run(std::span<const Piece>(pieces), [&](const Piece& run, uint64_t bytes) {
      return cuda_check(cudaMemcpyAsync(kept_.data() + run.to, run.from, bytes, cudaMemcpyDeviceToHost, copies_),
                        "copying chunks from the device");
    });
  const Result<void> waited = cuda_check(cudaStreamSynchronize(copies_), "loading chunks");
  if (done) done = waited;
  if (!done || joins.has_joined(0)) return done;
  source_.refuse(joined);
  return read(places);
}

Result<StreamStats> CudaStream::draw_frame(const kernels::View& view, const kernels::ShadeOptions* shade,
                                           uint64_t* samples, const IsOver& is_over) {
  samples_ = samples;
  if (pager_ == nullptr) return draw_all(view, shade, is_over);
  SCREE_TRY(divide_memory());
  for (;;) {
    const uint64_t read = pager_->stats().read_pages;
    first_round_ = pager_->pages().round + 1;
    Result<StreamStats> stats = draw_all(view, shade, is_over);
    if (stats) {
      lacked_ = stats->streamed_bytes + stats->left_bytes != 0 || pager_->stats().read_pages != read;
      last_ = *stats;
      return stats;
    }
    // If the pages of a single pixel exceed their room, chunks are dropped for them.
    const uint64_t needed = pager_->refused_bytes();
    const uint64_t room = room_.within(format::align_up(needed, DeviceBlockPager::kUnit), DeviceBlockPager::kUnit);
    if (stats.error().code != ErrorCode::kMemory || needed <= room_.room || room < needed) return stats;
    SCREE_TRY(set_room(room));
  }
}

Result<StreamStats> CudaStream::draw_all(const kernels::View& view, const kernels::ShadeOptions* shade,
                                         const IsOver& is_over) {
  over_ = nullptr;
  blended_ = {};
  const uint64_t joined_before = joined_bytes_;
  StreamStats stats = SCREE_TRY(streamer_.draw(view, shade, *this, is_over));
  if (shade != nullptr && kernels::shows_layers(scene_, *shade)) SCREE_TRY(draw_layers(stats, is_over));
  stats.joined_bytes = joined_bytes_ - joined_before;
  return stats;
}

/// Divides the memory of chunks and pages by the bytes that the last frame showed, if it lacked any.
Result<void> CudaStream::divide_memory() {
  if (!std::exchange(lacked_, false)) return {};
  const uint64_t pages = SCREE_TRY(pager_->wanted_bytes(first_round_));
  const uint64_t chunks = last_.seen_bytes - std::min(last_.seen_bytes, last_.hidden_bytes);
  const uint64_t room = room_.balanced(chunks, pages, DeviceBlockPager::kUnit);
  return room == room_.room ? Result<void>() : set_room(room);
}

/// Gives pages of textures `bytes` of the shared memory, and chunks the rest, between two frames.
Result<void> CudaStream::set_room(uint64_t bytes) try {
  SCREE_TRY(cuda_check(cudaDeviceSynchronize(), "waiting for the last frame"));
  streamer_.resize_pool(room_.bytes - bytes);
  room_.room = bytes;
  return pager_->use_room(room_end(), bytes);
} catch (const std::bad_alloc&) {
  return Error{ErrorCode::kMemory, "no memory left to divide the GPU's memory"};
}

Result<uint64_t> CudaStream::load_rest(const IsOver& is_over) {
  const Streamer::Rest rest = SCREE_TRY(streamer_.load_rest(*this, is_over));
  if (rest.left_bytes != 0) return rest.left_bytes;
  list_pages(rest.present);
  SCREE_TRY(pages_.set(entries_));
  SCREE_TRY(cuda_check(cudaStreamSynchronize(nullptr), "listing all chunks"));
  joins_.reset();
  is_complete_ = true;
  return rest.left_bytes;
}

/// Draws the layers of blended surfaces. Each layer is streamed like the picture, and shaded part by part.
Result<void> CudaStream::draw_layers(StreamStats& stats, const IsOver& is_over) {
  const kernels::LayerSource source{[&](const kernels::BlendTargets& at, const uint64_t* peeled) -> Result<void> {
                                      layer_ = Layer{&at, peeled};
                                      const Result<StreamStats> drawn = streamer_.draw(view_, &shade_, *this, is_over);
                                      layer_.reset();
                                      if (!drawn) return drawn.error();
                                      stats.add_layer(*drawn);
                                      return {};
                                    },
                                    [](const kernels::BlendTargets&) { return Result<void>(); }};
  over_ = SCREE_TRY(blend_.blend(view_, samples_, shade_.blend_layers, source, blended_));
  return {};
}

Result<void> CudaStream::begin(const kernels::View& view, const kernels::ShadeOptions* shade) {
  if (layer_) return {};
  const uint64_t count = uint64_t{view.width} * view.height;
  view_ = view;
  shades_ = shade != nullptr && kernels::shades_from_chunks(shade->show);
  if (shades_) shade_ = *shade;
  if (shades_) SCREE_TRY(colors_.reserve(3 * count * sizeof(float), "allocating the samples' colours"));
  static_assert(kernels::kBackground == ~uint64_t{0});
  return cuda_check(cudaMemsetAsync(samples_, 0xff, count * sizeof(uint64_t), nullptr), "clearing");
}

/// Moves chunks within the pool. Source and target may overlap, and so may different moves. So as many bytes as fit are
/// copied to the bounce buffer, and from there to their places. Later moves lie behind all of these.
Result<void> CudaStream::move(std::span<const Residency::Move> moves) {
  std::vector<kernels::DeviceCopy> there;
  std::vector<kernels::DeviceCopy> back;
  uint64_t bounced = 0;
  const auto bounce = [&]() -> Result<void> {
    SCREE_TRY(kernels::copy_on_device(there, moves_, "moving chunks"));
    SCREE_TRY(kernels::copy_on_device(back, moves_, "moving chunks"));
    there.clear();
    back.clear();
    bounced = 0;
    return {};
  };
  const auto add = [&](const Residency::Move& run, uint64_t bytes) -> Result<void> {
    for (uint64_t moved = 0; moved < bytes;) {
      const uint64_t count = std::min(bounce_bytes_ - bounced, bytes - moved);
      there.push_back({pool_.data() + run.from + moved, bounce_.data() + bounced, count});
      back.push_back({bounce_.data() + bounced, pool_.data() + run.to + moved, count});
      moved += count;
      bounced += room_of(count);
      if (bounced < bounce_bytes_) continue;
      SCREE_TRY(bounce());
    }
    return {};
  };
  SCREE_TRY(each_run(moves, add));
  return bounce();
}

/// Queues the copies, in any order: none may write memory that another reads or writes.
Result<void> CudaStream::copy(Copies& copies) {
  const char* const what = "copying chunks to the device";
  if (copies.bytes.empty()) return {};
#if CUDART_VERSION >= 13000
  // One call for all copies, without an order among them.
  cudaMemcpyAttributes attributes{};
  attributes.srcAccessOrder = cudaMemcpySrcAccessOrderStream;
  attributes.flags = cudaMemcpyFlagPreferOverlapWithCompute;
  size_t first = 0;  // the first copy with these attributes
  return cuda_check(cudaMemcpyBatchAsync(copies.to.data(), copies.from.data(), copies.bytes.data(), copies.to.size(),
                                         &attributes, &first, 1, copies_),
                    what);
#else
  for (size_t i = 0; i < copies.to.size(); ++i)
    SCREE_TRY(
        cuda_check(cudaMemcpyAsync(copies.to[i], copies.from[i], copies.bytes[i], cudaMemcpyDefault, copies_), what));
  return {};
#endif
}

Result<void> CudaStream::start_loading(const Residency::Batch& batch) {
  const uint32_t number = loads_++ % kMostLoads;
  loading_.push_back({loader_.add([this, batch, number] { return load(batch, number); }), number, batch.loads});
  return {};
}

/// Queues the moves, copies and joins of a load. Runs on the loader's thread.
Result<void> CudaStream::load(const Residency::Batch& batch, uint32_t number) {
  const Events& events = events_[number];
  // The current device is each thread's own.
  SCREE_TRY(cuda_check(cudaSetDevice(device_), "choosing the GPU"));
  // Moves run while the previous load is copied. They do not touch its places. A batch without moves waits too, because
  // its places may be those that the moves of an earlier batch without loads read or write.
  if (!batch.moves.empty()) SCREE_TRY(move(batch.moves));
  SCREE_TRY(cuda_check(cudaEventRecord(events.moved, moves_), "recording a load"));
  SCREE_TRY(cuda_check(cudaStreamWaitEvent(copies_, events.moved), "recording a load"));
  std::vector<Residency::Place> copied = batch.loads;
  const auto first_joined = std::stable_partition(
      copied.begin(), copied.end(), [&](const Residency::Place& place) { return !is_joined(place.chunk); });
  const std::vector<Residency::Place> joined(first_joined, copied.end());
  copied.erase(first_joined, copied.end());
  Result<void> done;
  joined_[number] = 0;
  if (!joined.empty()) {
    for (const Residency::Place& place : joined) joined_[number] += place.bytes;
    done = joins_->begin(number, events.moved, events.begun);
    if (done) done = source_.send(joined, *joins_, workers_);
    const Result<void> ended = joins_->end(copies_);
    if (done || !ended) done = ended;
  }
  if (done) done = copy_in(copied, events, !joined.empty());
  if (!done && done.error().code != ErrorCode::kDevice && !joined.empty()) {
    // An earlier page may be bad too, which only the GPU would find. So all pages are checked here.
    joined_[number] = 0;
    done = copy_in(batch.loads, events, true);
  }
  SCREE_TRY(done);
  return cuda_check(cudaEventRecord(events.loaded, copies_), "recording a load");
}

/// Loads chunks that the GPU could not join. Runs on the loader's thread.
Result<void> CudaStream::copy_refused(std::span<const Residency::Place> places, uint32_t number) {
  SCREE_TRY(cuda_check(cudaSetDevice(device_), "choosing the GPU"));
  source_.refuse(places);
  SCREE_TRY(copy_in(places, events_[number], true));
  return cuda_check(cudaEventRecord(events_[number].loaded, copies_), "recording a load");
}

/// Queues the copies of chunks. `has_begun`: the load's beginning is recorded.
Result<void> CudaStream::copy_in(std::span<const Residency::Place> from_file, const Events& events, bool has_begun) {
  // Neighbours in the pool become one copy if they are neighbours in host memory too.
  std::vector<Residency::Place> places(from_file.begin(), from_file.end());
  std::sort(places.begin(), places.end(),
            [](const Residency::Place& a, const Residency::Place& b) { return a.offset < b.offset; });
  const bool is_kept = std::all_of(places.begin(), places.end(),
                                   [&](const Residency::Place& place) { return kept_at_[place.chunk] != kNotPinned; });
  const uint32_t number = stagings_ % kStagings;
  if (!is_kept) {
    ++stagings_;
    SCREE_TRY(open_staging());
    SCREE_TRY(cuda_check(cudaEventSynchronize(staged_[number]), "loading chunks"));
  }
  std::byte* const staging = staging_[number].data();
  uint64_t staged_end = 0;
  std::vector<Residency::Place> missing;
  std::vector<Piece> pieces;
  Copies copies;
  for (size_t next = 0; next < places.size();) {
    const uint64_t staged_before = staged_end;
    missing.clear();
    pieces.clear();
    copies.clear();
    for (; next < places.size() && (pieces.empty() || staged_end - staged_before < kPieceBytes); ++next) {
      const Residency::Place& place = places[next];
      const bool kept = kept_at_[place.chunk] != kNotPinned;
      pieces.push_back({kept ? kept_.data() + kept_at_[place.chunk] : staging + staged_end, place.offset, place.bytes});
      if (kept) continue;
      missing.push_back({place.chunk, staged_end, place.bytes});
      staged_end += room_of(place.bytes);
    }
    if (!missing.empty()) SCREE_TRY(source_.read(missing, staging, ChunkSource::Reader::kDevice, workers_));
    if (!std::exchange(has_begun, true))
      SCREE_TRY(cuda_check(cudaEventRecord(events.begun, copies_), "recording a load"));
    SCREE_TRY(each_run(std::span<const Piece>(pieces), [&](const Piece& run, uint64_t bytes) -> Result<void> {
      if (bytes != 0) copies.add(pool_.data() + run.to, run.from, bytes);
      return {};
    }));
    SCREE_TRY(copy(copies));
  }
  if (!has_begun) SCREE_TRY(cuda_check(cudaEventRecord(events.begun, copies_), "recording a load"));
  return is_kept ? Result<void>() : cuda_check(cudaEventRecord(staged_[number], copies_), "recording a load");
}

Result<bool> CudaStream::is_loaded() {
  const Load& oldest = loading_.front();
  if (oldest.issued.wait_for(std::chrono::seconds(0)) != std::future_status::ready) return false;
  const cudaError_t status = cudaEventQuery(events_[oldest.number].loaded);
  const Result<void> done = cuda_check(status, "loading chunks");
  if (!done && status != cudaErrorNotReady) return done.error();
  return status == cudaSuccess;
}

Result<double> CudaStream::finish_loading() {
  Load oldest = std::move(loading_.front());
  loading_.pop_front();
  SCREE_TRY(oldest.issued.get());
  const Events& events = events_[oldest.number];
  float ms = 0;
  SCREE_TRY(cuda_check(cudaEventSynchronize(events.loaded), "loading chunks"));
  if (joined_[oldest.number] != 0) {
    if (joins_->has_joined(oldest.number)) {
      joined_bytes_ += joined_[oldest.number];
    } else {
      SCREE_TRY(loader_.add([&] { return copy_refused(oldest.places, oldest.number); }).get());
      SCREE_TRY(cuda_check(cudaEventSynchronize(events.loaded), "loading chunks"));
    }
  }
  SCREE_TRY(cuda_check(cudaEventElapsedTime(&ms, events.begun, events.loaded), "reading a time"));
  return ms;
}

void CudaStream::list_pages(std::span<const Residency::Place> places) {
  entries_.clear();
  for (const Residency::Place& place : places) entries_.push_back({place.chunk, pool_.data() + place.offset});
}

Result<void> CudaStream::start_drawing(std::span<const Residency::Place> places, PartOptions part) {
  part_ = part;
  list_pages(places);
  SCREE_TRY(cuda_check(cudaEventRecord(drawing_begun_, nullptr), "recording a time"));
  SCREE_TRY(pages_.set(entries_));
  kernels::DrawOptions options;
  options.part = part.share == Share::kAll          ? kernels::FramePart::kPart
                 : part.share == Share::kLikelySeen ? kernels::FramePart::kPreviouslyVisible
                                                    : kernels::FramePart::kRest;
  options.peeled = layer_ ? layer_->peeled : nullptr;
  SCREE_TRY(frames().start(view_, layer_ ? layer_->at->drawn : samples_, options));
  return use_drawn();
}

/// Queues the work after drawing a part, while its pages are present: shading it, and finding hidden chunks.
Result<void> CudaStream::use_drawn() {
  const uint64_t* const drawn = layer_ ? layer_->at->drawn : samples_;
  if (shades_ && part_.share != Share::kLikelySeen) {
    const kernels::SceneView& scene = layer_ ? blended_scene_ : scene_;
    const kernels::Transform* const transforms = frames().transforms();
    float* const colors = layer_ ? layer_->at->colors : reinterpret_cast<float*>(colors_.data());
    SCREE_TRY(resolver_->shade_part(scene, view_, drawn, transforms, shade_, colors, nullptr, cache_));
    if (layer_) SCREE_TRY(kernels::start_finding_alphas(scene, view_, drawn, transforms, layer_->at->alphas, nullptr));
  }
  if (part_.finds_depths) SCREE_TRY(visible_.start_finding_shown(drawn));
  return cuda_check(cudaEventRecord(drawing_ended_, nullptr), "recording a time");
}

Result<StreamTarget::Drawn> CudaStream::finish_drawing() {
  const kernels::CudaFrames::Finished drawn = SCREE_TRY(frames().finish());
  if (drawn.is_drawn_again) SCREE_TRY(use_drawn());
  float ms = 0;
  SCREE_TRY(cuda_check(cudaEventSynchronize(drawing_ended_), "drawing a batch"));
  SCREE_TRY(cuda_check(cudaEventElapsedTime(&ms, drawing_begun_, drawing_ended_), "reading a time"));
  // Copied, because the next part's result may arrive while this one is read.
  if (part_.finds_depths) shown_.assign(visible_.shown().begin(), visible_.shown().end());
  return Drawn{drawn.stats, ms};
}

void CudaStream::stop() {
  loading_.clear();
  loader_.wait();
  // Waits for all streams, because there may be no event behind the drawing of a part.
  (void)cudaDeviceSynchronize();
}

Result<std::span<const uint32_t>> CudaStream::list() {
  const std::span<const uint32_t> nearest = SCREE_TRY(visible_.find_nearest(view_, layer_.has_value()));
  shown_.assign(nearest.begin(), nearest.end());
  near_to_far_ = order_by_depth(shown_);
  return std::span<const uint32_t>(near_to_far_);
}

}  // namespace scree::runtime
