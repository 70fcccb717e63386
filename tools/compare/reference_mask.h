// Alpha masks of the reference rasteriser. Used only by it.
#pragma once

#include <array>
#include <cstdint>

#include "tools/compare/reference_geometry.h"

namespace scree::compare {

/// Whether the mask of a triangle passes at the centre of a pixel that the triangle covers.
bool mask_passes(const kernels::View& view, const ReferenceMesh& mesh, uint64_t triangle,
                 const std::array<SeenPoint, 3>& corners, uint32_t x, uint32_t y);

}  // namespace scree::compare
