// Vectors in double, for tests of a window's triangles.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <span>

namespace scree::convert {

inline constexpr double kFloatRounding = 1.0 / (1 << 22);  // of a float coordinate: 2 to 4 units in the last place

struct Vector {
  double x, y, z;
};

/// The values from `first` on.
inline Vector vector_at(std::span<const float> values, size_t first) {
  return {values[first], values[first + 1], values[first + 2]};
}
inline Vector operator-(const Vector& a, const Vector& b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
inline Vector operator*(const Vector& a, double scale) {
  return {a.x * scale, a.y * scale, a.z * scale};
}
inline double dot(const Vector& a, const Vector& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
inline Vector cross(const Vector& a, const Vector& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
inline double length(const Vector& v) {
  return std::sqrt(dot(v, v));
}
inline double largest_of(const Vector& v) {
  return std::max({std::fabs(v.x), std::fabs(v.y), std::fabs(v.z)});
}

}  // namespace scree::convert
