// Manages the chunks in a memory pool that is too small for all: chooses the chunks to load next, their offsets, and
// the chunks to evict. Independent of devices and files; runtime/stream/streamer.h transfers the bytes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "format/result.h"
#include "runtime/stream/block_pool.h"

namespace scree::runtime {

/// Course of a frame: begin_frame() returns the visible chunks that are already resident; next_batch() returns the
/// others batch by batch, near ones first. All of them keep their places until batch_drawn() is called for them, so
/// that some can be drawn while others are loaded. A chunk is loaded at most once per frame, and is not evicted before
/// the frame has drawn it.
///
/// Order of eviction: first the chunks that are not visible in this frame, beginning with the chunks that were visible
/// longest ago; then the chunks that it has drawn, the farthest first, so that near chunks are resident when the next
/// frame begins.
///
/// A chunk lies in one range, at a multiple of kAlignment. If enough bytes are free, but not in one range, movable
/// chunks are moved together. Therefore visible chunks stay resident from frame to frame if their bytes, rounded up to
/// kAlignment per chunk, fit the pool. All methods may throw std::bad_alloc; not thread-safe.
class Residency {
 public:
  static constexpr uint64_t kAlignment = 256;

  /// A chunk's bytes in the pool.
  struct Place {
    uint32_t chunk;
    uint64_t offset;
    uint64_t bytes;
  };
  /// Bytes that move within the pool, always to a smaller offset. The two ranges may overlap.
  struct Move {
    uint64_t from;
    uint64_t to;
    uint64_t bytes;
  };
  /// The moves have to be made first, in order. None moves a chunk that is not drawn yet.
  struct Batch {
    std::vector<Move> moves;
    std::vector<Place> loads;
  };

  /// `chunk_bytes`: by chunk, 0 for chunks that are never drawn. The pool is empty at first. Errors kRange: a chunk
  /// that does not fit `pool_bytes`, with the smallest pool that is large enough; 2^32 chunks or more.
  static Result<Residency> create(uint64_t pool_bytes, std::vector<uint64_t> chunk_bytes);

  /// Begins a frame in which these chunks are visible, each listed once, near ones first. Returns the resident ones, in
  /// this order.
  std::vector<Place> begin_frame(std::span<const uint32_t> visible);

  /// The next batch: missing chunks of at most `most_bytes` together, but at least one chunk; fewer if chunks that are
  /// not drawn yet leave less room. Chunks for which `is_dropped(chunk)` returns true are removed from the missing ones
  /// and not drawn in this frame. It is called for chunks in their order up to the batch's end, and may be called again
  /// for a chunk that did not fit. Returns no loads if none is missing, or if nothing fits before the next
  /// batch_drawn(); once all chunks are drawn, a chunk always fits.
  template <class IsDropped>
  Batch next_batch(uint64_t most_bytes, const IsDropped& is_dropped);
  Batch next_batch(uint64_t most_bytes) {
    return next_batch(most_bytes, [](uint32_t) { return false; });
  }

  /// Puts chunks from begin_frame() first in the order of eviction of drawn chunks, behind the chunks of earlier calls.
  void give_way_next(std::span<const Place> places);

  /// Marks chunks from begin_frame() and next_batch() as drawn. Call it once per chunk.
  void batch_drawn(std::span<const Place> places);

  /// Removes the missing chunks for which `is_dropped(chunk)` returns true; it is called once per chunk. They are not
  /// drawn in this frame.
  template <class IsDropped>
  void drop_missing(const IsDropped& is_dropped) {
    missing_.erase(missing_.begin(), missing_.begin() + static_cast<ptrdiff_t>(first_missing_));
    first_missing_ = 0;
    std::erase_if(missing_, is_dropped);
  }

  /// Puts some of the removed chunks back, behind the others.
  void add_missing(std::span<const uint32_t> chunks) { missing_.insert(missing_.end(), chunks.begin(), chunks.end()); }

  /// Changes the pool's size between frames. Chunks that lie beyond its new end are evicted. `pool_bytes`: at least
  /// largest_room().
  void resize(uint64_t pool_bytes);

  /// Removes all chunks. After an error the content of the pool is unknown.
  void forget();

  /// The missing chunks, near ones first.
  std::span<const uint32_t> missing() const { return std::span<const uint32_t>(missing_).subspan(first_missing_); }
  bool is_resident(uint32_t chunk) const { return slots_[chunk].block != BlockPool::kNone; }
  uint64_t chunk_bytes(uint32_t chunk) const { return chunk_bytes_[chunk]; }
  /// The index of a visible chunk in begin_frame()'s `visible`, until give_way_next() changes it.
  uint32_t rank(uint32_t chunk) const { return slots_[chunk].rank; }
  uint64_t pool_bytes() const { return pool_bytes_; }
  /// Bytes that next_batch() may use: the pool without the chunks that are not drawn yet.
  uint64_t room_left() const { return pool_bytes_ - pinned_bytes_; }
  uint64_t free_bytes() const { return blocks_.free_units() * kAlignment; }
  /// Bytes of the largest chunk in the pool.
  uint64_t largest_room() const { return largest_room_; }

 private:
  struct Slot {
    uint32_t block = BlockPool::kNone;
    uint32_t rank = 0;   // 0 is the nearest; the largest is evicted next
    uint64_t frame = 0;  // the last frame in which it was visible
    bool pinned = false;
  };

  Residency() = default;
  uint64_t room(uint32_t chunk) const;
  uint64_t offset(uint32_t chunk) const { return blocks_.offset(slots_[chunk].block) * kAlignment; }
  /// Comparison for drawn_.
  auto nearer() const {
    return [this](uint32_t a, uint32_t b) { return slots_[a].rank < slots_[b].rank; };
  }
  Batch load(std::span<const uint32_t> chosen, uint64_t bytes);
  bool place(uint32_t chunk);
  size_t place_all(std::span<const uint32_t> chunks);
  void evict(uint32_t chunk);
  void make_free(uint64_t bytes);
  void move_together(std::vector<Move>& moves);

  uint64_t pool_bytes_ = 0;
  uint64_t largest_room_ = 0;
  std::vector<uint64_t> chunk_bytes_;
  std::vector<Slot> slots_;
  BlockPool blocks_;  // in units of kAlignment; owners are chunks
  uint64_t pinned_bytes_ = 0;
  uint64_t frame_ = 0;
  uint32_t next_to_give_way_ = 0;  // rank for the next give_way_next()
  // unseen_: resident chunks that are not visible in this frame; the end is evicted first. drawn_: chunks that it has
  // drawn, a heap with the farthest on top.
  std::vector<uint32_t> unseen_;
  std::vector<uint32_t> drawn_;
  std::vector<uint32_t> missing_;
  size_t first_missing_ = 0;  // chunks before this index are no longer missing
};

template <class IsDropped>
Residency::Batch Residency::next_batch(uint64_t most_bytes, const IsDropped& is_dropped) {
  const uint64_t most = room_left();
  uint64_t wanted = 0;
  std::vector<uint32_t> chosen;
  for (; first_missing_ < missing_.size(); ++first_missing_) {
    const uint32_t chunk = missing_[first_missing_];
    if (is_dropped(chunk)) continue;
    const uint64_t bytes = room(chunk);
    if (bytes > most - wanted || (!chosen.empty() && wanted + bytes > most_bytes)) break;
    wanted += bytes;
    chosen.push_back(chunk);
  }
  return load(chosen, wanted);
}

}  // namespace scree::runtime
