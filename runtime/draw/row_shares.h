// The rows of a picture that each of several GPUs draws. They are divided by the times of earlier pictures, so that all
// GPUs take equally long.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "kernels/frame.h"

namespace scree::runtime {

class RowShares {
 public:
  /// All shares but the last one end at multiples of this: the most samples per side of a pixel.
  static constexpr uint32_t kStep = 4;

  /// Divides `height` rows of samples, at least 1. `ms`: for each share the time that its rows of the last picture
  /// took. If that picture had another height, all shares get equally many rows. Otherwise rows move only if the last
  /// kSettled pictures had the same rows, and a share then takes longer than the mean of all shares by more than the
  /// times vary. A share is empty only if there are more shares than steps.
  void divide(uint32_t height, std::span<const float> ms);

  /// A row that moves at first takes its new GPU many times as long: the GPU has no hints of clusters there, so no
  /// cluster is hidden. After this many pictures the hints are right again.
  static constexpr uint32_t kSettled = 6;
  /// How far the longest time of one picture may exceed the mean of all shares by chance. The mean of n pictures may
  /// exceed it by this divided by the root of n. So large differences are corrected at once, and small ones later.
  static constexpr float kVariation = 0.04f;
  /// The most pictures of which a mean is taken. Later ones are added with the weight of one in so many.
  static constexpr uint32_t kMeanOf = 32;

  /// The rows of a share, by the last divide().
  kernels::RowRange rows(size_t share) const { return {first_row_[share], first_row_[share + 1]}; }

 private:
  std::vector<uint32_t> first_row_;  // of each share, then the height
  std::vector<float> cost_;          // of each step, estimated
  std::vector<float> mean_ms_;       // of each share, since the hints are right
  uint32_t pictures_ = 0;            // that have had these rows
};

}  // namespace scree::runtime
