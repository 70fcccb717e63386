// Chooses the quality of pictures while a viewer moves: the best one that arrives in time.
#pragma once

#include <array>
#include <cstddef>

namespace scree::tools::view {

/// How pictures are made while the camera moves. `scale`: the side of a picture relative to that of the picture at
/// rest.
struct Quality {
  int jpeg;  // 1 to 100
  double scale;
};

/// From best to worst: first lower JPEG quality, then also fewer pixels.
inline constexpr std::array<Quality, 6> kQualities{
    {{88, 1}, {72, 1}, {62, 0.75}, {56, 0.5}, {50, 1.0 / 3}, {40, 0.25}}};

/// One viewer's level in kQualities. Its input is the time of each picture from the start of drawing until it is on the
/// page's screen. It does not read a clock.
class Adaptation {
 public:
  const Quality& quality() const { return kQualities[level_]; }
  size_t level() const { return level_; }

  /// A picture of level `level` took `ms`. `now_ms`: the time by any clock.
  void note(size_t level, double ms, double now_ms);

 private:
  void go_to(size_t level, double now_ms);

  // Above kSlow ms the level gets worse, below kFast better. With 100 ms the camera can still be steered, and a picture
  // of half the size shows more than one of a quarter that arrives 30 ms sooner.
  static constexpr double kSlow = 100;
  static constexpr double kFast = 30;
  static constexpr double kSettleMs = 250;  // least time between two steps to a worse level
  static constexpr double kRiseMs = 1500;   // time of fast pictures before a step to a better level
  static constexpr double kTrialMs = 3000;  // time at a level between kSlow and kFast before the better level is tried
  static constexpr double kRarestTrialMs = 60000;  // the longest such time, after repeated trials that were too slow
  static constexpr double kUselessMs =
      8000;                             // a level that was not faster than the better one is not used for this long
  static constexpr double kGain = 0.9;  // a worse level must take less than this share of the better level's time

  size_t level_ = 1;
  std::array<double, kQualities.size()> average_ms_{};  // 0: unknown
  double changed_ms_ = 0;
  double fast_since_ms_ = -1;
  bool is_trial_ = false;  // the level was too slow before and is tried again
  double trial_after_ms_ = kTrialMs;
  size_t lowest_ = kQualities.size() - 1;
  double lowest_until_ms_ = 0;
};

}  // namespace scree::tools::view
