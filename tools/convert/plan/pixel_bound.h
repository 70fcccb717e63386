// Converts an error in pixels to an error of positions, for `scree convert --max-error-pixels`.
#pragma once

#include <cstdint>

#include "format/layout.h"

namespace scree::convert {

/// A bound on the position error in a picture of this size and field of view: a vertex that is at least `distance` from
/// the eye's plane is drawn at most `pixels` from its exact position.
struct PixelBound {
  double pixels = 0;      // above 0; 0: no bound
  double distance = 0;    // world units, above 0
  uint32_t width = 1920;  // of the picture, pixels
  uint32_t height = 1080;
  double fov_degrees = 45;  // vertical, above 0 and below 180
};

/// The largest allowed distance between a point and its exact position in world space, in any direction, world units: r
/// = N D / (f sqrt(1 + t^2) + N). N: pixels; D: distance; f = height / (2 tan(fov / 2)): pixels per unit at distance 1;
/// t: the tangent of the angle between the view direction and a corner of the picture. Source: docs/format.md,
/// an error in pixels.
double world_error(const PixelBound& bound);

/// The largest world-space distance that results from a displacement of up to 1 along each axis of object space: the
/// longest image of (+-1, +-1, +-1) under the matrix.
double matrix_gain(const format::MatrixRecord& world);

}  // namespace scree::convert
