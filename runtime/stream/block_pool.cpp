#include "runtime/stream/block_pool.h"

#include <algorithm>
#include <bit>
#include <cassert>

namespace scree::runtime {

void BlockPool::reset(uint64_t units) {
  blocks_.clear();
  unused_.clear();
  lists_.fill(kNone);
  has_list_.fill(0);
  first_ = kNone;
  pool_units_ = units;
  free_units_ = 0;
  if (units != 0) enlist(new_block(0, units, kNone, kNone));
}

void BlockPool::resize(uint64_t units) {
  uint32_t last = first_;
  while (last != kNone && blocks_[last].next != kNone) last = blocks_[last].next;
  if (units > pool_units_) {
    const uint32_t added = new_block(pool_units_, units - pool_units_, last, kNone);
    pool_units_ = units;
    give_back(added);  // joins it with a free neighbour
    return;
  }
  if (units == pool_units_) return;
  assert(last != kNone && blocks_[last].is_free && blocks_[last].offset <= units);
  delist(last);
  pool_units_ = units;
  blocks_[last].units = units - blocks_[last].offset;
  if (blocks_[last].units != 0) return enlist(last);
  unlink(last);
  drop_block(last);
}

uint32_t BlockPool::class_of(uint64_t units) {
  constexpr uint64_t kSmall = uint64_t{1} << kSubclassBits;
  if (units < kSmall) return static_cast<uint32_t>(units);
  const auto above = static_cast<uint32_t>(std::bit_width(units)) - 1 - kSubclassBits;
  return ((above + 1) << kSubclassBits) + static_cast<uint32_t>((units >> above) & (kSmall - 1));
}

/// A free block of at least this size. Searches the first few blocks of the size's own class, then the next non-empty
/// class, where every block is large enough, then the rest of its own class.
uint32_t BlockPool::find(uint64_t units) const {
  constexpr int kTries = 8;
  const uint32_t own = class_of(units);
  uint32_t block = lists_[own];
  for (int i = 0; i < kTries && block != kNone; ++i, block = blocks_[block].next_free)
    if (blocks_[block].units >= units) return block;
  for (uint32_t word = (own + 1) / 64; word < has_list_.size(); ++word) {
    uint64_t larger = has_list_[word];
    if (word == (own + 1) / 64) larger &= ~uint64_t{0} << ((own + 1) % 64);
    if (larger != 0) return lists_[64 * word + static_cast<uint32_t>(std::countr_zero(larger))];
  }
  while (block != kNone && blocks_[block].units < units) block = blocks_[block].next_free;
  return block;
}

uint32_t BlockPool::take(uint64_t units, uint32_t owner) {
  assert(units != 0);
  const uint32_t block = find(units);
  if (block == kNone) return kNone;
  // The steps that may throw come before any change.
  const uint64_t left = blocks_[block].units - units;
  if (left != 0) {
    const uint32_t rest = new_block(blocks_[block].offset + units, left, block, blocks_[block].next);
    delist(block);
    enlist(rest);
  } else {
    delist(block);
  }
  blocks_[block].units = units;
  blocks_[block].owner = owner;
  return block;
}

void BlockPool::give_back(uint32_t block) {
  assert(!blocks_[block].is_free);
  const uint32_t before = blocks_[block].before;
  const uint32_t next = blocks_[block].next;
  if (next != kNone && blocks_[next].is_free) {
    delist(next);
    blocks_[block].units += blocks_[next].units;
    unlink(next);
    drop_block(next);
  }
  if (before != kNone && blocks_[before].is_free) {
    delist(before);
    blocks_[before].units += blocks_[block].units;
    unlink(block);
    drop_block(block);
    block = before;
  }
  enlist(block);
}

/// Makes a block between two others. The new block is not marked free and is in no list yet.
uint32_t BlockPool::new_block(uint64_t offset, uint64_t units, uint32_t before, uint32_t next) {
  uint32_t block = 0;
  if (unused_.empty()) {
    if (unused_.capacity() <= blocks_.size()) unused_.reserve(2 * blocks_.size() + 16);  // drop_block() must not throw
    block = static_cast<uint32_t>(blocks_.size());
    assert(block != kNone);
    blocks_.push_back({});
  } else {
    block = unused_.back();
    unused_.pop_back();
  }
  blocks_[block] = {offset, units, before, next, kNone, kNone, kNone, false};
  (before == kNone ? first_ : blocks_[before].next) = block;
  if (next != kNone) blocks_[next].before = block;
  return block;
}

void BlockPool::drop_block(uint32_t block) {
  unused_.push_back(block);
}

void BlockPool::enlist(uint32_t block) {
  Block& b = blocks_[block];
  const uint32_t c = class_of(b.units);
  b.before_free = kNone;
  b.next_free = lists_[c];
  b.is_free = true;
  if (b.next_free != kNone) blocks_[b.next_free].before_free = block;
  lists_[c] = block;
  has_list_[c / 64] |= uint64_t{1} << (c % 64);
  free_units_ += b.units;
}

void BlockPool::delist(uint32_t block) {
  Block& b = blocks_[block];
  const uint32_t c = class_of(b.units);
  if (b.next_free != kNone) blocks_[b.next_free].before_free = b.before_free;
  (b.before_free == kNone ? lists_[c] : blocks_[b.before_free].next_free) = b.next_free;
  if (lists_[c] == kNone) has_list_[c / 64] &= ~(uint64_t{1} << (c % 64));
  b.is_free = false;
  free_units_ -= b.units;
}

void BlockPool::unlink(uint32_t block) {
  const Block& b = blocks_[block];
  (b.before == kNone ? first_ : blocks_[b.before].next) = b.next;
  if (b.next != kNone) blocks_[b.next].before = b.before;
}

}  // namespace scree::runtime
