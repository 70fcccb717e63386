// Where the reference rasteriser's corners and rays are, as its own parts share it: not for others.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "tools/compare/reference.h"

namespace scree::compare {

/// A point seen from the eye: x to the right, y up, z along the view direction; world units.
struct SeenPoint {
  double x, y, z;
};

/// Where a pixel's ray is at distance 1 (perspective; `scale` is 1 there) or everywhere (orthographic).
struct Ray {
  double x, y;
};

/// Through a pixel's centre; exact where a pixel's size is: centres then lie on edges that go through them.
inline Ray ray_of(const kernels::View& view, uint32_t x, uint32_t y) {
  return {(2.0 * x + 1.0 - view.width) * (view.half_width / view.width),
          (view.height - (2.0 * y + 1.0)) * (view.half_height / view.height)};
}

/// The translation meets the eye first, so that a scene far from the origin loses nothing.
inline SeenPoint seen_from_eye(const kernels::View& view, const ReferenceInstance& instance, const float* position) {
  double p[3];
  for (size_t i = 0; i < 3; ++i) {
    const std::array<double, 4>& row = instance.world[i];
    p[i] = row[0] * static_cast<double>(position[0]) + row[1] * static_cast<double>(position[1]) +
           row[2] * static_cast<double>(position[2]) + (row[3] - view.eye[i]);
  }
  const auto along = [&](const double(&axis)[3]) { return axis[0] * p[0] + axis[1] * p[1] + axis[2] * p[2]; };
  return {along(view.right), along(view.up), along(view.forward)};
}

inline std::array<SeenPoint, 3> seen_corners(const kernels::View& view, const ReferenceMesh& mesh,
                                             const ReferenceInstance& instance, uint64_t triangle) {
  std::array<SeenPoint, 3> out;
  for (size_t n = 0; n < 3; ++n)
    out[n] = seen_from_eye(view, instance, &mesh.positions[3 * uint64_t{mesh.corners[3 * triangle + n]}]);
  return out;
}

/// What the corners count where a ray meets their plane: with q_n the corner's distance from the ray in the plane z =
/// z_n, the cross product of the two others. All of one sign: the ray meets the triangle, from either side; right in
/// perspective and with corners behind the eye. Two triangles of an edge get the same product with the opposite sign,
/// to the bit, so that no centre is in both or in neither.
inline std::array<double, 3> corner_weights(const kernels::View& view, const std::array<SeenPoint, 3>& corners,
                                            Ray ray) {
  Ray q[3];
  for (size_t n = 0; n < 3; ++n) {
    const double scale = view.orthographic ? 1 : corners[n].z;
    q[n] = {corners[n].x - ray.x * scale, corners[n].y - ray.y * scale};
  }
  std::array<double, 3> weights{};
  for (size_t n = 0; n < 3; ++n) {
    const Ray &a = q[(n + 1) % 3], &b = q[(n + 2) % 3];
    weights[n] = a.x * b.y - a.y * b.x;
  }
  return weights;
}

}  // namespace scree::compare
