// Clips triangles that cross the near plane (orthographic: or the far one) or leave the guard band, in double
// precision. Source: spec/rasterization.md, clipping.
#pragma once

#include "kernels/raster/setup.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

inline constexpr int kMaxPolygon = 9;  // 3 corners and one more for each of 6 planes

/// A corner of the polygon: homogeneous, in double, and as it is drawn if it is known to be inside.
struct ClipVertex {
  double x;
  double y;
  double w;            // perspective: w; orthographic: t (x and y are then not homogeneous)
  ScreenVertex drawn;  // valid if `snapped`
  bool snapped;        // an original corner inside the planes; drawn exactly as unclipped triangles draw it
};

SCREE_HD inline ClipVertex clip_vertex(const Transform& transform, const double d[3], const ScreenVertex& drawn) {
  ClipVertex out;
  out.x =
      transform.exact_x[0] * d[0] + transform.exact_x[1] * d[1] + transform.exact_x[2] * d[2] + transform.exact_x[3];
  out.y =
      transform.exact_y[0] * d[0] + transform.exact_y[1] * d[1] + transform.exact_y[2] * d[2] + transform.exact_y[3];
  out.w =
      transform.exact_w[0] * d[0] + transform.exact_w[1] * d[1] + transform.exact_w[2] * d[2] + transform.exact_w[3];
  out.drawn = drawn;
  out.snapped = (drawn.flags & kNeedsClip) == 0;
  return out;
}

/// Signed distance to plane 0 to 5: near, far, left, right, top, bottom of the guard band. Inside is >= 0.
template <bool kOrthographic>
SCREE_HD inline double plane_distance(const ClipVertex& v, int plane) {
  const double guard_limit = static_cast<double>(kGuardBand) * (kOrthographic ? 1.0 : v.w);
  switch (plane) {
    case 0:
      return kOrthographic ? 1.0 - v.w : v.w - 1.0;
    case 1:
      return kOrthographic ? v.w : 1.0;
    case 2:
      return guard_limit + v.x;
    case 3:
      return guard_limit - v.x;
    case 4:
      return guard_limit + v.y;
    default:
      return guard_limit - v.y;
  }
}

/// Clips the triangle `v` (3 of kMaxPolygon) against all planes in order. Returns the polygon's corner count, 0 if
/// nothing is left or a coordinate is NaN or out of range. A new corner is always computed from the inside end towards
/// the outside end, so the two triangles of an edge get the same corner.
template <bool kOrthographic>
SCREE_HD inline int clip_polygon(ClipVertex v[kMaxPolygon]) {
  constexpr double kSane = 1e100;
  for (int i = 0; i < 3; ++i) {
    if (!(abs_of(v[i].x) < kSane && abs_of(v[i].y) < kSane && abs_of(v[i].w) < kSane)) return 0;
  }
  int count = 3;
  for (int plane = 0; plane < 6; ++plane) {
    double distance[kMaxPolygon];
    bool all_inside = true;
    for (int i = 0; i < count; ++i) {
      distance[i] = plane_distance<kOrthographic>(v[i], plane);
      // In single precision, which decides for unclipped triangles, this corner is inside.
      if (v[i].snapped) distance[i] = max_of(distance[i], 0.0);
      all_inside = all_inside && distance[i] >= 0;
    }
    if (all_inside) continue;
    ClipVertex cut[kMaxPolygon];
    int cut_count = 0;
    for (int i = 0; i < count; ++i) {
      const int next = i + 1 == count ? 0 : i + 1;
      const bool inside = distance[i] >= 0;
      if (inside && cut_count < kMaxPolygon) cut[cut_count++] = v[i];
      if (inside == (distance[next] >= 0) || cut_count == kMaxPolygon) continue;
      const int from = inside ? i : next;
      const int to = inside ? next : i;
      const double t = distance[from] / (distance[from] - distance[to]);
      ClipVertex& made = cut[cut_count++];
      made.x = v[from].x + t * (v[to].x - v[from].x);
      made.y = v[from].y + t * (v[to].y - v[from].y);
      made.w = v[from].w + t * (v[to].w - v[from].w);
      made.snapped = false;
      if (plane == 0) made.w = 1.0;
      if (plane == 1) made.w = 0.0;
    }
    count = cut_count;
    if (count < 3) return 0;
    for (int i = 0; i < count; ++i) v[i] = cut[i];
  }
  return count;
}

