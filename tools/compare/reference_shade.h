// The reference picture in colours: what spec/rasterization.md 9 and 10 say, in double precision and without textures.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "format/result.h"
#include "tools/compare/source_model.h"

namespace scree::compare {

/// Shades `samples`, drawn of `model` by draw_reference() for `view`: base colour factor times vertex colour, lit by
/// the face's normal, black where there is nothing; each block of samples_per_side a side (any number that divides both
/// sides of the view) averaged in linear light and coded as 8-bit sRGB. 3 bytes a pixel, rows top to bottom. The result
/// does not depend on `threads`. Errors kMemory.
Result<std::vector<uint8_t>> shade_reference(const SourceModel& model, std::span<const ReferencePixel> samples,
                                             const kernels::View& view, uint32_t samples_per_side, uint32_t threads);

}  // namespace scree::compare
