// Windows that stay in memory between being measured and being encoded, so that they are read once.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <memory>

#include "tools/convert/windows/window.h"

namespace scree::convert {

/// How much of them there may be. Thread-safe.
class HeldBudget {
 public:
  explicit HeldBudget(uint64_t most_bytes) : most_(most_bytes) {}

  /// From now on there is nothing to be taken.
  void close() { most_.store(0, std::memory_order_relaxed); }

  /// Takes `bytes` where they are left.
  bool take(uint64_t bytes) {
    if (taken_.fetch_add(bytes, std::memory_order_relaxed) + bytes <= most_.load(std::memory_order_relaxed))
      return true;
    give_back(bytes);
    return false;
  }
  void give_back(uint64_t bytes) { taken_.fetch_sub(bytes, std::memory_order_relaxed); }

 private:
  std::atomic<uint64_t> most_;
  std::atomic<uint64_t> taken_{0};
};

/// A place for a window that is loaded with Window::Find::kTriangles.
class HeldWindow {
 public:
  /// `bytes`: at least what the window will take; taken from `budget`, which outlives it.
  HeldWindow(HeldBudget& budget, uint64_t bytes) : budget_(budget), bytes_(bytes) {}
  ~HeldWindow() { budget_.give_back(bytes_); }
  HeldWindow(const HeldWindow&) = delete;
  HeldWindow& operator=(const HeldWindow&) = delete;

  /// Takes the window in, and gives back what it does not need.
  void keep(Window& window) {
    content = window.release();
    const uint64_t needed = std::min(bytes_, sizeof *this + content.bytes());
    budget_.give_back(bytes_ - needed);
    bytes_ = needed;
  }

  WindowContent content;

 private:
  HeldBudget& budget_;
  uint64_t bytes_;
};

}  // namespace scree::convert
