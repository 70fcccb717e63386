// The mip levels of an indexed JPEG, each an indexed JPEG itself (spec/container.md, mip levels).
#pragma once

#include <cstddef>
#include <vector>

#include "format/jpeg/index.h"
#include "format/result.h"
#include "runtime/textures/mip_rows.h"

namespace scree::runtime {

/// The stored levels of `base` (format::stored_level_count) from the finest on, each the box filter of the base level
/// as it decodes, in linear light or of the numbers, coded with the base level's colours and sampling and 1.5 times its
/// quantisation steps. Streams: holds the levels' files, a few rows, and what JpegWriter holds. Errors kFormat (the
/// base level does not decode), kMemory. Reentrant; the same bytes for the same base.
Result<std::vector<std::vector<std::byte>>> make_jpeg_levels(const format::JpegIndex& base,
                                                             TexelCoding coding = TexelCoding::kColor);

}  // namespace scree::runtime
