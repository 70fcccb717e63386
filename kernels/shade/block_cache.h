// Decoded groups of indexed JPEGs (format/jpeg/pixels.h): a cache of fixed size that lives across frames. What is in it
// never shows: a group that is not there is decoded when it is asked for.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <vector>

#include "kernels/scene_view.h"

namespace scree::kernels {

/// Sets of up to kWays groups; in a set the group that was looked at longest ago gives way.
class BlockCache {
 public:
  static constexpr uint64_t kWays = 8;

  /// `bytes`: of samples, rounded down to whole slots, but never less than one. `slot_bytes`: of the largest group,
  /// at most 64 * kJpegMaxGroupBlocks. Throws std::bad_alloc.
  BlockCache(uint64_t bytes, uint32_t slot_bytes);
  BlockCache(const BlockCache&) = delete;
  BlockCache& operator=(const BlockCache&) = delete;

  /// The samples of a group (below the level's number of groups), decoded where they are not there. They stay until
  /// release(place), to which the calling thread asks for no other group: others wait for it. Thread-safe.
  const uint8_t* hold(const JpegLevel& level, uint32_t group, uint64_t& place);
  void release(uint64_t place);

  /// The colours of pixels (x[i % 2], y[i / 2]) of a level, as coded, red in the low byte. Each group is held once,
  /// however many of them lie in it. Not inline: shared by both instruction sets.
  void fetch(const JpegLevel& level, const uint32_t x[2], const uint32_t y[2], uint32_t colours[4]);

  uint64_t slots() const { return keys_.size(); }
  uint64_t bytes() const { return slots() * slot_bytes_; }                       // of samples
  uint64_t decoded() const { return decoded_.load(std::memory_order_relaxed); }  // groups so far

 private:
  static constexpr uint64_t kEmpty = ~uint64_t{0};

  struct Set {
    std::atomic<bool> is_held{false};
    uint32_t clock = 0;
  };

  void lock(Set& set);
  const uint8_t* find(uint64_t set, uint64_t key);

  uint64_t ways_;
  uint64_t set_count_;
  uint32_t slot_bytes_;
  std::unique_ptr<Set[]> sets_;
  std::vector<uint64_t> keys_;          // level number << 32 | group
  std::vector<uint32_t> stamps_;        // of the set's clock
  std::unique_ptr<uint8_t[]> samples_;  // memory that nobody looked for is not touched
  std::atomic<uint64_t> decoded_{0};
};

}  // namespace scree::kernels
