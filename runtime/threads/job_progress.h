// Reports the progress of a long job to its caller, which may stop the job.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <future>
#include <mutex>
#include <utility>

#include "format/result.h"
#include "runtime/threads/job_thread.h"

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
    return interrupted();
  }

  bool is_stopped() const { return is_stopped_; }

  /// Runs `job()`, a function that returns Result<void>, on a thread of its own and returns its result, or throws its
  /// exception. Until the job ends, the calling thread calls the listener. So a job that holds a lock never waits for a
  /// listener that takes the same lock. Error as advance() if the listener stops the job, even when the job is already
  /// done. Throws std::bad_alloc.
  template <class Job>
  Result<void> relay(const Job& job) {
    is_relayed_ = true;
    JobThread<Result<void>> thread;
    std::future<Result<void>> ended = thread.add([&] {
      const RelayEnd end{*this};
      return job();
    });
    std::unique_lock<std::mutex> lock(relay_mutex_);
    for (;;) {
      relay_changed_.wait(lock, [&] { return !is_relayed_ || !reports_.empty(); });
      if (reports_.empty()) break;
      const Report next = reports_.front();
      reports_.pop_front();
      lock.unlock();
      call(next);
      lock.lock();
    }
    lock.unlock();
    Result<void> result = ended.get();
    if (result && is_stopped_) result = interrupted();
    return result;
  }

 private:
  struct Report {
    const char* stage;
    uint64_t done;
    uint64_t total;
  };
  struct RelayEnd {
    JobProgress& progress;
    ~RelayEnd() {
      const std::lock_guard<std::mutex> lock(progress.relay_mutex_);
      progress.is_relayed_ = false;
      progress.relay_changed_.notify_all();
    }
  };

  using Clock = std::chrono::steady_clock;

  static Error interrupted() { return {ErrorCode::kFile, "interrupted"}; }

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
    const Report report{stage_, done, total_};
    if (!is_relayed_) return call(report);
    const std::lock_guard<std::mutex> lock(relay_mutex_);
    // A slow listener gets the beginning of each stage and the latest report.
    if (!reports_.empty() && reports_.back().stage == stage_ && reports_.back().done != 0)
      reports_.back() = report;
    else
      reports_.push_back(report);
    relay_changed_.notify_all();
  }

  void call(const Report& report) {
    if (!is_stopped_ && !listener_(report.stage, report.done, report.total)) is_stopped_ = true;
  }

  Listener listener_;
  const char* stage_ = "";
  uint64_t total_ = 0;
  std::atomic<uint64_t> done_{0};
  std::atomic<bool> is_stopped_{false};
  std::mutex mutex_;  // for the listener and last_
  Clock::time_point last_{};
  std::atomic<bool> is_relayed_{false};
  std::mutex relay_mutex_;  // for reports_
  std::condition_variable relay_changed_;
  std::deque<Report> reports_;  // not yet passed to the listener; only used by relay()
};

}  // namespace scree::runtime
