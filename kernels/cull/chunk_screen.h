// Where a chunk may lie on the screen, its nearest depth there, and whether it is hidden. Needs records only. The
// streamer chooses by it which chunks to load.
#pragma once

#include "kernels/cull/cull.h"
#include "kernels/cull/depth_pyramid.h"
#include "kernels/raster/depth.h"
#include "kernels/raster/vertex.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

SCREE_HD inline uint32_t code_of_depth(double depth, bool orthographic) {
  const auto value = static_cast<float>(min_of(depth, 1.0));
  return orthographic ? depth_code<true>(value) : depth_code<false>(value);
}

/// Finds the bounds of the triangles in a box; false if the whole box is outside the picture. Conservative: single
/// precision has an error of at most 2^-21 of a row's terms (transform.h), less than the slack of may_be_seen() that is
/// used here. One more pixel on each side covers rounding and snapping. A box that reaches the near plane, or that is
/// not finite, may be anywhere.
SCREE_HD inline bool find_screen_bounds(const Transform& transform, const FrameView& view, const RelativeBox& box,
                                        ScreenBounds& bounds) {
  bounds = {{0, 0, view.width - 1, view.height - 1}, 0};
  constexpr double kSlack = 1.0 / (1 << 20);
  constexpr double kHuge = 1e300;  // NaN and infinity are not below it
  const double* rows[3] = {transform.exact_x, transform.exact_y, transform.exact_w};
  double slack[3];
  for (int r = 0; r < 3; ++r) {
    slack[r] = abs_of(rows[r][3]);
    for (int i = 0; i < 3; ++i) slack[r] += abs_of(rows[r][i]) * (abs_of(box.center[i]) + box.extent[i]);
    slack[r] *= kSlack;
  }
  double low[3] = {kHuge, kHuge, kHuge};  // screen x and y in sub-pixels, w
  double high[3] = {-kHuge, -kHuge, -kHuge};
  for (unsigned corner = 0; corner < 8; ++corner) {
    double at[3];
    for (int r = 0; r < 3; ++r) {
      at[r] = rows[r][3];
      for (int i = 0; i < 3; ++i)
        at[r] += rows[r][i] * (box.center[i] + ((corner >> i & 1u) != 0 ? box.extent[i] : -box.extent[i]));
    }
    const double w = view.orthographic ? 1.0 : at[2];
    // Written so that NaN counts as too near.
    if (!view.orthographic && !(w - slack[2] > 1.0)) return true;
    for (int axis = 0; axis < 2; ++axis) {
      const double place = at[axis] / w;
      const double off = (slack[axis] + (view.orthographic ? 0.0 : abs_of(place) * slack[2])) /
                         (view.orthographic ? 1.0 : w - slack[2]);
      if (!(abs_of(place) < kHuge) || !(off < kHuge)) return true;
      low[axis] = min_of(low[axis], place - off);
      high[axis] = max_of(high[axis], place + off);
    }
    low[2] = min_of(low[2], at[2]);
    high[2] = max_of(high[2], at[2]);
  }
  const int32_t size[2] = {view.width, view.height};
  int32_t first[2];
  int32_t last[2];
  for (int axis = 0; axis < 2; ++axis) {
    const double middle = 0.5 * size[axis];
    const double from = floor(low[axis] / kSubpixels + middle) - 1;
    const double to = ceil(high[axis] / kSubpixels + middle) + 1;
    if (from > size[axis] - 1 || to < 0) return false;
    first[axis] = static_cast<int32_t>(max_of(from, 0.0));
    last[axis] = static_cast<int32_t>(min_of(to, size[axis] - 1.0));
  }
  constexpr double kMore = 1.00001;  // covers the roundings of 1 / w
  const double nearest =
      view.orthographic ? high[2] + abs_of(high[2]) * (kMore - 1) + slack[2] : kMore / (low[2] - slack[2]);
  if (!(abs_of(nearest) < kHuge)) return true;
  bounds = {{first[0], first[1], last[0], last[1]}, code_of_depth(nearest, view.orthographic)};
  return true;
}

/// Finds the bounds of a chunk that is drawn with `transform`, that of an instance of its mesh; false if it draws no
/// sample. A chunk of float32 positions has the box of its mesh.
SCREE_HD inline bool find_chunk_bounds(const format::MeshRecord& mesh, const format::ChunkRecord& chunk,
                                       const Transform& transform, const FrameView& view, ScreenBounds& bounds) {
  const RelativeBox box = vertex_box(mesh, chunk, transform);
  return may_be_drawn(transform, view, box) && find_screen_bounds(transform, view, box, bounds);
}

}  // namespace SCREE_ISA
}  // namespace scree::kernels
