// Stage 2: one team per triangle. The lanes share the pixels of its box.
#pragma once

#include <type_traits>

#include "kernels/raster/mask.h"
#include "kernels/raster/queues.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

/// Draws the covered pixels of `box`, at most 2^31 of them, with the lanes of a team. `Int`: as for make_edges(). A
/// lane starts loading several samples before it needs the first, so that the loads overlap. `mask`: NoMask, or the
/// triangle's tests, which are made only where the triangle would be visible.
template <bool kOrthographic, class Int, class Team, class Mask = NoMask>
SCREE_HD inline void draw_box_with_team(Team team, const Target& target, const Triangle& triangle, const PixelBox& box,
                                        int64_t area, const Mask& mask = {}) {
  if constexpr (Team::kDrawsRuns) {
    team.template draw_runs<kOrthographic, Int>(target, triangle, box, area, mask);
  } else {
    using Bits = std::make_unsigned_t<Int>;  // unsigned, so that steps past the box's end wrap
    const Edges<Int> edges = make_edges<Int>(triangle, box.x0, box.y0);
    const DepthPlane plane = make_depth_plane(triangle, area);
    const uint32_t width = static_cast<uint32_t>(box.x1 - box.x0 + 1);
    const uint32_t height = static_cast<uint32_t>(box.y1 - box.y0 + 1);
    // From a lane's pixel to its next: some rows down and columns right, and one more row if that leaves the box.
    const uint32_t rows = team.size() / width;
    const uint32_t columns = team.size() % width;
    uint32_t x = team.rank() % width;
    uint32_t y = team.rank() / width;
    Bits value[3];
    Bits step[3];
    Bits wrap[3];
    for (int i = 0; i < 3; ++i) {
      const Bits step_x = static_cast<Bits>(edges.step_x[i]);
      const Bits step_y = static_cast<Bits>(edges.step_y[i]);
      value[i] = static_cast<Bits>(edges.value[i]) + x * step_x + y * step_y;
      step[i] = columns * step_x + rows * step_y;
      wrap[i] = step_y - width * step_x;
    }
    uint64_t* at = target.row(box.y0 + static_cast<int32_t>(y)) + box.x0 + static_cast<int32_t>(x);
    const uint64_t image_width = static_cast<uint64_t>(target.width);
    while (mask.any(y < height)) {
      constexpr int kBatch = 4;
      uint64_t* sample[kBatch];
      uint64_t drawn[kBatch];
      uint64_t seen[kBatch];
      [[maybe_unused]] uint32_t place[kBatch];  // in the box: y << 16 | x
      for (int k = 0; k < kBatch; ++k) {
        if constexpr (Mask::kTests) place[k] = y << 16 | x;
        const bool covered = (y < height) & (static_cast<Int>(value[0] | value[1] | value[2]) >= 0);
        const float depth = depth_at<Int>(plane, static_cast<Int>(value[1]) + edges.exclusive[1],
                                          static_cast<Int>(value[2]) + edges.exclusive[2]);
        sample[k] = at;
        drawn[k] = covered ? pack_sample(depth_code<kOrthographic>(depth), triangle.id) : kBackground;
        x += columns;
        y += rows;
        at += rows * image_width + columns;
        const bool leaves = x >= width;
        x -= leaves ? width : 0;
        y += leaves ? 1 : 0;
        at += leaves ? image_width - width : 0;
        for (int i = 0; i < 3; ++i) value[i] += step[i] + (leaves ? wrap[i] : Bits{0});
      }
      for (int k = 0; k < kBatch; ++k) seen[k] = drawn[k] != kBackground ? team.load_relaxed(sample[k]) : 0;
      for (int k = 0; k < kBatch; ++k) {
        if constexpr (Mask::kTests) {
          mask.draw(team, target, drawn[k] < seen[k], sample[k], drawn[k],
                    box.x0 + static_cast<int32_t>(place[k] & 0xffffu), box.y0 + static_cast<int32_t>(place[k] >> 16));
        } else {
          if (drawn[k] < seen[k]) team.atomic_min(sample[k], drawn[k]);
        }
      }
    }
  }
}

/// Calls draw(mask) with the tests of a queued triangle's samples: TestedTriangle or NoMask.
template <bool kOrthographic, class Team, bool kMasked, class Draw>
SCREE_HD inline void with_mask(Team team, const MaskSource<kMasked>& masks, const FrameView& view,
                               const Triangle& triangle, const Draw& draw) {
  if constexpr (kMasked) {
    if (triangle.is_masked != 0) {
      MaskPlane plane;
      masks.template make_plane<kOrthographic>(team, view, triangle.id, plane);
      return draw(TestedTriangle{plane, view});
    }
  }
  draw(NoMask{});
}

template <bool kOrthographic, bool kMasked>
struct RasterMedium {
  FrameView view;
  Target target;
  Queues queues;
  uint64_t first;  // the queue entry of item 0
  MaskSource<kMasked> masks;

  template <class Team>
  SCREE_HD void operator()(uint32_t item, Team team) const {
    const Triangle triangle = queues.medium[first + item];
    const PixelBox box = pixel_box(triangle.x, triangle.y, view);
    const int64_t area = doubled_area(triangle.x, triangle.y);
    with_mask<kOrthographic>(team, masks, view, triangle, [&](const auto& mask) {
      if (fits_narrow_edges(triangle.x, triangle.y)) {
        draw_box_with_team<kOrthographic, int32_t>(team, target, triangle, box, area, mask);
      } else {
        draw_box_with_team<kOrthographic, int64_t>(team, target, triangle, box, area, mask);
      }
    });
  }
};

}  // namespace SCREE_ISA
}  // namespace scree::kernels
