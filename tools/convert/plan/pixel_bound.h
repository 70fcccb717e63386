// From an error in pixels to an error of positions: what `scree convert --max-error-pixels` asks of a mesh.
#pragma once

#include <cstdint>

#include "format/layout.h"

namespace scree::convert {

/// On a picture of that size and field of view no vertex whose distance from the eye's plane is at least `distance` is
/// drawn more than `pixels` from its place, wherever on the picture it is.
struct PixelBound {
  double pixels = 0;      // above 0; 0: no bound
  double distance = 0;    // world units, above 0
  uint32_t width = 1920;  // of the picture, pixels
  uint32_t height = 1080;
  double fov_degrees = 45;  // vertical, above 0 and below 180
};

/// How far a point may be moved in world space, in any direction, world units: r = N D / (f sqrt(1 + t^2) + N) with N
/// pixels, distance D, f = height / (2 tan(fov / 2)) pixels a unit at distance 1, and t the tangent of the angle
/// between the view direction and a corner of the picture. Source: docs/design.md, Convert.
double world_error(const PixelBound& bound);

/// How far a world matrix moves at most what is moved by up to 1 along each axis of object space: the longest of its
/// images of (+-1, +-1, +-1).
double matrix_gain(const format::MatrixRecord& world);

}  // namespace scree::convert
