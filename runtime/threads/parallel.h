// Loops that share items of different lengths among threads.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

namespace scree::runtime {

/// A loop that calls body(i) once for every i below `count`, on all threads that call it. `body` must outlive this.
template <class Body>
class SharedLoop {
 public:
  SharedLoop(uint64_t count, const Body& body) : count_(count), body_(body) {}

  /// Takes items until none is left.
  void operator()() {
    try {
      for (uint64_t i = next_++; i < count_; i = next_++) body_(i);
    } catch (...) {
      const std::lock_guard<std::mutex> lock(failure_mutex_);
      if (!failure_) failure_ = std::current_exception();
      next_ = count_;
    }
  }

  /// Call it when all threads have left the loop. Rethrows an exception of a body, which ended the loop early.
  void finish() {
    if (failure_) std::rethrow_exception(failure_);
  }

 private:
  const uint64_t count_;
  const Body& body_;
  std::atomic<uint64_t> next_{0};
  std::exception_ptr failure_;
  std::mutex failure_mutex_;
};

/// Calls work(true) on the caller's thread and work(false) on up to `threads` - 1 others, and returns when all have
/// returned. The system may start fewer threads, so any number of them must do all the work. Only work(true) may throw.
template <class Work>
void on_threads(uint64_t threads, const Work& work) {
  struct Helpers {
    std::vector<std::thread> threads;
    ~Helpers() {  // also when work(true) throws
      for (std::thread& thread : threads) thread.join();
    }
  } helpers;
  try {
    for (uint64_t i = 1; i < threads; ++i) helpers.threads.emplace_back([&] { work(false); });
  } catch (const std::exception&) {
  }
  work(true);
}

/// Calls body(i) once for every i below `count`, on up to `threads` threads (the caller's is one), in no particular
/// order. An exception of a body ends the loop early and is rethrown here; the caller turns it into an Error.
template <class Body>
void parallel_for(uint64_t count, uint32_t threads, const Body& body) {
  SharedLoop<Body> loop(count, body);
  on_threads(std::min<uint64_t>(threads, count), [&](bool) { loop(); });
  loop.finish();
}

}  // namespace scree::runtime
