// Threads for many short loops, for which starting threads would take too long.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

#include "runtime/threads/parallel.h"

namespace scree::runtime {

/// Must be used by one thread at a time. A loop's body must not begin another loop on the same workers.
class Workers {
 public:
  /// Up to `threads` threads, including the caller's. The others are started by the first loop that has work for them.
  explicit Workers(uint32_t threads) : threads_(threads) {}
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
  /// Calls `work` on this thread, and on up to `helpers` others that wake up before this thread is done. Returns when
  /// all calls have returned.
  void share(uint64_t helpers, const std::function<void()>& work);

  const uint32_t threads_;
  std::vector<std::thread> helpers_;
  std::mutex mutex_;
  std::condition_variable loop_begun_;  // a loop has begun, or the workers end
  std::condition_variable all_left_;
  const std::function<void()>* work_ = nullptr;
  uint64_t loops_ = 0;    // loops begun so far
  uint64_t wanted_ = 0;   // threads that may still join the last loop
  uint64_t helping_ = 0;  // threads that have joined it and not left
  bool is_stopping_ = false;
};

}  // namespace scree::runtime
