// Reports the progress of a long job to its caller, who may stop it.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <mutex>
#include <utility>

#include "format/result.h"

namespace scree::runtime {

/// Any thread of a job calls advance(). The listener is called by one thread at a time, at the beginning and the end of
/// a stage and about every 50 ms in between.
class JobProgress {
 public:
  /// `stage`: "geometry", "textures", "upload" and the like. `done` of `total` bytes or items are done. Returns whether
  /// the job should continue.
  using Listener = std::function<bool(const char* stage, uint64_t done, uint64_t total)>;

  explicit JobProgress(Listener listener) : listener_(std::move(listener)) {}

  /// Begins a stage, while no thread advances. `stage` must stay valid as long as this.
  void begin(const char* stage, uint64_t total) {
    stage_ = stage;
    total_ = total;
    done_ = 0;
    report(0);
  }

  /// Adds `count` to the stage's progress. Error kFile, "interrupted": the job has to stop. `progress` is null if there
  /// is no listener.
  static Result<void> advance(JobProgress* progress, uint64_t count) {
    if (progress == nullptr || progress->advance(count)) return {};
    return Error{ErrorCode::kFile, "interrupted"};
  }

  bool is_stopped() const { return is_stopped_; }

 private:
  using Clock = std::chrono::steady_clock;

  bool advance(uint64_t count) {
    const uint64_t done = done_.fetch_add(count) + count;
    if (done >= total_) {
      const std::lock_guard<std::mutex> last(mutex_);
      report(done);
    } else if (std::unique_lock<std::mutex> free(mutex_, std::try_to_lock); free) {
      if (Clock::now() - last_ >= std::chrono::milliseconds(50)) report(done);
    }
    return !is_stopped_;
  }

  void report(uint64_t done) {
    last_ = Clock::now();
    if (!is_stopped_ && !listener_(stage_, done, total_)) is_stopped_ = true;
  }

  Listener listener_;
  const char* stage_ = "";
  uint64_t total_ = 0;
  std::atomic<uint64_t> done_{0};
  std::atomic<bool> is_stopped_{false};
  std::mutex mutex_;  // for the listener and last_
  Clock::time_point last_{};
};

}  // namespace scree::runtime
