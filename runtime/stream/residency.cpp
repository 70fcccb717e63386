#include "runtime/stream/residency.h"

#include <algorithm>
#include <cassert>
#include <string>

#include "format/bytes.h"

namespace scree::runtime {

uint64_t Residency::room(uint32_t chunk) const {
  return format::align_up(std::max<uint64_t>(chunk_bytes_[chunk], 1), kAlignment);  // no two chunks at one offset
}

Result<Residency> Residency::create(uint64_t pool_bytes, std::vector<uint64_t> chunk_bytes) {
  if (chunk_bytes.size() >= UINT32_MAX)
    return Error{ErrorCode::kRange, std::to_string(chunk_bytes.size()) + " chunks, expected fewer than 2^32 - 1"};
  const uint64_t whole = pool_bytes / kAlignment * kAlignment;
  const auto largest = std::max_element(chunk_bytes.begin(), chunk_bytes.end());
  if (largest != chunk_bytes.end() && std::max<uint64_t>(*largest, 1) > whole) {
    // Rounding up cannot wrap for any real memory, but it may for a hostile size.
    const uint64_t least = std::max<uint64_t>(*largest, 1);
    const uint64_t rounded = least > UINT64_MAX - kAlignment ? least : format::align_up(least, kAlignment);
    return Error{ErrorCode::kRange, "chunk " + std::to_string(largest - chunk_bytes.begin()) + " takes " +
                                        std::to_string(*largest) + " bytes, but the pool of chunks has " +
                                        std::to_string(whole) + "; it needs at least " + std::to_string(rounded)};
  }
  Residency residency;
  residency.pool_bytes_ = whole;
  residency.slots_.resize(chunk_bytes.size());
  residency.chunk_bytes_ = std::move(chunk_bytes);
  for (uint64_t c = 0; c < residency.slots_.size(); ++c)
    residency.largest_room_ = std::max(residency.largest_room_, residency.room(static_cast<uint32_t>(c)));
  residency.forget();
  return Result<Residency>(std::move(residency));
}

void Residency::forget() {
  for (Slot& slot : slots_) slot = Slot();
  blocks_.reset(pool_bytes_ / kAlignment);
  unseen_.clear();
  drawn_.clear();
  missing_.clear();
  first_missing_ = 0;
  pinned_bytes_ = 0;
}

void Residency::resize(uint64_t pool_bytes) {
  assert(pinned_bytes_ == 0 && pool_bytes >= largest_room_);
  const uint64_t units = pool_bytes / kAlignment;
  // begin_frame() lists the chunks again.
  unseen_.clear();
  drawn_.clear();
  for (uint32_t chunk = 0; chunk < slots_.size(); ++chunk)
    if (is_resident(chunk) && offset(chunk) + room(chunk) > units * kAlignment) evict(chunk);
  blocks_.resize(units);
  pool_bytes_ = units * kAlignment;
}

std::vector<Residency::Place> Residency::begin_frame(std::span<const uint32_t> visible) {
  assert(pinned_bytes_ == 0);
  ++frame_;
  missing_.clear();
  first_missing_ = 0;
  missing_.reserve(visible.size());
  next_to_give_way_ = UINT32_MAX;
  uint32_t rank = 0;
  for (const uint32_t chunk : visible) {
    Slot& slot = slots_[chunk];
    slot.frame = frame_;
    slot.rank = rank++;
    if (!is_resident(chunk)) missing_.push_back(chunk);
  }
  std::vector<Place> there;
  there.reserve(visible.size() - missing_.size());
  unseen_.clear();
  drawn_.clear();
  for (uint32_t block = blocks_.first(); block != BlockPool::kNone; block = blocks_.next(block)) {
    if (blocks_.is_free(block)) continue;
    const uint32_t chunk = blocks_.owner(block);
    Slot& slot = slots_[chunk];
    if (slot.frame != frame_) {
      unseen_.push_back(chunk);
      continue;
    }
    slot.pinned = true;
    pinned_bytes_ += room(chunk);
    there.push_back({chunk, offset(chunk), chunk_bytes_[chunk]});
  }
  std::sort(unseen_.begin(), unseen_.end(), [&](uint32_t a, uint32_t b) {
    const Slot& first = slots_[a];
    const Slot& second = slots_[b];
    if (first.frame != second.frame) return first.frame > second.frame;
    return first.rank != second.rank ? first.rank < second.rank : a > b;
  });
  return there;
}

/// Places the chosen chunks up to the first one that does not fit; the rest become missing again. Together they take
/// `bytes`, and at least `bytes` of the pool are not pinned.
Residency::Batch Residency::load(std::span<const uint32_t> chosen, uint64_t bytes) {
  Batch batch;
  if (chosen.empty()) return batch;
  make_free(bytes);
  // Chunks that are adjacent in the file become adjacent in the pool if possible, so that there are fewer and longer
  // copies.
  std::vector<uint32_t> by_number(chosen.begin(), chosen.end());
  std::sort(by_number.begin(), by_number.end());
  size_t placed = place_all(by_number);
  if (placed == 0) {
    move_together(batch.moves);
    placed = place_all(by_number);
  }
  if (placed == 0)
    while (placed < chosen.size() && place(chosen[placed])) ++placed;
  for (const uint32_t chunk : chosen.first(placed)) {
    slots_[chunk].pinned = true;
    pinned_bytes_ += room(chunk);
    batch.loads.push_back({chunk, offset(chunk), chunk_bytes_[chunk]});
  }
  // Dropped chunks may lie between two of them.
  for (size_t i = chosen.size(); i-- > placed;) missing_[--first_missing_] = chosen[i];
  return batch;
}

void Residency::give_way_next(std::span<const Place> places) {
  for (const Place& place : places) slots_[place.chunk].rank = next_to_give_way_;
  --next_to_give_way_;
}

void Residency::batch_drawn(std::span<const Place> places) {
  for (const Place& place : places) {
    assert(slots_[place.chunk].pinned);
    slots_[place.chunk].pinned = false;
    pinned_bytes_ -= room(place.chunk);
    drawn_.push_back(place.chunk);
    std::push_heap(drawn_.begin(), drawn_.end(), nearer());
  }
}

/// Returns false if no free range is large enough.
bool Residency::place(uint32_t chunk) {
  slots_[chunk].block = blocks_.take(room(chunk) / kAlignment, chunk);
  return is_resident(chunk);
}

/// Places all chunks, or none if one does not fit. Returns how many.
size_t Residency::place_all(std::span<const uint32_t> chunks) {
  for (size_t i = 0; i < chunks.size(); ++i) {
    if (place(chunks[i])) continue;
    while (i != 0) evict(chunks[--i]);
    return 0;
  }
  return chunks.size();
}

void Residency::evict(uint32_t chunk) {
  assert(!slots_[chunk].pinned);
  blocks_.give_back(slots_[chunk].block);
  slots_[chunk].block = BlockPool::kNone;
}

/// Evicts chunks until that many bytes are free, contiguous or not.
void Residency::make_free(uint64_t bytes) {
  while (free_bytes() < bytes && !unseen_.empty()) {
    evict(unseen_.back());
    unseen_.pop_back();
  }
  while (free_bytes() < bytes && !drawn_.empty()) {
    std::pop_heap(drawn_.begin(), drawn_.end(), nearer());
    evict(drawn_.back());
    drawn_.pop_back();
  }
}

void Residency::move_together(std::vector<Move>& moves) {
  blocks_.move_together([&](uint32_t chunk) { return slots_[chunk].pinned; },
                        [&](uint32_t block, uint64_t from) {
                          const uint64_t bytes = chunk_bytes_[blocks_.owner(block)];
                          moves.push_back({from * kAlignment, blocks_.offset(block) * kAlignment, bytes});
                        });
}

}  // namespace scree::runtime
