// Which chunks lie in a memory pool that is too small for all of them, and where: what is loaded next, what gives way.
// Knows no device and no file; runtime/stream/streamer.h brings the bytes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "format/result.h"
#include "runtime/stream/block_pool.h"

namespace scree::runtime {

/// A frame goes so: begin_frame() gives the chunks that are seen and there already; next_batch() gives the others batch
/// by batch, near ones first. All of them stay where they are until batch_drawn() is called for them, so that some can
/// be drawn while others are loaded. A chunk is loaded at most once a frame, and one that the frame still has to draw
/// never gives way.
///
/// What gives way: chunks that were not seen in this frame, those first that were seen longest ago; then chunks that
/// this frame has drawn, the farthest first, so that the near ones are there when the next frame begins.
///
/// A chunk lies in one piece on a multiple of kAlignment. Where enough is free, but not in one piece, chunks that need
/// not stay where they are move together; so whatever is seen stays there from frame to frame if its bytes, each
/// chunk's rounded up to kAlignment, fit the pool. All methods may throw std::bad_alloc; not thread-safe.
class Residency {
 public:
  static constexpr uint64_t kAlignment = 256;

  /// A chunk's bytes in the pool.
  struct Place {
    uint32_t chunk;
    uint64_t offset;
    uint64_t bytes;
  };
  /// Bytes that move within the pool, always to a smaller offset; the two ranges may overlap.
  struct Move {
    uint64_t from;
    uint64_t to;
    uint64_t bytes;
  };
  /// The moves come first, in their order; none touches a chunk that is not drawn yet.
  struct Batch {
    std::vector<Move> moves;
    std::vector<Place> loads;
  };

  /// `chunk_bytes`: by chunk, 0 for those that are never drawn. Nothing is there at first. Errors kRange: a chunk that
  /// does not fit `pool_bytes`, with the least pool that does; 2^32 chunks.
  static Result<Residency> create(uint64_t pool_bytes, std::vector<uint64_t> chunk_bytes);

  /// Begins a frame that sees these chunks, each once, near ones first. Returns those that are there, as they lie.
  std::vector<Place> begin_frame(std::span<const uint32_t> visible);

  /// The next batch: as many of the missing chunks as take `most_bytes` together, at least one, and fewer where the
  /// chunks that are not drawn yet leave less room. Those for which `is_dropped(chunk)` are not missing any more: the
  /// frame does without. It is asked for chunks in their order up to the batch's end, and may be asked again for one
  /// that did not fit. Without loads where none is missing, or where nothing fits until batch_drawn() was called; with
  /// all of them drawn there is always room.
  template <class IsDropped>
  Batch next_batch(uint64_t most_bytes, const IsDropped& is_dropped);
  Batch next_batch(uint64_t most_bytes) {
    return next_batch(most_bytes, [](uint32_t) { return false; });
  }

  /// Of those that begin_frame() gave: once drawn they give way before all others that are, but for those that were
  /// named by an earlier call.
  void give_way_next(std::span<const Place> places);

  /// These are drawn, of those that begin_frame() and next_batch() gave: each once.
  void batch_drawn(std::span<const Place> places);

  /// Takes out those of the missing chunks for which `is_dropped(chunk)`, asked once for each: the frame does without.
  template <class IsDropped>
  void drop_missing(const IsDropped& is_dropped) {
    missing_.erase(missing_.begin(), missing_.begin() + static_cast<ptrdiff_t>(first_missing_));
    first_missing_ = 0;
    std::erase_if(missing_, is_dropped);
  }

  /// Puts some of those back, behind the others.
  void add_missing(std::span<const uint32_t> chunks) { missing_.insert(missing_.end(), chunks.begin(), chunks.end()); }

  /// Nothing is there any more: after an error nobody knows what the pool holds.
  void forget();

  /// Near ones first.
  std::span<const uint32_t> missing() const { return std::span<const uint32_t>(missing_).subspan(first_missing_); }
  bool is_resident(uint32_t chunk) const { return slots_[chunk].block != BlockPool::kNone; }
  uint64_t chunk_bytes(uint32_t chunk) const { return chunk_bytes_[chunk]; }
  /// Of a chunk that this frame sees: its place in begin_frame()'s `visible`, until give_way_next() names it.
  uint32_t rank(uint32_t chunk) const { return slots_[chunk].rank; }
  uint64_t pool_bytes() const { return pool_bytes_; }
  /// What next_batch() may fill: all that is not drawn yet has its place.
  uint64_t room_left() const { return pool_bytes_ - pinned_bytes_; }
  uint64_t free_bytes() const { return blocks_.free_units() * kAlignment; }
  /// The most that one chunk takes of the pool.
  uint64_t largest_room() const { return largest_room_; }

 private:
  struct Slot {
    uint32_t block = BlockPool::kNone;
    uint32_t rank = 0;   // there, 0 is the nearest; what gives way next has the largest
    uint64_t frame = 0;  // that saw it last
    bool pinned = false;
  };

  Residency() = default;
  uint64_t room(uint32_t chunk) const;
  uint64_t offset(uint32_t chunk) const { return blocks_.offset(slots_[chunk].block) * kAlignment; }
  /// The order of drawn_.
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
  uint32_t next_to_give_way_ = 0;  // the rank of those that are named next
  // Those that this frame does not see, the last gives way first; then those that it has drawn, as a heap with the
  // farthest on top.
  std::vector<uint32_t> unseen_;
  std::vector<uint32_t> drawn_;
  std::vector<uint32_t> missing_;
  size_t first_missing_ = 0;  // those before it are not missing any more
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
