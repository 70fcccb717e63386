// A thread that runs jobs one after another while its owner continues.
#pragma once

#include <condition_variable>
#include <deque>
#include <future>
#include <mutex>
#include <system_error>
#include <thread>
#include <utility>

namespace scree::runtime {

/// Runs jobs that return `Value`, in the order in which they were added. Jobs are added by one thread.
template <class Value>
class JobThread {
 public:
  JobThread() = default;
  JobThread(const JobThread&) = delete;
  JobThread& operator=(const JobThread&) = delete;
  /// Waits for all jobs.
  ~JobThread() {
    if (!thread_.joinable()) return;
    {
      const std::lock_guard lock(mutex_);
      is_stopping_ = true;
    }
    changed_.notify_all();
    thread_.join();
  }

  /// The future has the result or the exception of `job()`. If the system has no thread left, the caller runs the job
  /// at once. Throws std::bad_alloc, in which case the job is not added.
  template <class Job>
  std::future<Value> add(Job&& job) {
    std::packaged_task<Value()> task(std::forward<Job>(job));
    std::future<Value> result = task.get_future();
    if (!thread_.joinable() && !start()) {
      task();
      return result;
    }
    {
      const std::lock_guard lock(mutex_);
      jobs_.push_back(std::move(task));
    }
    changed_.notify_all();
    return result;
  }

  /// Returns when every job is done.
  void wait() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return jobs_.empty() && !is_busy_; });
  }

 private:
  bool start() {
    try {
      thread_ = std::thread([this] { run(); });
      return true;
    } catch (const std::system_error&) {
      return false;
    }
  }

  void run() {
    std::unique_lock lock(mutex_);
    for (;;) {
      changed_.wait(lock, [&] { return is_stopping_ || !jobs_.empty(); });
      if (jobs_.empty()) return;
      std::packaged_task<Value()> job = std::move(jobs_.front());
      jobs_.pop_front();
      is_busy_ = true;
      lock.unlock();
      job();
      job = {};  // destroys the job's captures before it counts as done
      lock.lock();
      is_busy_ = false;
      changed_.notify_all();
    }
  }

  std::mutex mutex_;
  std::condition_variable changed_;  // signals new jobs, a finished job and the end
  std::deque<std::packaged_task<Value()>> jobs_;
  bool is_busy_ = false;
  bool is_stopping_ = false;
  std::thread thread_;
};

}  // namespace scree::runtime
