// How good a picture may be while a viewer moves: as good as comes in time over its link, on its machine, from ours.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace scree::tools::view {

/// How pictures are made while the camera moves. `scale`: a side of the picture drawn, of that of the picture at rest.
struct Quality {
  int jpeg;  // 1 to 100
  double scale;
};

/// From the best down: fewer bytes first, then fewer pixels as well.
inline constexpr std::array<Quality, 6> kQualities{
    {{88, 1}, {72, 1}, {62, 0.75}, {56, 0.5}, {50, 1.0 / 3}, {40, 0.25}}};

/// One viewer's place in kQualities. Pictures' times come in, from the start of drawing until the page has it on the
/// screen; no clock is read.
class Adaptation {
 public:
  const Quality& quality() const { return kQualities[level_]; }
  size_t level() const { return level_; }

  /// A picture of level `level` took `ms`; `now_ms`: of any clock.
  void note(size_t level, double ms, double now_ms);

 private:
  void go_to(size_t level, double now_ms);

  // Above kSlow ms one goes down, below kFast up. With 100 ms a movement can still be steered, and a picture of half
  // the size shows more than one of a quarter that comes 30 ms sooner.
  static constexpr double kSlow = 100;
  static constexpr double kFast = 30;
  static constexpr double kSettleMs = 250;    // between two steps down
  static constexpr double kRiseMs = 1500;     // of fast pictures before a step up
  static constexpr double kUselessMs = 8000;  // for which a level below that gained nothing is left alone
  static constexpr double kGain = 0.9;        // of the time above: what a level below has to stay under

  size_t level_ = 1;
  std::array<double, kQualities.size()> average_ms_{};  // 0: not known
  double changed_ms_ = 0;
  double fast_since_ms_ = -1;
  size_t lowest_ = kQualities.size() - 1;
  double lowest_until_ms_ = 0;
};

}  // namespace scree::tools::view