/// Projects and snaps a corner of a clipped polygon.
template <bool kOrthographic>
SCREE_HD inline ScreenVertex snap_clipped(const ClipVertex& v, const FrameView& view) {
  if (v.snapped) return v.drawn;
  const double scale = kOrthographic ? 1.0 : 1.0 / v.w;
  const double guard = static_cast<double>(kGuardBand);
  const double x = min_of(max_of(v.x * scale, -guard), guard);  // clipping leaves an error of an ulp or so
  const double y = min_of(max_of(v.y * scale, -guard), guard);
  const double depth = kOrthographic ? v.w : scale;
  ScreenVertex out;
  out.x = static_cast<int32_t>(round_even(x)) + view.width * (kSubpixels / 2);
  out.y = static_cast<int32_t>(round_even(y)) + view.height * (kSubpixels / 2);
  out.depth = static_cast<float>(min_of(max_of(depth, 0.0), 1.0));
  out.flags = 0;
  return out;
}

/// A convex polygon of up to 4 corners, as they are drawn.
struct NearPolygon {
  ScreenVertex corner[4] = {};
  int count = 0;  // 0: nothing is left

  /// Appends a corner. All indices are known at compile time, so a GPU keeps the corners in registers.
  SCREE_HD void add(const ScreenVertex& vertex) {
    for (int i = 0; i < 4; ++i) {
      if (i == count) corner[i] = vertex;
    }
    ++count;
  }
};

/// clip_polygon() and snap_clipped() without arrays of polygons, for a perspective triangle that crosses only the near
/// plane, as nearly all clipped ones do. Returns false if the general functions are needed.
SCREE_HD inline bool clip_near(const ClipVertex v[3], const FrameView& view, NearPolygon& out) {
  constexpr double kGuard = kGuardBand;
  out.count = 0;
  double distance[3];
  for (int i = 0; i < 3; ++i) {
    // Comparisons are written so that NaN and values out of range fail.
    if (!(abs_of(v[i].x) < 1e30 && abs_of(v[i].y) < 1e30 && abs_of(v[i].w) < 1e30)) return false;
    distance[i] = v[i].snapped ? max_of(v[i].w - 1.0, 0.0) : v[i].w - 1.0;
  }
  for (int i = 0; i < 3; ++i) {
    const int next = i == 2 ? 0 : i + 1;
    const bool inside = distance[i] >= 0;
    if (inside) {
      const double guard_limit = kGuard * v[i].w;
      if (!v[i].snapped && !(abs_of(v[i].x) <= guard_limit && abs_of(v[i].y) <= guard_limit)) return false;
      out.add(snap_clipped<false>(v[i], view));
    }
    if (inside == (distance[next] >= 0)) continue;
    const double from = inside ? distance[i] : distance[next];
    const double t = from / (from - (inside ? distance[next] : distance[i]));
    const double from_x = inside ? v[i].x : v[next].x;
    const double from_y = inside ? v[i].y : v[next].y;
    ClipVertex made;
    made.x = from_x + t * ((inside ? v[next].x : v[i].x) - from_x);
    made.y = from_y + t * ((inside ? v[next].y : v[i].y) - from_y);
    made.w = 1.0;
    made.snapped = false;
    if (!(abs_of(made.x) <= kGuard && abs_of(made.y) <= kGuard)) return false;
    out.add(snap_clipped<false>(made, view));
  }
  return true;
}

}  // namespace SCREE_ISA
}  // namespace scree::kernels
