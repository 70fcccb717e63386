// Slots of staging memory by number: free ones, and those out of which a copy is running.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <optional>
#include <vector>

namespace scree::runtime {

/// Thread-safe. Every slot that was taken has to come back, by give_back() or by add_copying().
class SlotQueue {
 public:
  struct Taken {
    uint32_t slot;
    bool is_copying;  // its copy has to be waited for
  };

  /// Slots [0, count), all free. To be called once, before all others. Throws std::bad_alloc; no other function does.
  void open(uint32_t count) {
    free_.reserve(count);
    copying_.reserve(count);
    for (uint32_t slot = 0; slot < count; ++slot) free_.push_back(slot);
  }

  /// Waits until there is a slot. Free ones come first, then the others in the order of their copies.
  Taken take() {
    std::unique_lock<std::mutex> lock(mutex_);
    changed_.wait(lock, [this] { return !free_.empty() || !copying_.empty(); });
    const bool is_copying = free_.empty();
    return {take_first(is_copying ? copying_ : free_), is_copying};
  }

  /// The slot of the oldest copy, if any is running.
  std::optional<uint32_t> take_copying() {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (copying_.empty()) return std::nullopt;
    return take_first(copying_);
  }

  /// Gives back a slot of which no copy is running.
  void give_back(uint32_t slot) { add(slot, free_); }
  /// Gives back a slot of which a copy was started.
  void add_copying(uint32_t slot) { add(slot, copying_); }

 private:
  static uint32_t take_first(std::vector<uint32_t>& from) {
    const uint32_t slot = from.front();
    from.erase(from.begin());
    return slot;
  }
  void add(uint32_t slot, std::vector<uint32_t>& to) {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      to.push_back(slot);
    }
    changed_.notify_one();
  }

  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<uint32_t> free_;
  std::vector<uint32_t> copying_;
};

}  // namespace scree::runtime
