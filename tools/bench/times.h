// Times of frames: a loop with a time limit, and statistics.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "format/result.h"
#include "runtime/threads/stopwatch.h"

namespace scree::bench {

/// Statistics over several frames, ms.
struct Times {
  double median = 0;
  double minimum = 0;
  double spread = 0;  // largest minus smallest
  double mean = 0;
  double worst = 0;
};

/// `ms`: at least one. The median of an even number is the mean of the middle two.
Times summarize(std::span<const float> ms);

inline constexpr double kTimeBudgetMs = 2000;

/// Draws up to `warmup` frames and then up to `frames` (at least 1): fewer if the warm-up takes longer than a quarter
/// of kTimeBudgetMs, or the frames longer than all of it. `draw_one`: draws one frame and returns its ms as a
/// Result<float>. Returns the times of the frames after the warm-up. Errors of `draw_one`.
template <class DrawOne>
Result<std::vector<float>> timed_frames(uint32_t frames, uint32_t warmup, const DrawOne& draw_one) {
  std::vector<float> times;
  const auto draw_many = [&](uint32_t count, double budget_ms) -> Result<void> {
    const runtime::Stopwatch watch;
    times.clear();
    while (times.size() < count && (times.empty() || watch.elapsed().wall_ms < budget_ms)) {
      times.push_back(SCREE_TRY(draw_one()));
    }
    return {};
  };
  SCREE_TRY(draw_many(warmup, kTimeBudgetMs / 4));
  SCREE_TRY(draw_many(frames, kTimeBudgetMs));
  return times;
}

}  // namespace scree::bench
