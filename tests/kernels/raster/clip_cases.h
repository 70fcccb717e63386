// Views with clipping boxes, for the tests of the CPU and the GPU.
#pragma once

#include <algorithm>
#include <array>
#include <random>
#include <vector>

#include "kernels/raster/transform.h"
#include "tests/kernels/scene_builder.h"

namespace scree::tests {

struct CutBox {
  std::array<double, 3> min, max;
};

inline kernels::View clipping(kernels::View view, const CutBox& box) {
  view.clips = true;
  std::copy(box.min.begin(), box.min.end(), view.clip_min);
  std::copy(box.max.begin(), box.max.end(), view.clip_max);
  return view;
}

/// A box between two random points of a cube around the origin.
inline CutBox random_box(std::mt19937& random, double reach) {
  std::uniform_real_distribution<double> place(-reach, reach);
  CutBox box{};
  for (size_t k = 0; k < 3; ++k) {
    const double a = place(random), b = place(random);
    box.min[k] = std::min(a, b);
    box.max[k] = std::max(a, b);
  }
  return box;
}

/// Views with typical boxes (halves, slabs, a corner, a small box, everything, nothing), alternating with views without
/// a box.
inline std::vector<kernels::View> clipped_views(const std::vector<kernels::View>& views) {
  const CutBox boxes[] = {{{-9, -9, -9}, {9, 9, 0.05}},    {{-9, -0.1, -9}, {9, 0.13, 9}},
                          {{-0.3, -9, -0.4}, {9, 9, 0.6}}, {{-0.25, -0.2, -0.3}, {0.3, 0.35, 0.2}},
                          {{-50, -50, -50}, {50, 50, 50}}, {{5, 5, 5}, {6, 6, 6}},
                          {{-9, -9, -9}, {0.123, 0.2, 9}}};
  std::vector<kernels::View> out;
  for (size_t i = 0; i < views.size(); ++i) {
    out.push_back(clipping(views[i], boxes[i % std::size(boxes)]));
    if (i % 3 == 2) out.push_back(views[i]);
  }
  return out;
}

/// Whether the surface at sample `i` lies in the view's box.
inline bool shows_inside(const kernels::View& view, const std::vector<uint64_t>& samples, size_t i) {
  const kernels::FrameView frame = kernels::make_frame_view(view);
  return !kernels::is_cut_away(frame, static_cast<int32_t>(i % view.width), static_cast<int32_t>(i / view.width),
                               samples[i]);
}

}  // namespace scree::tests
