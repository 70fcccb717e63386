#include "tools/view/adaptation.h"

#include <algorithm>

namespace scree::tools::view {

void Adaptation::go_to(size_t level, double now_ms) {
  level_ = level;
  changed_ms_ = now_ms;
  fast_since_ms_ = -1;
  average_ms_[level] = 0;
}

void Adaptation::note(size_t level, double ms, double now_ms) {
  double& average = average_ms_[level];
  average = average == 0 ? ms : 0.7 * average + 0.3 * ms;
  if (level != level_) return;  // the picture was requested before the level changed
  if (now_ms >= lowest_until_ms_) lowest_ = kQualities.size() - 1;

  const bool has_settled = now_ms - changed_ms_ >= kSettleMs;
  const bool has_fewer_pixels = level_ > 0 && kQualities[level_].scale < kQualities[level_ - 1].scale;
  if (has_settled && has_fewer_pixels && average > kSlow && average > kGain * average_ms_[level_ - 1] &&
      average_ms_[level_ - 1] > 0) {
    // The time does not depend on bytes or pixels, so a worse picture would not arrive sooner.
    lowest_ = level_ - 1;
    lowest_until_ms_ = now_ms + kUselessMs;
    return go_to(level_ - 1, now_ms);
  }
  const double stayed_ms = now_ms - changed_ms_;
  if (average > kSlow) {
    fast_since_ms_ = -1;
    if (!has_settled || level_ >= lowest_) return;
    trial_after_ms_ = is_trial_ ? std::min(2 * trial_after_ms_, kRarestTrialMs) : kTrialMs;
    is_trial_ = false;
    return go_to(level_ + 1, now_ms);
  }
  if (is_trial_ && stayed_ms >= kTrialMs) {
    is_trial_ = false;
    trial_after_ms_ = kTrialMs;
  }
  if (average >= kFast) {
    fast_since_ms_ = -1;
    // The level is neither slow nor fast, so after a while the better level is tried: it may have become faster.
    if (level_ == 0 || is_trial_ || stayed_ms < trial_after_ms_) return;
    is_trial_ = true;
    return go_to(level_ - 1, now_ms);
  }
  if (fast_since_ms_ < 0) fast_since_ms_ = now_ms;
  if (now_ms - fast_since_ms_ >= kRiseMs && level_ > 0) go_to(level_ - 1, now_ms);
}

}  // namespace scree::tools::view
