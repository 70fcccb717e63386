// Selects the error to report when several threads fail.
#pragma once

#include <atomic>
#include <cstdint>
#include <mutex>
#include <utility>

#include "format/result.h"

namespace scree::runtime {

/// The error of the lowest place, from any thread, so that it is the same for any number of threads. Thread-safe except
/// error().
class FirstError {
 public:
  /// Records an error, unless an error of an earlier or the same place is recorded.
  void report(uint64_t place, Error error) {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (place >= place_.load()) return;
    place_ = place;
    error_ = std::move(error);
  }
  /// Whether an earlier place has failed, so that an error of this place would be ignored.
  bool is_superseded(uint64_t place) const { return place > place_.load(); }
  bool any() const { return place_.load() != kNoPlace; }
  const Error& error() const { return error_; }

 private:
  static constexpr uint64_t kNoPlace = ~uint64_t{0};
  std::mutex mutex_;
  std::atomic<uint64_t> place_{kNoPlace};
  Error error_{ErrorCode::kFormat, {}};
};

}  // namespace scree::runtime
