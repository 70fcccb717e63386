// Windows that stay in memory between measuring and encoding, so that they are read only once.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <memory>

#include "tools/convert/windows/window.h"

namespace scree::convert {

/// Upper limit of the memory of held windows. Thread-safe.
class HeldBudget {
 public:
  explicit HeldBudget(uint64_t most_bytes) : most_(most_bytes) {}

  /// Ends the budget: from now on take() returns false.
  void close() { most_.store(0, std::memory_order_relaxed); }

  /// Takes `bytes` if that much is left.
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

/// Memory for a window that is loaded with Window::Find::kTriangles.
class HeldWindow {
 public:
  /// `bytes`: at least the window's size; already taken from `budget`, which must outlive this.
  HeldWindow(HeldBudget& budget, uint64_t bytes) : budget_(budget), bytes_(bytes) {}
  ~HeldWindow() { budget_.give_back(bytes_); }
  HeldWindow(const HeldWindow&) = delete;
  HeldWindow& operator=(const HeldWindow&) = delete;

  /// Moves the window's content here, and gives back unneeded bytes.
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
