#include "runtime/stream/streamer.h"

#include <algorithm>
#include <deque>
#include <new>
#include <string>
#include <utility>

#include "runtime/threads/stopwatch.h"

namespace scree::runtime {
namespace {

uint64_t wanted_batch_bytes(const Residency& residency, uint64_t most) {
  return std::min({residency.pool_bytes() / kBatchShare, kMostBatchBytes, most});
}

/// Adds the time until its destruction to `ms`.
class Timed {
 public:
  explicit Timed(double& ms) : ms_(ms) {}
  Timed(const Timed&) = delete;
  Timed& operator=(const Timed&) = delete;
  ~Timed() { ms_ += watch_.elapsed().wall_ms; }

 private:
  double& ms_;
  Stopwatch watch_;
};

Error no_memory(const std::string& what) {
  return {ErrorCode::kMemory, "no memory left " + what};
}

}  // namespace

void StreamStats::add_layer(const StreamStats& layer) {
  missing_bytes += layer.missing_bytes;
  hidden_bytes += layer.hidden_bytes;
  streamed_bytes += layer.streamed_bytes;
  left_bytes += layer.left_bytes;
  needed_bytes += layer.needed_bytes;
  moved_bytes += layer.moved_bytes;
  batches += layer.batches;
  parts += layer.parts;
  list_ms += layer.list_ms;
  choose_ms += layer.choose_ms;
  draw_ms += layer.draw_ms;
  load_ms += layer.load_ms;
  drawing_ms += layer.drawing_ms;
  copying_ms += layer.copying_ms;
}

Streamer::Streamer(const Scene& scene, Residency residency, uint64_t batch_bytes)
    : residency_(std::move(residency)), most_batch_bytes_(batch_bytes), batch_bytes_(batch_bytes), view_(scene.view()) {
  chunks_.assign(view_.chunks, view_.chunks + view_.chunk_count);
  for (uint64_t c = 0; c < view_.chunk_count; ++c) {
    chunks_[c].page = static_cast<uint32_t>(c);
    chunks_[c].offset = 0;
  }
  last_seen_.assign(view_.chunk_count, LastSeen::kUnknown);
  view_.chunks = chunks_.data();
  view_.pages = nullptr;
}

Result<Streamer> Streamer::create(const Scene& scene, uint64_t pool_bytes, std::vector<uint64_t> chunk_bytes,
                                  uint64_t most_batch_bytes) try {
  Residency residency = SCREE_TRY_AT(scene.file().path(), Residency::create(pool_bytes, std::move(chunk_bytes)));
  const uint64_t batch_bytes = wanted_batch_bytes(residency, most_batch_bytes);
  return Result<Streamer>(Streamer(scene, std::move(residency), batch_bytes));
} catch (const std::bad_alloc&) {
  return at(scene.file().path(), no_memory("to list its chunks"));
}

uint64_t Streamer::most_batch_bytes() const {
  return std::max(most_batch_bytes_, residency_.largest_room());
}

void Streamer::resize_pool(uint64_t pool_bytes) {
  residency_.resize(pool_bytes);
  batch_bytes_ = wanted_batch_bytes(residency_, most_batch_bytes_);
}

/// One frame, drawn in parts: the chunks in the pool at its beginning, and each batch.
class Streamer::Frame {
 public:
  Frame(Residency& residency, uint64_t batch_bytes, std::span<LastSeen> last_seen, StreamTarget& target,
        const IsOver& is_over)
      : residency_(residency), last_seen_(last_seen), target_(target), batch_bytes_(batch_bytes), is_over_(is_over) {}

  Result<StreamStats> draw(const kernels::View& view, const kernels::ShadeOptions* shade);

 private:
  /// A missing chunk that may be hidden, and the nearest depth code that it may show.
  struct Unsure {
    uint32_t nearest;
    uint32_t chunk;
  };
  /// Chunks that are drawn together.
  struct Part {
    std::vector<Residency::Place> places;  // none: a batch that only moves
    bool is_load;
    StreamTarget::Share share = StreamTarget::Share::kAll;
  };

