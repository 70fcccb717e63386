// Threads that share loops one after another: for loops too short to start threads for each.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

#include "runtime/threads/parallel.h"

namespace scree::runtime {

/// Used by one thread at a time; a loop's body must not begin another on them.
class Workers {
 public:
  /// Up to `threads` of them, the caller's with them; the others are started by the first loop that has work for them.
  explicit Workers(uint32_t threads) : threads_(threads) {}
  Workers(const Workers&) = delete;
  Workers& operator=(const Workers&) = delete;
  ~Workers();

  uint32_t count() const { return threads_; }

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
  void start();
  void help();
  /// Calls `work` on this thread and on up to `helpers` others, those that wake before it is done here; returns when
  /// all have returned from it.
  void share(uint64_t helpers, const std::function<void()>& work);

  const uint32_t threads_;
  std::vector<std::thread> helpers_;
  std::mutex mutex_;
  std::condition_variable begun_;  // a loop, or the end
  std::condition_variable left_;
  const std::function<void()>* work_ = nullptr;
  uint64_t loops_ = 0;    // begun so far
  uint64_t wanted_ = 0;   // threads that may still join the last
  uint64_t helping_ = 0;  // threads that have joined it and not left
  bool ends_ = false;
};

}  // namespace scree::runtime
