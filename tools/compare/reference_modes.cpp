#include "tools/compare/reference_modes.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace scree::compare {
namespace {

using kernels::View;

// Products of coordinates of up to 2^50 do not fit 64 bits.
__extension__ using Wide = __int128;

/// A corner on the snapping grid, y down. `inverse`: 1 / depth (orthographic: the depth), which is linear in the
/// picture.
struct SnappedCorner {
  Wide x, y;
  double inverse;
};

Wide snapped(double pixels, uint32_t snap) {
  constexpr double kFarthest = 0x1p50;
  return static_cast<Wide>(std::clamp(std::nearbyint(pixels * snap), -kFarthest, kFarthest));
}

SnappedCorner snap_corner(const View& view, const SeenPoint& point, uint32_t snap) {
  const double scale = view.orthographic ? 1 : point.z;
  return {snapped((point.x / (scale * view.half_width) + 1) * 0.5 * view.width, snap),
          snapped((1 - point.y / (scale * view.half_height)) * 0.5 * view.height, snap),
          view.orthographic ? point.z : 1 / point.z};
}

/// The part of a triangle beyond the near plane: up to four corners. A cut edge is followed from its far end, so that
/// both of its triangles get the same corner.
struct Polygon {
  std::array<SnappedCorner, 4> corners;
  size_t count = 0;

  void add(const View& view, const SeenPoint& point, uint32_t snap) {
    corners[count++] = snap_corner(view, point, snap);
  }
};

Polygon cut_and_snap(const View& view, const std::array<SeenPoint, 3>& corners, uint32_t snap) {
  Polygon polygon;
  for (size_t n = 0; n < 3; ++n) {
    const SeenPoint &a = corners[n], &b = corners[(n + 1) % 3];
    const bool a_in = view.orthographic || a.z >= view.z_near, b_in = view.orthographic || b.z >= view.z_near;
    if (a_in) polygon.add(view, a, snap);
    if (a_in == b_in) continue;
    const SeenPoint &in = a_in ? a : b, &out = a_in ? b : a;
    const double t = (in.z - view.z_near) / (in.z - out.z);
    polygon.add(view, {in.x + t * (out.x - in.x), in.y + t * (out.y - in.y), view.z_near}, snap);
  }
  return polygon;
}

Wide cross(const SnappedCorner& a, const SnappedCorner& b, Wide x, Wide y) {
  return (b.x - a.x) * (y - a.y) - (b.y - a.y) * (x - a.x);
}

/// 1 / depth (orthographic: depth) at point (x, y) of the grid; nullopt if it is not covered.
std::optional<double> meet_piece(SnappedCorner a, SnappedCorner b, SnappedCorner c, Wide x, Wide y, bool mirrored,
                                 bool double_sided) {
  const Wide area = cross(a, b, c.x, c.y);
  if (area == 0) return std::nullopt;
  // y points down, so counter-clockwise fronts have a negative area.
  if (!double_sided && (area < 0) == mirrored) return std::nullopt;
  if (area < 0) std::swap(b, c);
  const std::array<const SnappedCorner*, 3> corners{&a, &b, &c};
  double sum = 0, total = 0;
  for (size_t n = 0; n < 3; ++n) {
    const SnappedCorner &from = *corners[(n + 1) % 3], &to = *corners[(n + 2) % 3];
    const Wide edge = cross(from, to, x, y);
    const bool owns_ties = to.y < from.y || (to.y == from.y && to.x > from.x);  // left or top
    if (edge < 0 || (edge == 0 && !owns_ties)) return std::nullopt;
    sum += static_cast<double>(edge) * corners[n]->inverse;
    total += static_cast<double>(edge);
  }
  return sum / total;
}

}  // namespace

std::optional<double> meet_snapped(const View& view, const std::array<SeenPoint, 3>& corners, uint32_t x, uint32_t y,
                                   uint32_t snap, bool mirrored, bool double_sided) {
  const Polygon polygon = cut_and_snap(view, corners, snap);
  const Wide centre_x = Wide{x} * snap + snap / 2, centre_y = Wide{y} * snap + snap / 2;
  for (size_t n = 2; n < polygon.count; ++n) {
    const std::optional<double> inverse = meet_piece(polygon.corners[0], polygon.corners[n - 1], polygon.corners[n],
                                                     centre_x, centre_y, mirrored, double_sided);
    if (!inverse) continue;
    const double depth = view.orthographic ? *inverse : std::max(1 / *inverse, view.z_near);
    if (!(depth >= view.z_near) || (view.orthographic && !(depth <= view.z_far))) return std::nullopt;
    return depth;
  }
  return std::nullopt;
}

double coded_depth(const View& view, double depth, uint32_t bits) {
  if (view.orthographic) {
    const double codes = std::ldexp(1.0, static_cast<int>(bits)), range = view.z_far - view.z_near;
    const double code = std::clamp(std::floor((view.z_far - depth) / range * codes), 1.0, codes - 1);
    return view.z_far - (code + 0.5) / codes * range;
  }
  const auto inverse = static_cast<float>(view.z_near / depth);  // at most 1: a float of 23 bits below the first
  if (bits == 32) return view.z_near / static_cast<double>(inverse);
  // 28 bits lack the float's last bit, so two neighbouring values share a code.
  const uint32_t lower = std::bit_cast<uint32_t>(inverse) & ~1u;
  const double middle =
      0.5 * (static_cast<double>(std::bit_cast<float>(lower)) + static_cast<double>(std::bit_cast<float>(lower + 1)));
  return view.z_near / middle;
}

}  // namespace scree::compare