  Result<void> list();
  void split(std::vector<Residency::Place> there, uint64_t wanted);
  bool is_hidden(uint32_t chunk);
  void ask_for(std::span<const uint32_t> chunks);
  void take_unsure(uint64_t most_bytes);
  Result<void> load_ahead(size_t most_unsure);
  Result<void> draw_part(Part part);
  Result<void> finish_loading();
  /// Whether chunks remain that are tested for occlusion before they are loaded.
  bool has_unsure() const { return !unsure_.empty() || (!is_sure_ && !residency_.missing().empty()); }
  /// Comparison for heaps with the nearest on top.
  static bool is_farther(const Unsure& a, const Unsure& b) {
    return a.nearest != b.nearest ? a.nearest > b.nearest : a.chunk > b.chunk;
  }
  bool has_parts() const {
    return std::any_of(parts_.begin(), parts_.end(), [](const Part& part) { return !part.places.empty(); });
  }
  void look_at_picture();
  /// Whether the frame ends with the loads that have started.
  bool ends() {
    ends_ = ends_ || (is_over_ && is_over_());
    return ends_;
  }
  void leave_missing();

  Residency& residency_;
  const std::span<LastSeen> last_seen_;
  StreamTarget& target_;
  const uint64_t batch_bytes_;
  const IsOver& is_over_;
  bool ends_ = false;
  StreamStats stats_{};
  std::vector<uint32_t> listed_;  // near ones first; then the chunks that were hidden last time
  // Missing chunks that the residency does not have yet:
  std::vector<Unsure> unsure_;  // a heap
  std::vector<uint32_t> hidden_;
  bool is_sure_ = true;        // the residency's missing chunks are needed, as they were last time
  uint64_t unsure_bytes_ = 0;  // bytes of a batch of unsure chunks
  std::deque<Part> parts_;     // not drawn yet
  size_t loads_ = 0;           // number of parts that are being loaded
  bool had_missing_ = false;
  bool has_begun_ = false;       // drawing has begun
  bool has_depths_ = false;      // the depths of some part are known
  bool has_all_depths_ = false;  // the depths of all parts so far are known
  std::vector<uint32_t> streamed_;
};

Result<StreamStats> Streamer::Frame::draw(const kernels::View& view, const kernels::ShadeOptions* shade) {
  SCREE_TRY(target_.begin(view, shade));
  SCREE_TRY(list());
  SCREE_TRY(load_ahead(1));
  for (;;) {
    while (!parts_.empty()) {
      Part part = std::move(parts_.front());
      parts_.pop_front();
      SCREE_TRY(draw_part(std::move(part)));
    }
    if (ends()) {
      leave_missing();
      break;
    }
    // Chunks that were hidden last time are tested last: by now the chunks that hide them are probably drawn.
    if (!has_unsure() && residency_.missing().empty()) {
      if (hidden_.empty()) break;
      ask_for(hidden_);
      hidden_.clear();
    }
    SCREE_TRY(load_ahead(kLoadsAhead));
  }
  look_at_picture();
  return stats_;
}

Result<void> Streamer::Frame::list() {
  const Timed timed(stats_.list_ms);
  const std::span<const uint32_t> listed = SCREE_TRY(target_.list());
  // The end of the list is evicted first. So chunks that were hidden in the last picture are last.
  listed_.assign(listed.begin(), listed.end());
  std::stable_partition(listed_.begin(), listed_.end(),
                        [&](uint32_t chunk) { return last_seen_[chunk] != LastSeen::kHidden; });
  stats_.seen_chunks = listed_.size();
  for (const uint32_t chunk : listed_) stats_.seen_bytes += residency_.chunk_bytes(chunk);
  std::vector<Residency::Place> there = residency_.begin_frame(listed_);
  had_missing_ = !residency_.missing().empty();
  for (const uint32_t chunk : residency_.missing()) stats_.missing_bytes += residency_.chunk_bytes(chunk);
  std::vector<uint32_t> unknown;
  uint64_t wanted = 0;
  residency_.drop_missing([&](uint32_t chunk) {
    if (last_seen_[chunk] == LastSeen::kVisible) wanted += residency_.chunk_bytes(chunk);
    if (last_seen_[chunk] == LastSeen::kUnknown) unknown.push_back(chunk);
    if (last_seen_[chunk] == LastSeen::kHidden) hidden_.push_back(chunk);
    return last_seen_[chunk] != LastSeen::kVisible;
  });
  ask_for(unknown);
  split(std::move(there), wanted);
  return {};
}

/// If no load is certain, all resident chunks are one part. Otherwise the pool is probably full, and a load needs
/// chunks that were drawn and evicted. So the first parts are contiguous stretches of the pool, of one, two, four ...
/// batches: while one is drawn, chunks are loaded in place of the one before. Stretches give loads contiguous room. The
/// stretches with the farthest chunks are taken, because near chunks hide later ones and should stay.
void Streamer::Frame::split(std::vector<Residency::Place> there, uint64_t wanted) {
  struct Stretch {
    std::vector<Residency::Place> places;
    uint64_t bytes = 0;
    uint64_t ranks = 0;  // summed over all places
    uint64_t mean_rank() const { return ranks / places.size(); }
  };
  if (wanted != 0) {
    std::vector<Stretch> stretches;
    for (const Residency::Place& place : there) {
      if (stretches.empty() || stretches.back().bytes + place.bytes > batch_bytes_) stretches.emplace_back();
      Stretch& last = stretches.back();
      last.places.push_back(place);
      last.bytes += place.bytes;
      last.ranks += residency_.rank(place.chunk);
    }
    std::stable_sort(stretches.begin(), stretches.end(),
                     [](const Stretch& a, const Stretch& b) { return a.mean_rank() > b.mean_rank(); });
    uint64_t freed = 0;
    uint64_t in_part = 0;
    uint64_t most_in_part = 1;
    there.clear();
    for (Stretch& stretch : stretches) {
      // Frees room for one more chunk, so that the last chunk too finds a contiguous range.
      if (freed >= wanted + residency_.largest_room()) {
        there.insert(there.end(), stretch.places.begin(), stretch.places.end());
        continue;
      }
      residency_.give_way_next(stretch.places);
      if (in_part == 0) parts_.push_back({{}, false});
      parts_.back().places.insert(parts_.back().places.end(), stretch.places.begin(), stretch.places.end());
      freed += stretch.bytes;
      if (++in_part < most_in_part) continue;
      in_part = 0;
      most_in_part *= 2;
    }
  }
  if (!there.empty()) parts_.push_back({std::move(there), false});
  if (parts_.size() < 3) return;
  // The parts are in order from far to near, but near clusters hide far ones. So the likely visible clusters of all
  // parts are drawn before the rest. The first part is drawn even before them, because loads wait for it.
  Part likely{{}, false, StreamTarget::Share::kLikelySeen};
  for (auto part = parts_.begin() + 1; part != parts_.end(); ++part) {
    part->share = StreamTarget::Share::kRest;
    likely.places.insert(likely.places.end(), part->places.begin(), part->places.end());
  }
  parts_.insert(parts_.begin() + 1, std::move(likely));
}

bool Streamer::Frame::is_hidden(uint32_t chunk) {
  if (target_.nearest_shown(chunk) != kNotInView) return false;
  stats_.hidden_bytes += residency_.chunk_bytes(chunk);
  return true;
}

void Streamer::Frame::ask_for(std::span<const uint32_t> chunks) {
  for (const uint32_t chunk : chunks)
    if (!is_hidden(chunk)) unsure_.push_back({target_.nearest_shown(chunk), chunk});
  std::make_heap(unsure_.begin(), unsure_.end(), is_farther);
}

/// Passes unsure chunks of up to `most_bytes` to the residency. A chunk may have several instances. If its nearest one
/// is found to be hidden, the chunk goes back to the heap with the depth of its nearest visible instance. Chunks drawn
/// meanwhile may hide the others.
void Streamer::Frame::take_unsure(uint64_t most_bytes) {
  std::vector<uint32_t> taken;
  uint64_t bytes = 0;
  for (const uint32_t chunk : residency_.missing()) bytes += residency_.chunk_bytes(chunk);
  while (bytes < most_bytes && !unsure_.empty()) {
    std::pop_heap(unsure_.begin(), unsure_.end(), is_farther);
    Unsure& next = unsure_.back();
    const uint32_t nearest = target_.nearest_shown(next.chunk);
    if (nearest != kNotInView && nearest > next.nearest) {
      next.nearest = nearest;
      std::push_heap(unsure_.begin(), unsure_.end(), is_farther);
      continue;
    }
    const uint32_t chunk = next.chunk;
    unsure_.pop_back();
    if (is_hidden(chunk)) continue;
    taken.push_back(chunk);
    bytes += residency_.chunk_bytes(chunk);
  }
  residency_.add_missing(taken);
}

/// Starts loads: as many certain chunks as fit, and up to `most_unsure` loads of others.
Result<void> Streamer::Frame::load_ahead(size_t most_unsure) {
  const Timed timed(stats_.choose_ms);
  // Before any depths are known, no chunk can be found to be hidden, so this loads as little as possible. While the
  // first part is drawn it loads more: that part may take as long as two batches.
  if (!has_depths_ && !has_begun_) most_unsure = 1;
  for (;;) {
    if (ends()) return {};
    if (is_sure_ && residency_.missing().empty()) {
      if (unsure_.empty()) return {};
      unsure_bytes_ = batch_bytes_ / (has_depths_ || !parts_.empty() ? 1 : kFirstBatchShare);
      is_sure_ = false;
    }
    if (loads_ >= (!is_sure_ ? most_unsure : is_over_ ? kLoadsAhead : kMostLoads)) return {};
    const uint64_t most_bytes = is_sure_ ? batch_bytes_ : unsure_bytes_;
    // While other loads run, this waits for more room rather than load a small batch.
    if (loads_ != 0 && has_parts() && residency_.room_left() < most_bytes / 2) return {};
    if (!is_sure_) take_unsure(most_bytes);
    Residency::Batch batch = residency_.next_batch(most_bytes, [&](uint32_t chunk) { return is_hidden(chunk); });
    if (batch.loads.empty() && batch.moves.empty()) {
      if (residency_.missing().empty() && !unsure_.empty()) continue;  // all chunks of this batch are hidden
      return {};  // nothing is left, or chunks must be drawn first to make room
    }
    SCREE_TRY(target_.start_loading(batch));
    ++loads_;
    for (const Residency::Move& move : batch.moves) stats_.moved_bytes += move.bytes;
    for (const Residency::Place& place : batch.loads) {
      stats_.streamed_bytes += place.bytes;
      streamed_.push_back(place.chunk);
    }
    const bool has_room = !batch.loads.empty();
    stats_.batches += has_room ? 1 : 0;
    parts_.push_back({std::move(batch.loads), true});
    if (!has_room) return {};
    if (!is_sure_) unsure_bytes_ = std::min(2 * unsure_bytes_, batch_bytes_);
  }
}

Result<void> Streamer::Frame::draw_part(Part part) {
  // While this part's load runs, there is time to choose the next load by all depths so far. If it has arrived, drawing
  // is the bottleneck and comes first, unless no other load is under way.
  bool waits = false;
  if (part.is_load) {
    const bool is_loaded = SCREE_TRY(target_.is_loaded());
    waits = !is_loaded;
  }
  if (waits || loads_ <= (part.is_load ? 1 : 0)) SCREE_TRY(load_ahead(kLoadsAhead));
  if (part.is_load) SCREE_TRY(finish_loading());
  // Other loads that have arrived by now are drawn in the same part, to save the fixed cost of a part.
  for (size_t loads = 1; part.is_load && loads < kLoadsInPart && !parts_.empty() && parts_.front().is_load; ++loads) {
    const bool is_loaded = SCREE_TRY(target_.is_loaded());
    if (!is_loaded) break;
    SCREE_TRY(finish_loading());
    part.places.insert(part.places.end(), parts_.front().places.begin(), parts_.front().places.end());
    parts_.pop_front();
  }
  if (part.places.empty()) return {};
  const bool finds_depths =
      had_missing_ && part.share != StreamTarget::Share::kLikelySeen && (has_unsure() || !has_parts());
  {
    const Timed timed(stats_.draw_ms);
    SCREE_TRY(target_.start_drawing(part.places, {part.share, finds_depths}));
  }
  has_begun_ = true;
  SCREE_TRY(load_ahead((waits && has_depths_) ? 1 : kLoadsAhead));
  const Timed timed(stats_.draw_ms);
  const StreamTarget::Drawn drawn = SCREE_TRY(target_.finish_drawing());
  stats_.drawn += drawn.stats;
  stats_.drawing_ms += drawn.ms;
  ++stats_.parts;
  has_depths_ = has_depths_ || finds_depths;
  has_all_depths_ = finds_depths;
  if (part.share != StreamTarget::Share::kLikelySeen) residency_.batch_drawn(part.places);
  return {};
}

Result<void> Streamer::Frame::finish_loading() {
  const Timed timed(stats_.load_ms);
  const double loaded = SCREE_TRY(target_.finish_loading());
  stats_.copying_ms += loaded;
  --loads_;
  return {};
}

/// Ends the frame without the missing chunks.
void Streamer::Frame::leave_missing() {
  const auto leave = [&](uint32_t chunk) {
    if (!is_hidden(chunk)) stats_.left_bytes += residency_.chunk_bytes(chunk);
    return true;
  };
  residency_.drop_missing(leave);
  for (const Unsure& unsure : unsure_) leave(unsure.chunk);
  for (const uint32_t chunk : hidden_) leave(chunk);
}

/// Records the visibility of chunks for the next frame, if the picture is complete: chunks that are visible in an
/// incomplete picture may be hidden in the whole one.
void Streamer::Frame::look_at_picture() {
  if (!has_all_depths_ || stats_.left_bytes != 0) return;
  for (const uint32_t chunk : listed_)
    last_seen_[chunk] = target_.nearest_shown(chunk) == kNotInView ? LastSeen::kHidden : LastSeen::kVisible;
  for (const uint32_t chunk : streamed_)
    if (last_seen_[chunk] == LastSeen::kVisible) stats_.needed_bytes += residency_.chunk_bytes(chunk);
}

/// Runs `work`. After an error the pool's content is unknown, so all chunks are removed.
template <class Work>
auto Streamer::guarded(StreamTarget& target, const Work& work) -> decltype(work()) {
  auto done = [&]() -> decltype(work()) {
    try {
      return work();
    } catch (const std::bad_alloc&) {
      return no_memory("for the frame's chunks");
    }
  }();
  if (!done) {
    target.stop();
    residency_.forget();
  }
  return done;
}

Result<StreamStats> Streamer::draw(const kernels::View& view, const kernels::ShadeOptions* shade, StreamTarget& target,
                                   const IsOver& is_over) {
  const uint64_t triangles = view_.instance_count == 0 ? 0 : view_.instance_base[view_.instance_count];
  SCREE_TRY(kernels::check_frame(view, triangles));
  return guarded(target,
                 [&] { return Frame(residency_, batch_bytes_, last_seen_, target, is_over).draw(view, shade); });
}

Result<Streamer::Rest> Streamer::load_rest(StreamTarget& target, const IsOver& is_over) {
  return guarded(target, [&]() -> Result<Rest> {
    std::vector<uint32_t> chunks;
    for (uint64_t c = 0; c < view_.chunk_count; ++c)
      if (residency_.chunk_bytes(static_cast<uint32_t>(c)) != 0) chunks.push_back(static_cast<uint32_t>(c));
    Rest rest{0, residency_.begin_frame(chunks)};
    size_t loads = 0;
    for (bool is_ended = false;;) {
      while (loads < kLoadsAhead && !is_ended) {
        const Residency::Batch batch = residency_.next_batch(batch_bytes_);
        is_ended = batch.loads.empty();
        if (is_ended) break;
        SCREE_TRY(target.start_loading(batch));
        ++loads;
        rest.present.insert(rest.present.end(), batch.loads.begin(), batch.loads.end());
        is_ended = is_over && is_over();
      }
      if (loads == 0) break;
      SCREE_TRY(target.finish_loading());
      --loads;
    }
    for (const uint32_t chunk : residency_.missing()) rest.left_bytes += residency_.chunk_bytes(chunk);
    residency_.batch_drawn(rest.present);
    return rest;
  });
}

}  // namespace scree::runtime
