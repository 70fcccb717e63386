// Small scenes for the reference rasteriser, with one pixel per unit.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

#include "tests/results.h"
#include "tools/compare/reference.h"

namespace scree::tests {

/// A camera at (0, 0, 8) that looks along -z, with one pixel per unit and the origin in the picture's middle.
inline kernels::View pixel_view(uint32_t width, uint32_t height) {
  kernels::View view{};
  view.eye[2] = 8;
  view.right[0] = view.up[1] = 1;
  view.forward[2] = -1;
  view.orthographic = true;
  view.half_width = 0.5 * width;
  view.half_height = 0.5 * height;
  view.z_near = 1;
  view.z_far = 100;
  view.width = width;
  view.height = height;
  return view;
}

/// As pixel_view(), with perspective: one pixel per unit at z = 0.
inline kernels::View deep_view(uint32_t width, uint32_t height) {
  kernels::View view = pixel_view(width, height);
  view.orthographic = false;
  view.half_width /= 8;
  view.half_height /= 8;
  return view;
}

inline compare::ReferenceInstance identity(uint32_t mesh = 0) {
  compare::ReferenceInstance instance{mesh, {}};
  for (size_t i = 0; i < 3; ++i) instance.world[i][i] = 1;
  return instance;
}

/// The picture of one mesh.
inline std::vector<compare::ReferencePixel> draw_reference(const compare::ReferenceMesh& mesh,
                                                           const kernels::View& view,
                                                           std::span<const compare::ReferenceInstance> instances,
                                                           const compare::ReferenceMode& mode = {},
                                                           uint32_t threads = 2) {
  return must(compare::draw_reference({&mesh, 1}, instances, view, threads, mode));
}

inline uint64_t covered(std::span<const compare::ReferencePixel> pixels) {
  return static_cast<uint64_t>(std::count_if(
      pixels.begin(), pixels.end(), [](const compare::ReferencePixel& pixel) { return !pixel.is_background(); }));
}

/// Indices of a square whose points are given in counter-clockwise order.
inline const std::vector<uint32_t> kSquareCorners{0, 1, 2, 0, 2, 3};

}  // namespace scree::tests
