// A loop over items of uneven cost, shared by threads.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

namespace scree::runtime {

/// Calls body(i) once for every i below `count`, on up to `threads` threads (the caller's is one), in no particular
/// order. An exception of a body ends the loop early and is thrown again here, where the caller turns it into an Error.
template <class Body>
void parallel_for(uint64_t count, uint32_t threads, const Body& body) {
  std::atomic<uint64_t> next{0};
  std::exception_ptr failure;
  std::mutex failure_mutex;
  const auto work = [&] {
    try {
      for (uint64_t i = next++; i < count; i = next++) body(i);
    } catch (...) {
      const std::lock_guard<std::mutex> lock(failure_mutex);
      if (!failure) failure = std::current_exception();
      next = count;
    }
  };
  std::vector<std::thread> helpers;
  try {
    for (uint64_t i = 1; i < std::min<uint64_t>(threads, count); ++i) helpers.emplace_back(work);
  } catch (const std::exception&) {
    // Fewer threads than asked for (a limit of the system) do the same work.
  }
  work();
  for (std::thread& helper : helpers) helper.join();
  if (failure) std::rethrow_exception(failure);
}

}  // namespace scree::runtime
