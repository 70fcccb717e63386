// The pixels that a box of lattice offsets covers on the screen, and its nearest depth: clusters and groups of clusters
// are culled by them. Conservative: every vertex of the box, as the exact projection (vertex.h) snaps it, lies inside
// the pixels returned here, and no triangle of such vertices has a nearer depth code. Source: spec/rasterization.md,
// culling of clusters.
#pragma once

#include "format/geometry/cluster_layout.h"
#include "kernels/cull/coverage_filter.h"
#include "kernels/cull/depth_pyramid.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

/// How a box lies in the picture: outside; inside, but between pixel centres; over pixel centres.
enum class BoxCoverage : uint32_t { kNone, kBetween, kCenters };

/// A box in offsets from a chunk's position_min.
struct CenteredBox {
  float center[3];
  float extent[3];  // half sides
};

SCREE_HD inline CenteredBox centered_box(const format::ClusterBounds& bounds) {
  CenteredBox box;
  for (int i = 0; i < 3; ++i) {
    box.extent[i] = 0.5f * static_cast<float>(format::bounds_extent(bounds, i));
    box.center[i] = static_cast<float>(format::bounds_min(bounds, i)) + box.extent[i];
  }
  return box;
}

SCREE_HD inline float floor_of(float a) {
#if defined(__CUDA_ARCH__)
  return floorf(a);
#else
  return std::floor(a);
#endif
}

/// The first and last pixel centres of the drawn rows in a CoverageFilter's coordinates.
struct CenterRange {
  float first[2];
  float last[2];
};

SCREE_HD inline CenterRange center_range(const FrameView& view) {
  const int32_t middle[2] = {view.width / 2, view.height / 2};
  return {{static_cast<float>(-middle[0]), static_cast<float>(view.first_row - middle[1])},
          {static_cast<float>(view.width - 1 - middle[0]), static_cast<float>(view.end_row - 1 - middle[1])}};
}

/// Bound on the error of w, as the filter of a chunk computes it for the chunk's vertices.
template <bool kOrthographic>
SCREE_HD inline float w_error(const CoverageFilter& filter) {
  return 2.0f * (kOrthographic ? filter.w_lowest : filter.w_lowest - (1.0f - kBeforeNear));
}

/// The nearest depth code of triangles whose 1/w (orthographic: w) is at most `nearest`, before roundings.
template <bool kOrthographic>
SCREE_HD inline uint32_t nearest_code(float nearest) {
  constexpr float kMore = 1.00001f;  // covers the roundings
  return depth_code<kOrthographic>(fast_min(kOrthographic ? nearest : nearest * kMore, 1.0f));
}

