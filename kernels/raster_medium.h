// Stage 2: one team a triangle, lanes over the pixels of its box.
#pragma once

#include "kernels/queues.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

/// Draws the covered pixels of `box` with the lanes of a team. `Int`: make_edges().
template <bool kOrthographic, class Int, class Team>
SCREE_HD inline void draw_box_with_team(Team team, const Target& target, const Triangle& triangle, const PixelBox& box,
                                        int64_t area) {
  if constexpr (Team::kDrawsRuns) {
    team.template draw_runs<kOrthographic, Int>(target, triangle, box, area);
    return;
  }
  const Edges<Int> edges = make_edges<Int>(triangle, box.x0, box.y0);
  const DepthPlane plane = make_depth_plane(triangle, area);
  const uint32_t width = static_cast<uint32_t>(box.x1 - box.x0 + 1);
  const uint32_t height = static_cast<uint32_t>(box.y1 - box.y0 + 1);
  for (uint32_t y = team.rank() / width, x = team.rank() % width; y < height;) {
    const Int column = static_cast<Int>(x);
    const Int row = static_cast<Int>(y);
    const Int value0 = edges.value[0] + column * edges.step_x[0] + row * edges.step_y[0];
    const Int value1 = edges.value[1] + column * edges.step_x[1] + row * edges.step_y[1];
    const Int value2 = edges.value[2] + column * edges.step_x[2] + row * edges.step_y[2];
    if ((value0 | value1 | value2) >= 0) {
      const float depth = depth_at<Int>(plane, value1 + edges.exclusive[1], value2 + edges.exclusive[2]);
      team.keep_min(target.row(box.y0 + static_cast<int32_t>(y)) + box.x0 + static_cast<int32_t>(x),
                    pack_sample(depth_code<kOrthographic>(depth), triangle.id));
    }
    for (x += team.size(); x >= width; x -= width) ++y;
  }
}

template <bool kOrthographic>
struct RasterMedium {
  FrameView view;
  Target target;
  Queues queues;
  uint64_t first;  // queue entry of item 0

  template <class Team>
  SCREE_HD void operator()(uint32_t item, Team team) const {
    const Triangle triangle = queues.medium[first + item];
    const PixelBox box = pixel_box(triangle.x, triangle.y, view);
    const int64_t area = doubled_area(triangle.x, triangle.y);
    if (fits_narrow_edges(triangle.x, triangle.y)) {
      draw_box_with_team<kOrthographic, int32_t>(team, target, triangle, box, area);
    } else {
      draw_box_with_team<kOrthographic, int64_t>(team, target, triangle, box, area);
    }
  }
};

}  // namespace SCREE_ISA
}  // namespace scree::kernels
