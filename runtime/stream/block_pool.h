// Allocates contiguous ranges of a memory pool by two-level segregated fit (Masmano, Ripoll, Crespo and Real 2004): the
// time of allocating and freeing does not depend on the number of ranges.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

namespace scree::runtime {

/// Blocks are adjacent and cover the pool; no two neighbours are both free. The caller chooses the unit of sizes and
/// offsets. take(), give_back() and move_together() may throw std::bad_alloc. Not thread-safe.
class BlockPool {
 public:
  static constexpr uint32_t kNone = 0xffffffff;

  /// Empties the pool: one free block of `units`, or no block if that is 0.
  void reset(uint64_t units);

  /// Takes the first `units` (at least 1) of a free block that is only slightly larger. Returns kNone if no free block
  /// is large enough. `owner`: the value for owner().
  uint32_t take(uint64_t units, uint32_t owner);

  /// Gives a taken block back. Its number may be used for another block afterwards.
  void give_back(uint32_t block);

  /// Changes the size of the pool at its end. Blocks beyond a smaller size must be free.
  void resize(uint64_t units);

  uint64_t offset(uint32_t block) const { return blocks_[block].offset; }
  uint64_t units(uint32_t block) const { return blocks_[block].units; }
  uint32_t owner(uint32_t block) const { return blocks_[block].owner; }
  bool is_free(uint32_t block) const { return blocks_[block].is_free; }
  /// Blocks in order of their offsets; kNone after the last.
  uint32_t first() const { return first_; }
  uint32_t next(uint32_t block) const { return blocks_[block].next; }
  uint64_t free_units() const { return free_units_; }

  /// Moves each taken block, in order, to the smallest offset after the taken blocks before it, unless `stays(owner)`.
  /// Calls `moved(block, from)` after each move.
  template <class Stays, class Moved>
  void move_together(const Stays& stays, const Moved& moved);

 private:
  // 16 classes between two powers of two; sizes below 16 have a class each.
  static constexpr uint32_t kSubclassBits = 4;
  static constexpr uint32_t kClasses = (64 - kSubclassBits + 1) << kSubclassBits;

  struct Block {
    uint64_t offset;
    uint64_t units;
    uint32_t before;  // by offset
    uint32_t next;
    uint32_t before_free;  // in the list of its class
    uint32_t next_free;
    uint32_t owner;
    bool is_free;
  };

  static uint32_t class_of(uint64_t units);
  uint32_t find(uint64_t units) const;
  uint32_t new_block(uint64_t offset, uint64_t units, uint32_t before, uint32_t next);
  void drop_block(uint32_t block);
  void enlist(uint32_t block);
  void delist(uint32_t block);
  void unlink(uint32_t block);

  std::vector<Block> blocks_;
  std::vector<uint32_t> unused_;  // numbers that no block uses
  std::array<uint32_t, kClasses> lists_;
  std::array<uint64_t, (kClasses + 63) / 64> has_list_;  // one bit per class
  uint32_t first_ = kNone;
  uint64_t pool_units_ = 0;
  uint64_t free_units_ = 0;
};

template <class Stays, class Moved>
void BlockPool::move_together(const Stays& stays, const Moved& moved) {
  // Remove all free blocks; new ones are made where gaps remain.
  for (uint32_t block = first_; block != kNone;) {
    const uint32_t next = blocks_[block].next;
    if (blocks_[block].is_free) {
      delist(block);
      unlink(block);
      drop_block(block);
    }
    block = next;
  }
  uint64_t end = 0;
  uint32_t last = kNone;
  const auto fill = [&](uint64_t to, uint32_t next) {
    if (end < to) enlist(new_block(end, to - end, last, next));
  };
  for (uint32_t block = first_; block != kNone; block = blocks_[block].next) {
    const uint64_t from = blocks_[block].offset;
    if (stays(blocks_[block].owner)) {
      fill(from, block);
      end = from;
    } else if (from != end) {
      blocks_[block].offset = end;
      moved(block, from);
    }
    end += blocks_[block].units;
    last = block;
  }
  fill(pool_units_, kNone);
}

}  // namespace scree::runtime
