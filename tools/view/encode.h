// Encodes pictures as JPEGs, in strips on many threads.
#pragma once

#include <cstddef>
#include <vector>

#include "format/result.h"
#include "runtime/images/png_writer.h"
#include "runtime/threads/workers.h"

namespace scree::tools::view {

using runtime::IsAbandoned;
using runtime::PixelView;

/// A baseline JPEG with a restart marker after each strip, without alpha. The number of threads decides the strips, but
/// changes no coefficient. `quality`: 1 to 100. `is_sharp`: colour in full resolution (4:4:4) instead of a quarter
/// (4:2:0). Errors kMemory.
Result<std::vector<std::byte>> encode_jpeg(const PixelView& picture, int quality, bool is_sharp,
                                           runtime::Workers& workers, const IsAbandoned& is_abandoned = {});

}  // namespace scree::tools::view
