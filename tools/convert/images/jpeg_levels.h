// The mip levels of an indexed JPEG, each an indexed JPEG itself (spec/container.md, mip levels).
#pragma once

#include <cstddef>
#include <vector>

#include "format/jpeg/index.h"
#include "format/result.h"
#include "runtime/textures/mip_rows.h"

namespace scree::convert {

/// The stored levels of `base` (format::stored_level_count) from the finest on. Each is the box filter of the decoded
/// base level, in linear light for colours, of the values themselves for numbers. It is coded with the base level's
/// colours and sampling and 1.5 times its quantisation steps. Memory: the levels' files, a few rows, and the memory of
/// JpegWriter. Errors kFormat (the base level does not decode), kMemory. Reentrant; the same bytes for the same base.
Result<std::vector<std::vector<std::byte>>> make_jpeg_levels(
    const format::JpegIndex& base, runtime::TexelCoding coding = runtime::TexelCoding::kColor);

}  // namespace scree::convert
