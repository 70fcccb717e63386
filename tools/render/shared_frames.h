// The frames of a film that the ranks of a host draw: each rank takes its next frame when it is free.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

namespace scree::tools {

/// Two ranks share an interval of frames. One takes them from the first on, the other from the last back, so that each
/// draws neighbouring frames until they meet: a GPU draws faster if the camera has moved little. A rank whose interval
/// is empty takes frames of the interval that has the most left.
class SharedFrames {
 public:
  /// The number of words that `ranks` ranks need.
  static size_t words(uint32_t ranks) { return intervals(ranks) + 1; }

  /// `words`: shared by the ranks, words(ranks) of them, 0 before the first rank begins. `frames`: below 2^32. `rank`:
  /// below `ranks`.
  SharedFrames(std::span<std::atomic<uint64_t>> words, uint64_t frames, uint32_t rank, uint32_t ranks)
      : words_(words), frames_(frames), rank_(rank), ranks_(ranks) {}

  /// The index of a frame that no rank has taken; none if all are taken.
  std::optional<uint64_t> take() {
    for (uint32_t interval = rank_ / 2;;) {
      if (const std::optional<uint64_t> taken = take_from(interval)) return taken;
      uint64_t most = 0;
      for (uint32_t i = 0; i < intervals(ranks_); ++i) {
        if (left(i) <= most) continue;
        most = left(i);
        interval = i;
      }
      if (most == 0) return std::nullopt;
    }
  }

  /// Whether frames are left that no rank has taken.
  bool has_left() const {
    for (uint32_t i = 0; i < intervals(ranks_); ++i)
      if (left(i) != 0) return true;
    return false;
  }

  /// Counts a frame that is written. Returns the number that all ranks have written.
  uint64_t count_written() { return words_[intervals(ranks_)].fetch_add(1) + 1; }

 private:
  static uint32_t intervals(uint32_t ranks) { return (ranks + 1) / 2; }
  uint64_t begin(uint32_t interval) const { return frames_ * std::min(2 * interval, ranks_) / ranks_; }
  uint64_t size(uint32_t interval) const { return begin(interval + 1) - begin(interval); }
  /// A word counts the frames that were taken from the front (low half) and from the back (high half).
  static uint64_t front(uint64_t word) { return word & UINT32_MAX; }
  static uint64_t back(uint64_t word) { return word >> 32; }
  uint64_t left(uint32_t interval) const {
    const uint64_t word = words_[interval];
    return size(interval) - front(word) - back(word);
  }

  std::optional<uint64_t> take_from(uint32_t interval) {
    const bool takes_front = rank_ % 2 == 0;
    uint64_t word = words_[interval];
    do {
      if (front(word) + back(word) == size(interval)) return std::nullopt;
    } while (!words_[interval].compare_exchange_weak(word, word + (takes_front ? 1 : uint64_t{1} << 32)));
    return takes_front ? begin(interval) + front(word) : begin(interval + 1) - 1 - back(word);
  }

  std::span<std::atomic<uint64_t>> words_;
  uint64_t frames_;
  uint32_t rank_;
  uint32_t ranks_;
};
static_assert(std::atomic<uint64_t>::is_always_lock_free);  // ranks are processes

}  // namespace scree::tools
