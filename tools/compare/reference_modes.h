// The two optional roundings of the reference rasteriser (ReferenceMode): of corners and of depths.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "tools/compare/reference_geometry.h"

namespace scree::compare {

/// The depth at pixel (x, y) of the triangle whose corners are rounded to 1 / `snap` of a pixel (even, 2 to 65536);
/// nullopt if its centre is not covered. Parts nearer than the near plane are cut off first. Coverage is exact, and
/// ties are decided as in draw_reference(). 1 / depth (orthographic: the depth) is linear between the rounded corners.
std::optional<double> meet_snapped(const kernels::View& view, const std::array<SeenPoint, 3>& corners, uint32_t x,
                                   uint32_t y, uint32_t snap, bool mirrored, bool double_sided);

/// The middle of all depths with the same code as `depth`, at or beyond the near plane. `bits`: 28 or 32.
double coded_depth(const kernels::View& view, double depth, uint32_t bits);

}  // namespace scree::compare
