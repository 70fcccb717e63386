// The square that tests of shading and of whole pictures draw.
#pragma once

#include "tests/kernels/scene_builder.h"

namespace scree::tests {

/// From -1 to 1, facing +z, of two triangles.
inline Soup square() {
  Soup soup;
  soup.add(-1, -1, 0);
  soup.add(1, -1, 0);
  soup.add(1, 1, 0);
  soup.add(-1, 1, 0);
  soup.triangle(0, 1, 2);
  soup.triangle(0, 2, 3);
  return soup;
}

/// With texture coordinates from (u0, v0), top left, to (u1, v1), bottom right.
inline Soup square(double u0, double v0, double u1, double v1) {
  Soup soup = square();
  for (double c : {u0, v1, u1, v1, u1, v0, u0, v0}) soup.uvs.push_back(static_cast<float>(c));
  return soup;
}

}  // namespace scree::tests
