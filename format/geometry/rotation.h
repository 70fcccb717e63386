// The matrix of a quaternion, in one place, because cameras and instances must agree on it.
#pragma once

namespace scree::format {

/// The rotation matrix of a quaternion (xyzw), row by row. Normalises the quaternion: its numbers are rounded in a
/// file, and another program may have written any length. Length 0 gives no rotation.
inline void rotation_matrix(const double q[4], double (&out)[3][3]) {
  const double norm = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3];
  const double k = norm > 0 ? 2 / norm : 0;
  const double x = q[0], y = q[1], z = q[2], w = q[3];
  const double rows[3][3] = {
      {1 - k * (y * y + z * z), k * (x * y - z * w), k * (x * z + y * w)},
      {k * (x * y + z * w), 1 - k * (x * x + z * z), k * (y * z - x * w)},
      {k * (x * z - y * w), k * (y * z + x * w), 1 - k * (x * x + y * y)},
  };
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) out[i][j] = rows[i][j];
}

}  // namespace scree::format
