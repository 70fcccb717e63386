// Windows that stay in memory between measuring and encoding, so that they are read only once.
#pragma once

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

/// A window that was loaded with Window::Find::kTriangles.
class HeldWindow {
 public:
  /// Moves the window's content here if `budget`, which must outlive this, has room for it; else returns null and
  /// leaves the window as it is.
  static std::unique_ptr<HeldWindow> keep(HeldBudget& budget, Window& window) {
    constexpr uint64_t kOverhead = 512;  // for windows of few triangles
    const uint64_t bytes = kOverhead + window.most_released_bytes();
    if (!budget.take(bytes)) return nullptr;
    return std::make_unique<HeldWindow>(budget, bytes, window.release());
  }

  HeldWindow(HeldBudget& budget, uint64_t bytes, WindowContent held)
      : content(std::move(held)), budget_(budget), bytes_(bytes) {}
  ~HeldWindow() { budget_.give_back(bytes_); }
  HeldWindow(const HeldWindow&) = delete;
  HeldWindow& operator=(const HeldWindow&) = delete;

  WindowContent content;

 private:
  HeldBudget& budget_;
  const uint64_t bytes_;
};

}  // namespace scree::convert
