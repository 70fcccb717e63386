#include "runtime/residency.h"

#include <algorithm>
#include <cassert>
#include <string>

#include "format/bytes.h"

namespace scree::runtime {

uint64_t Residency::room(uint32_t chunk) const {
  return format::align_up(std::max<uint64_t>(chunk_bytes_[chunk], 1), kAlignment);  // no two in one place
}

Result<Residency> Residency::create(uint64_t pool_bytes, std::vector<uint64_t> chunk_bytes) {
  if (chunk_bytes.size() >= UINT32_MAX)
    return Error{ErrorCode::kRange, std::to_string(chunk_bytes.size()) + " chunks, expected fewer than 2^32 - 1"};
  const uint64_t whole = pool_bytes / kAlignment * kAlignment;
  const auto largest = std::max_element(chunk_bytes.begin(), chunk_bytes.end());
  if (largest != chunk_bytes.end() && std::max<uint64_t>(*largest, 1) > whole) {
    // No memory is so large that rounding up could wrap, but a size may be.
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
  residency.forget();
  return Result<Residency>(std::move(residency));
}

void Residency::forget() {
  for (Slot& slot : slots_) slot = Slot();
  ages_.clear();
  chunk_at_.clear();
  holes_.clear();
  by_size_.clear();
  missing_.clear();
  batches_.clear();
  free_bytes_ = pinned_bytes_ = 0;
  if (pool_bytes_ != 0) add_hole(0, pool_bytes_);
}

std::vector<Residency::Place> Residency::begin_frame(std::span<const uint32_t> visible) {
  assert(batches_.empty());
  ++frame_;
  missing_.clear();
  std::vector<Place> there;
  std::vector<uint32_t> batch;
  uint32_t rank = 0;
  for (const uint32_t chunk : visible) {
    Slot& slot = slots_[chunk];
    const bool resident = slot.offset != kAbsent;
    if (resident) ages_.erase(age(chunk));
    slot.frame = frame_;
    slot.rank = rank++;
    if (!resident) {
      missing_.push_back(chunk);
      continue;
    }
    ages_.insert(age(chunk));
    slot.pinned = true;
    pinned_bytes_ += room(chunk);
    there.push_back({chunk, slot.offset, chunk_bytes_[chunk]});
    batch.push_back(chunk);
  }
  batches_.push_back(std::move(batch));
  return there;
}

Residency::Batch Residency::next_batch(uint64_t most_bytes) {
  Batch batch;
  const uint64_t room_left = pool_bytes_ - pinned_bytes_;
  uint64_t wanted = 0;
  size_t count = 0;
  for (; count < missing_.size(); ++count) {
    const uint64_t bytes = room(missing_[count]);
    if (bytes > room_left - wanted || (count != 0 && wanted + bytes > most_bytes)) break;
    wanted += bytes;
  }
  if (count == 0) return batch;
  make_free(wanted);
  size_t placed = 0;
  while (placed < count && place(missing_[placed])) ++placed;
  if (placed < count) {
    while (placed != 0) evict(missing_[--placed]);
    move_together(batch.moves);
    while (placed < count && place(missing_[placed])) ++placed;
  }
  std::vector<uint32_t> chunks(missing_.begin(), missing_.begin() + static_cast<ptrdiff_t>(placed));
  for (const uint32_t chunk : chunks) {
    slots_[chunk].pinned = true;
    pinned_bytes_ += room(chunk);
    batch.loads.push_back({chunk, slots_[chunk].offset, chunk_bytes_[chunk]});
  }
  missing_.erase(missing_.begin(), missing_.begin() + static_cast<ptrdiff_t>(chunks.size()));
  if (!chunks.empty()) batches_.push_back(std::move(chunks));
  return batch;
}

void Residency::batch_drawn() {
  assert(!batches_.empty());
  for (const uint32_t chunk : batches_.front()) {
    slots_[chunk].pinned = false;
    pinned_bytes_ -= room(chunk);
  }
  batches_.pop_front();
}

/// Joins it with the holes beside it.
void Residency::add_hole(uint64_t offset, uint64_t bytes) {
  free_bytes_ += bytes;
  auto next = holes_.lower_bound(offset);
  if (next != holes_.end() && offset + bytes == next->first) {
    bytes += next->second;
    by_size_.erase({next->second, next->first});
    next = holes_.erase(next);
  }
  if (next != holes_.begin()) {
    const auto before = std::prev(next);
    if (before->first + before->second == offset) {
      by_size_.erase({before->second, before->first});
      before->second += bytes;
      by_size_.insert({before->second, before->first});
      return;
    }
  }
  holes_.emplace_hint(next, offset, bytes);
  by_size_.insert({bytes, offset});
}

std::map<uint64_t, uint64_t>::iterator Residency::remove_hole(std::map<uint64_t, uint64_t>::iterator hole) {
  free_bytes_ -= hole->second;
  by_size_.erase({hole->second, hole->first});
  return holes_.erase(hole);
}

/// In the smallest hole that has room; false where none has.
bool Residency::place(uint32_t chunk) {
  const uint64_t bytes = room(chunk);
  const auto found = by_size_.lower_bound({bytes, 0});
  if (found == by_size_.end()) return false;
  const auto [hole_bytes, offset] = *found;
  remove_hole(holes_.find(offset));
  if (hole_bytes > bytes) add_hole(offset + bytes, hole_bytes - bytes);
  slots_[chunk].offset = offset;
  chunk_at_.emplace(offset, chunk);
  ages_.insert(age(chunk));
  return true;
}

void Residency::evict(uint32_t chunk) {
  Slot& slot = slots_[chunk];
  assert(!slot.pinned);
  ages_.erase(age(chunk));
  chunk_at_.erase(slot.offset);
  add_hole(slot.offset, room(chunk));
  slot.offset = kAbsent;
}

/// Lets chunks give way until so many bytes are free, wherever they lie.
void Residency::make_free(uint64_t bytes) {
  for (auto next = ages_.begin(); free_bytes_ < bytes && next != ages_.end();) {
    const uint32_t chunk = next->chunk;
    ++next;  // what gives way leaves the set
    if (!slots_[chunk].pinned) evict(chunk);
  }
}

void Residency::move_together(std::vector<Move>& moves) {
  std::map<uint64_t, uint32_t> moved;
  holes_.clear();
  by_size_.clear();
  free_bytes_ = 0;
  uint64_t end = 0;  // of what lies together
  for (const auto& [offset, chunk] : chunk_at_) {
    Slot& slot = slots_[chunk];
    const uint64_t bytes = room(chunk);
    if (slot.pinned && offset > end) add_hole(end, offset - end);
    if (slot.pinned) end = offset;
    if (end != offset) moves.push_back({offset, end, chunk_bytes_[chunk]});
    slot.offset = end;
    moved.emplace_hint(moved.end(), end, chunk);
    end += bytes;
  }
  if (end < pool_bytes_) add_hole(end, pool_bytes_ - end);
  chunk_at_ = std::move(moved);
}

}  // namespace scree::runtime
