#include "tools/convert/plan/pixel_bound.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace scree::convert {

double world_error(const PixelBound& bound) {
  const double half = std::tan(bound.fov_degrees * std::numbers::pi / 360);
  const double focal = bound.height / (2 * half);
  const double corner = half * std::hypot(1.0, static_cast<double>(bound.width) / bound.height);
  return bound.pixels * bound.distance / (focal * std::hypot(1.0, corner) + bound.pixels);
}

double matrix_gain(const format::MatrixRecord& world) {
  double longest = 0;
  for (int signs = 0; signs < 4; ++signs) {  // the other four vectors are the opposites of these
    const double y = (signs & 1) != 0 ? -1 : 1, z = (signs & 2) != 0 ? -1 : 1;
    double image[3];
    for (int i = 0; i < 3; ++i) image[i] = world.rows[i][0] + y * world.rows[i][1] + z * world.rows[i][2];
    longest = std::max(longest, std::hypot(image[0], image[1], image[2]));
  }
  return longest;
}

}  // namespace scree::convert
