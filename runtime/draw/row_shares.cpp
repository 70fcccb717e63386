#include "runtime/draw/row_shares.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace scree::runtime {
namespace {

/// The least time of a share, so that costs stay above 0.
constexpr float kLeastMs = 1e-3f;

float sum(std::span<const float> costs) {
  return std::accumulate(costs.begin(), costs.end(), 0.0f);
}

}  // namespace

void RowShares::divide(uint32_t height, std::span<const float> ms) {
  const auto steps_of = [](uint32_t rows) { return (rows + kStep - 1) / kStep; };
  const uint32_t steps = steps_of(height);
  const size_t count = ms.size();
  if (first_row_.size() != count + 1 || first_row_.back() != height) {
    cost_.assign(steps, 1.0f);
  } else {
    if (++pictures_ < kSettled) return;
    const auto measured = static_cast<float>(std::min(pictures_ - kSettled + 1, kMeanOf));
    for (size_t i = 0; i < count; ++i) mean_ms_[i] += (ms[i] - mean_ms_[i]) / measured;
    const float most = *std::max_element(mean_ms_.begin(), mean_ms_.end());
    if (most * static_cast<float>(count) <= (1 + kVariation / std::sqrt(measured)) * sum(mean_ms_)) return;
    // One factor per share makes the sum of its steps' costs the measured time. The ratios between the steps stay: they
    // are from pictures whose shares ended elsewhere.
    for (size_t i = 0; i < count; ++i) {
      const auto costs = std::span(cost_).subspan(first_row_[i] / kStep).first(steps_of(rows(i).end - rows(i).first));
      const float estimated = sum(costs);
      for (float& cost : costs) cost *= std::max(mean_ms_[i], kLeastMs) / estimated;
    }
  }
  const float all = sum(cost_);
  const size_t not_empty = std::min<size_t>(count, steps);
  pictures_ = 0;
  mean_ms_.assign(count, 0.0f);
  first_row_.assign(count + 1, height);
  first_row_[0] = 0;
  float before = 0;
  uint32_t step = 0;
  for (size_t i = 1; i < not_empty; ++i) {
    const float end = all * static_cast<float>(i) / static_cast<float>(count);
    const uint32_t least = step + 1;
    const auto most = static_cast<uint32_t>(steps - (not_empty - i));
    while (step < least || (step < most && before + cost_[step] / 2 < end)) before += cost_[step++];
    first_row_[i] = step * kStep;
  }
}

}  // namespace scree::runtime