/// Returns kCenters if a triangle whose vertices lie in the box may cover a pixel centre. Fills `out` unless it returns
/// kNone: with the pixel centres that such triangles may cover, or for kBetween with those around the box. `filter`: of
/// the box's whole chunk. `kClips`: returns kNone also for a box outside the view's clipping box.
template <bool kOrthographic, bool kClips = false>
SCREE_HD inline BoxCoverage bound_on_screen(const CoverageFilter& filter, const FrameView& view,
                                            const CenterRange& centers, const CenteredBox& box, ScreenBounds& out) {
  // A filter without an error bound keeps the whole image.
  if (!(filter.slack < 16.0f)) {
    out = {{0, 0, view.width - 1, view.height - 1}, 0};
    return BoxCoverage::kCenters;
  }
  constexpr float kMore = 1.00001f;  // covers the roundings of a sum of terms of one sign
  const float* rows[2] = {filter.u, filter.v};
  const float w_center = fused(filter.w[0], box.center[0],
                               fused(filter.w[1], box.center[1], fused(filter.w[2], box.center[2], filter.w[3])));
  const float w_half_extent = kMore * (fast_abs(filter.w[0]) * box.extent[0] + fast_abs(filter.w[1]) * box.extent[1] +
                                       fast_abs(filter.w[2]) * box.extent[2]);
  const float w_low = w_center - w_half_extent - w_error<kOrthographic>(filter);
  const float w_high = w_center + w_half_extent + w_error<kOrthographic>(filter);
  // Comparisons are written so that NaN keeps the box.
  if constexpr (kOrthographic) {
    if (w_low > 1.0f || w_high < 0.0f) return BoxCoverage::kNone;
  } else {
    if (w_high < 1.0f) return BoxCoverage::kNone;
  }
  const bool in_front = kOrthographic || w_low > 1.0f;
  const float scale = kOrthographic ? 1.0f : 1.0f / w_center;
  const float scale_low = kOrthographic ? 1.0f : 1.0f / w_low;
  BoxCoverage shows = BoxCoverage::kCenters;
  int32_t first[2];
  int32_t last[2];
  for (int axis = 0; axis < 2; ++axis) {
    const float* row = rows[axis];
    const float at = fused(row[0], box.center[0], fused(row[1], box.center[1], fused(row[2], box.center[2], row[3])));
    if (!in_front) {
      // Part of it may lie behind the near plane, so it can only be tested against the planes of the image.
      for (int side = 0; side < 2; ++side) {
        const float limit = side == 0 ? centers.first[axis] : centers.last[axis];
        const float sign = side == 0 ? -1.0f : 1.0f;
        float half_extent = 0;
        for (int i = 0; i < 3; ++i) half_extent += fast_abs(row[i] - limit * filter.w[i]) * box.extent[i];
        const float off = sign * (at - limit * w_center) - kMore * half_extent;
        const float margin =
            2.0f * (filter.slack + (filter.growth + 1e-6f) * (fast_abs(limit) + 1.0f)) * fast_max(w_high, 1.0f);
        if (off > margin) return BoxCoverage::kNone;
      }
      continue;
    }
    const float middle = at * scale;
    float half_extent = 0;
    for (int i = 0; i < 3; ++i) {
      const float along = kOrthographic ? row[i] : fused(-middle, filter.w[i], row[i]);
      half_extent += fast_abs(along) * box.extent[i];
    }
    half_extent = kMore * half_extent * scale_low;
    // The coordinate has an error here, and another where it is drawn.
    const float farthest = fast_abs(middle) + half_extent;
    const float slack = 2.0f * fused(farthest, filter.growth, filter.slack) + farthest * 1e-6f;
    const float low = fast_max(middle - half_extent - slack, centers.first[axis]);
    const float high = fast_min(middle + half_extent + slack, centers.last[axis]);
    if (low > high) return BoxCoverage::kNone;
    float first_center = -floor_of(-low);
    float last_center = floor_of(high);
    if (first_center > last_center) {
      shows = BoxCoverage::kBetween;
      first_center = last_center;
      last_center = first_center + 1.0f;
    }
    const int32_t shift = (axis == 0 ? view.width : view.height) / 2;
    first[axis] = static_cast<int32_t>(first_center) + shift;
    last[axis] = static_cast<int32_t>(last_center) + shift;
  }
  if (!in_front) {
    out = {{0, 0, view.width - 1, view.height - 1}, 0};
    return BoxCoverage::kCenters;
  }
  out.pixels = {first[0], first[1], last[0], last[1]};
  const float nearest = kOrthographic ? w_high : scale_low;
  out.nearest_code = nearest_code<kOrthographic>(nearest);
  if constexpr (kClips) {
    // The middle of a code is at most 2^-23 of a value (orthographic: 2^-28) away from it. Farther than 2^60, all
    // values share a code.
    const float lowest = kOrthographic ? w_low - 1e-6f : w_high < 1e18f ? 1.0f / (w_high * kMore) : 0.0f;
    const float highest = kOrthographic ? w_high + 1e-6f : fast_max(nearest * kMore, 1e-18f);
    if (!samples_may_be_in_clip_box(view.clip_box, view.width, view.height, first[0], first[1], last[0], last[1],
                                    lowest, highest))
      return BoxCoverage::kNone;
  }
  return shows;
}

}  // namespace SCREE_ISA
}  // namespace scree::kernels
