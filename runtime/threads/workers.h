// Threads for many short loops, for which starting threads would take too long.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

#include "runtime/threads/parallel.h"

namespace scree::runtime {

/// Loops of several threads run one after the other. A loop's body must not begin another loop on the same workers.
class Workers {
 public:
  /// Up to `threads` threads, including the caller's. The others are started by the first loop that has work for them.
  /// A thread that waits for a loop to begin or to end tests that for `spin` before it sleeps: waking it up takes some
  /// ten microseconds.
  explicit Workers(uint32_t threads, std::chrono::microseconds spin = {}) : threads_(threads), spin_(spin) {}
  Workers(const Workers&) = delete;
  Workers& operator=(const Workers&) = delete;
  ~Workers();

  uint32_t count() const { return threads_; }

  /// Starts the other threads now. Returns the number of threads with the caller's: fewer than count() if the system
  /// starts no more.
  uint32_t start();

  /// As parallel_for().
  template <class Body>
  void for_each(uint64_t count, const Body& body) {
    SharedLoop<Body> loop(count, body);
    const std::lock_guard turn(turn_);
    if (count > 1) start();
    if (count > 1 && !helpers_.empty()) {
      share(count - 1, [&] { loop(); });
    } else {
      loop();
    }
    loop.finish();
  }

 private:
  void help();
  template <class Condition>
  void spin_until(const Condition& condition) const;
  /// Calls `work` on this thread, and on up to `helpers` others that wake up before this thread is done. Returns when
  /// all calls have returned.
  void share(uint64_t helpers, const std::function<void()>& work);

  const uint32_t threads_;
  const std::chrono::microseconds spin_;
  std::mutex turn_;  // held by the thread whose loop runs
  std::vector<std::thread> helpers_;
  std::mutex mutex_;
  std::condition_variable loop_begun_;  // a loop has begun, or the workers end
  std::condition_variable all_left_;
  const std::function<void()>* work_ = nullptr;
  // These change only under the mutex. Spinning threads read the atomic ones without it.
  std::atomic<uint64_t> loops_ = 0;    // loops begun so far
  std::atomic<uint64_t> helping_ = 0;  // threads that have joined the last loop and not left
  uint64_t wanted_ = 0;                // threads that may still join it
  std::atomic<bool> is_stopping_ = false;
};

}  // namespace scree::runtime
