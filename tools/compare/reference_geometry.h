// The geometry of corners and rays in the reference rasteriser. Used only by reference*.cpp.
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

/// The position of a pixel's ray at distance 1 (perspective) or at any distance (orthographic).
struct Ray {
  double x, y;
};

/// The ray through a pixel's centre. It is exact if the pixel's size is exact, so edges through centres really contain
/// them.
inline Ray ray_of(const kernels::View& view, uint32_t x, uint32_t y) {
  return {(2.0 * x + 1.0 - view.width) * (view.half_width / view.width),
          (view.height - (2.0 * y + 1.0)) * (view.half_height / view.height)};
}

/// The eye is subtracted from the translation first, so that a scene far from the origin loses no precision.
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

/// The weights of the corners at the point where a ray hits the triangle's plane. q_n is corner n's offset from the ray
/// in the plane z = z_n; the weight of a corner is the cross product of the other two offsets. If all have the same
/// sign, the ray hits the triangle, from either side. This also holds in perspective and with corners behind the eye.
/// Two triangles with a common edge get exactly opposite weights for it, so that a centre is never in both or in
/// neither.
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
