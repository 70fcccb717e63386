#include "runtime/streamer.h"

#include <algorithm>
#include <deque>
#include <new>
#include <string>
#include <utility>

#include "runtime/stopwatch.h"

namespace scree::runtime {
namespace {

void add(kernels::FrameStats& sum, const kernels::FrameStats& part) {
  sum.instances_drawn += part.instances_drawn;
  sum.draws += part.draws;
  sum.triangles += part.triangles;
  sum.triangles_small += part.triangles_small;
  sum.triangles_medium += part.triangles_medium;
  sum.triangles_large += part.triangles_large;
  sum.triangles_clipped += part.triangles_clipped;
  sum.groups_tested += part.groups_tested;
  sum.clusters_tested += part.clusters_tested;
  sum.clusters_drawn += part.clusters_drawn;
}

/// An eighth: with what is drawn and what is loaded apart, most of the pool keeps what is near.
uint64_t wanted_batch_bytes(const Residency& residency) {
  return std::min(residency.pool_bytes() / 8, kMostBatchBytes);
}

Result<void> find_depths(StreamTarget& target, StreamStats& stats) {
  const Stopwatch watch;
  Result<void> found = target.find_depths();
  stats.depths_ms += watch.elapsed().wall_ms;
  return found;
}

Error no_memory(const std::string& what) {
  return {ErrorCode::kMemory, "no memory left " + what};
}

}  // namespace

Streamer::Streamer(const Scene& scene, Residency residency) : residency_(std::move(residency)), view_(scene.view()) {
  chunks_.assign(view_.chunks, view_.chunks + view_.chunk_count);
  for (uint64_t c = 0; c < view_.chunk_count; ++c) {
    chunks_[c].page = static_cast<uint32_t>(c);
    chunks_[c].offset = 0;
  }
  was_hidden_.assign(view_.chunk_count, false);
  view_.chunks = chunks_.data();
  view_.pages = nullptr;
}

Result<Streamer> Streamer::create(const Scene& scene, uint64_t pool_bytes, std::vector<uint64_t> chunk_bytes) {
  try {
    Result<Residency> residency = Residency::create(pool_bytes, std::move(chunk_bytes));
    if (!residency) return at(scene.file().path(), residency.error());
    return Result<Streamer>(Streamer(scene, std::move(*residency)));
  } catch (const std::bad_alloc&) {
    return at(scene.file().path(), no_memory("to list its chunks"));
  }
}

uint64_t Streamer::most_batch_bytes() const {
  return std::max(wanted_batch_bytes(residency_), residency_.largest_room());
}

Result<StreamStats> Streamer::draw(const kernels::View& view, const kernels::ShadeOptions* shade,
                                   StreamTarget& target) {
  const uint64_t triangles = view_.instance_count == 0 ? 0 : view_.instance_base[view_.instance_count];
  if (Result<void> checked = kernels::check_frame(view, triangles); !checked) return checked.error();
  Result<StreamStats> drawn = [&]() -> Result<StreamStats> {
    try {
      return draw_all(view, shade, target);
    } catch (const std::bad_alloc&) {
      return no_memory("for the frame's chunks");
    }
  }();
  if (!drawn) {
    target.stop_loading();
    residency_.forget();
  }
  return drawn;
}

Result<StreamStats> Streamer::draw_all(const kernels::View& view, const kernels::ShadeOptions* shade,
                                       StreamTarget& target) {
  StreamStats stats{};
  if (Result<void> begun = target.begin(view, shade); !begun) return begun.error();
  const Stopwatch list_watch;
  const Result<std::span<const uint32_t>> listed = target.list();
  if (!listed) return listed.error();
  stats.list_ms = list_watch.elapsed().wall_ms;
  stats.seen_chunks = listed->size();
  for (const uint32_t chunk : *listed) stats.seen_bytes += residency_.chunk_bytes(chunk);
  std::vector<Residency::Place> batch = residency_.begin_frame(*listed);
  for (const uint32_t chunk : residency_.missing()) stats.missing_bytes += residency_.chunk_bytes(chunk);
  // What was hidden last time most likely is again, by something that is drawn later than the first loads are chosen:
  // it waits until all else is drawn.
  std::vector<uint32_t> waiting;
  residency_.drop_missing([&](uint32_t chunk) {
    if (was_hidden_[chunk]) waiting.push_back(chunk);
    return was_hidden_[chunk];
  });
  const uint64_t batch_bytes = wanted_batch_bytes(residency_);

  bool has_depths = false;  // of all that is drawn
  const auto is_hidden = [&](uint32_t chunk) {
    if (!has_depths || !target.is_hidden(chunk)) return false;
    stats.hidden_bytes += residency_.chunk_bytes(chunk);
    was_hidden_[chunk] = true;
    return true;
  };
  std::deque<std::vector<Residency::Place>> loading;
  std::vector<uint32_t> streamed;
  bool has_batch = true;  // `batch` is to be drawn; that of begin_frame() may be empty
  bool is_drawn = false;  // something
  while (has_batch || !residency_.missing().empty() || !waiting.empty()) {
    if (!has_batch && residency_.missing().empty()) {
      residency_.add_missing(waiting);
      waiting.clear();
    }
    const Stopwatch choose_watch;
    // Before there is anything to hide behind, as little as possible is asked for.
    while (loading.size() < (is_drawn ? kLoadsAhead : 1) && !residency_.missing().empty()) {
      Residency::Batch next = residency_.next_batch(batch_bytes, is_hidden);
      if (!next.moves.empty()) {
        if (Result<void> moved = target.move(next.moves); !moved) return moved.error();
        for (const Residency::Move& move : next.moves) stats.moved_bytes += move.bytes;
      }
      if (next.loads.empty()) break;  // until what is drawn now may give way
      if (Result<void> started = target.start_loading(next.loads); !started) return started.error();
      for (const Residency::Place& place : next.loads) {
        stats.streamed_bytes += place.bytes;
        streamed.push_back(place.chunk);
        was_hidden_[place.chunk] = false;
      }
      ++stats.batches;
      loading.push_back(std::move(next.loads));
    }
    stats.choose_ms += choose_watch.elapsed().wall_ms;
    if (has_batch) {
      if (!batch.empty()) {
        has_depths = false;
        const Stopwatch draw_watch;
        const Result<kernels::FrameStats> drawn = target.draw(batch);
        if (!drawn) return drawn.error();
        add(stats.drawn, *drawn);
        stats.draw_ms += draw_watch.elapsed().wall_ms;
        is_drawn = true;
      }
      residency_.batch_drawn();
      if (!batch.empty() && (!residency_.missing().empty() || !waiting.empty())) {
        if (Result<void> found = find_depths(target, stats); !found) return found.error();
        has_depths = true;
      }
    }
    has_batch = !loading.empty();
    if (has_batch) {
      const Stopwatch load_watch;
      if (Result<void> loaded = target.finish_loading(); !loaded) return loaded.error();
      stats.load_ms += load_watch.elapsed().wall_ms;
      batch = std::move(loading.front());
      loading.pop_front();
    }
  }
  if (!streamed.empty()) {
    if (Result<void> found = find_depths(target, stats); !found) return found.error();
    for (const uint32_t chunk : streamed)
      if (!target.is_hidden(chunk)) stats.needed_bytes += residency_.chunk_bytes(chunk);
  }
  return stats;
}

}  // namespace scree::runtime
