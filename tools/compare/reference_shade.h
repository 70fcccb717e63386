// Shades the reference picture by spec/rasterization.md 9 and 10, in double precision and without textures.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "format/result.h"
#include "tools/compare/source_model.h"

namespace scree::compare {

/// Shades `samples`, drawn from `model` by draw_reference() for `view`: base colour factor times vertex colour, lit by
/// the face's normal; black background. Each block of samples_per_side x samples_per_side (a divisor of both sides of
/// the view) is averaged in linear light and coded as 8-bit sRGB. 3 bytes per pixel, rows top to bottom. The result
/// does not depend on `threads`. Errors kMemory.
Result<std::vector<uint8_t>> shade_reference(const SourceModel& model, std::span<const ReferencePixel> samples,
                                             const kernels::View& view, uint32_t samples_per_side, uint32_t threads);

}  // namespace scree::compare
