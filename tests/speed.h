// For the speed tests, with the label `speed`. They run only in release builds, and measure processor time, because the
// machine may have other load.
#pragma once

#include <time.h>

#include <algorithm>
#include <cstdint>
#include <fstream>
#include <string>
#include <vector>

#include "tests/catch.h"

namespace scree::tests {

/// Processor seconds of all threads of this process.
inline double cpu_seconds() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

/// The other load of this machine, from /proc/stat.
struct OtherWork {
  long running = 0;  // threads other than the calling one
  long stolen = 0;   // ticks for which a virtual machine did not get its processor

  static OtherWork now() {
    OtherWork work;
    std::ifstream stat("/proc/stat");
    for (std::string word; stat >> word;) {
      if (word == "procs_running" && stat >> work.running) --work.running;
      if (word != "cpu") continue;
      for (int column = 0; column < 8; ++column) stat >> work.stolen;  // the eighth column is the steal time
    }
    return work;
  }
};

/// How many times slower this core is now than the reference core of the limits, a quiet guest of a 3.8 GHz Xeon
/// (Cascade Lake); at least 1. The maximum of two measurements: sorting, for branches and near caches; and filling,
/// copying and gathering from fresh memory, for the kernel's page handling and the far caches.
inline double slowness() {
  constexpr double kSortSeconds = 0.0555, kMemorySeconds = 0.0855;
  uint32_t state = 1;
  const auto next = [&state] {
    state ^= state << 13;
    state ^= state >> 17;
    return state ^= state << 5;
  };
  const double start = cpu_seconds();
  std::vector<uint32_t> numbers(1 << 20);
  std::generate(numbers.begin(), numbers.end(), next);
  std::sort(numbers.begin(), numbers.end());
  const double sorted = cpu_seconds();
  std::vector<uint32_t> memory(1 << 24, numbers[0]);
  const std::vector<uint32_t> copy(memory);
  uint32_t sum = 0;
  for (int i = 0; i < 1 << 20; ++i) sum += copy[next() >> 8];
  const double gathered = cpu_seconds();
  CHECK(sum == numbers[0] << 20);  // keeps the compiler from removing the work
  return std::max({1.0, (sorted - start) / kSortSeconds, (gathered - sorted) / kMemorySeconds});
}

/// Checks that `attempt` returns (seconds, or seconds per item) at most `enough`, scaled by slowness(). The best of
/// `attempts` attempts counts. Processor time also includes the slowdown by another thread on the same core, which
/// takes half of its units and caches: a factor of 2.2 was measured. So exceeding the limit is a failure only if an
/// attempt began and ended with no other thread running.
template <class Attempt>
void check_speed(int attempts, double enough, const Attempt& attempt) {
  double best = 1e300;
  double slower = slowness();
  bool is_judged = false;
  for (int i = 0; i < attempts && best > enough; ++i) {
    const OtherWork before = OtherWork::now();
    const double seconds = attempt();
    const OtherWork after = OtherWork::now();
    const double slower_after = slowness();
    best = std::min(best, seconds / std::max(slower, slower_after));
    slower = slower_after;
    is_judged |= before.running <= 0 && after.running <= 0 && before.stolen == after.stolen;
  }
  if (best <= enough || is_judged) {
    INFO("this core takes " << slower << " times as long as the reference core, by which times are divided");
    CHECK(best <= enough);
  } else {
    WARN("not judged, because other threads were running: the best was " << best << ", the limit is " << enough);
  }
}

}  // namespace scree::tests
