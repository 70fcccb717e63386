// The CPU's cache of decoded groups of indexed JPEGs (format/jpeg/pixels.h): of fixed size, kept across frames. An
// absent group is decoded on demand, so the picture does not depend on the cache.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <vector>

#include "kernels/scene_view.h"

namespace scree::kernels {

/// Sets of up to kWays groups. A new group replaces the least recently used one of its set.
class JpegGroupCache {
 public:
  static constexpr uint64_t kWays = 8;

  /// `bytes`: of samples, rounded down to whole slots, at least one. `slot_bytes`: of the largest group, at most 64 *
  /// kJpegMaxGroupBlocks. Throws std::bad_alloc.
  JpegGroupCache(uint64_t bytes, uint32_t slot_bytes);
  JpegGroupCache(const JpegGroupCache&) = delete;
  JpegGroupCache& operator=(const JpegGroupCache&) = delete;

  /// The samples of a group (below the picture's number of groups), decoded if they are absent. They are valid until
  /// release(place). Until then other threads wait for the set, and the calling thread must hold no other group.
  /// `level`: its number, unique in the scene. A group must fit a slot. Thread-safe.
  const uint8_t* hold(const format::JpegPicture& picture, uint32_t level, uint32_t group, uint64_t& place);
  void release(uint64_t place);

  /// The colours of pixels (x[i % 2], y[i / 2]) of a level, as coded, red in the low byte. Looks each group up once,
  /// however many of the pixels lie in it. Groups that do not fit a slot are decoded each time. Not inline, because
  /// both instruction sets share it.
  void fetch(const format::JpegPicture& picture, uint32_t level, const uint32_t x[2], const uint32_t y[2],
             uint32_t colours[4]);

  uint64_t slots() const { return keys_.size(); }
  uint64_t bytes() const { return slots() * slot_bytes_; }                       // of samples
  uint64_t decoded() const { return decoded_.load(std::memory_order_relaxed); }  // groups decoded so far

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
  std::vector<uint32_t> stamps_;        // by the set's clock
  std::unique_ptr<uint8_t[]> samples_;  // unused parts are never touched
  std::atomic<uint64_t> decoded_{0};
};

}  // namespace scree::kernels
