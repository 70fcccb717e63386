// Measures elapsed time, on the clock and on the processors.
#pragma once

#include <chrono>

#include <time.h>

namespace scree::runtime {

/// `wall_ms` depends on the other load of the machine. `cpu_ms`, summed over all threads of the process, hardly does.
struct Duration {
  double wall_ms = 0;
  double cpu_ms = 0;
};

/// Runs from its construction on.
class Stopwatch {
 public:
  /// The time since construction.
  Duration elapsed() const {
    const auto wall = std::chrono::steady_clock::now() - wall_;
    return {std::chrono::duration<double, std::milli>(wall).count(), cpu_now_ms() - cpu_ms_};
  }

 private:
  static double cpu_now_ms() {
    timespec now{};
    ::clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    return static_cast<double>(now.tv_sec) * 1e3 + static_cast<double>(now.tv_nsec) * 1e-6;
  }

  std::chrono::steady_clock::time_point wall_ = std::chrono::steady_clock::now();
  double cpu_ms_ = cpu_now_ms();
};

}  // namespace scree::runtime
