// Encodes pictures as JPEG or PNG, in strips on many threads.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "format/result.h"
#include "runtime/threads/workers.h"

namespace scree::tools::view {

/// 8-bit sRGB pixels, rows from the top. `bytes`: width * height * channels of them.
struct PixelView {
  uint32_t width = 0;
  uint32_t height = 0;
  uint32_t channels = 3;  // 3: RGB; 4: RGB and a byte that is ignored
  std::span<const uint8_t> bytes;
};

/// Called before each strip. If it returns true, the encoder stops and returns no bytes.
using IsAbandoned = std::function<bool()>;

/// A baseline JPEG with a restart marker after each strip. The number of threads does not change its bytes. `quality`:
/// 1 to 100. `is_sharp`: colour in full resolution (4:4:4) instead of a quarter (4:2:0). Errors kMemory.
Result<std::vector<std::byte>> encode_jpeg(const PixelView& picture, int quality, bool is_sharp,
                                           runtime::Workers& workers, const IsAbandoned& is_abandoned = {});

/// An RGB PNG, optimised for speed rather than size: each value is stored as the difference to the pixel on its left,
/// and each strip of rows is deflated separately (zlib level 1). Errors kMemory.
Result<std::vector<std::byte>> encode_png(const PixelView& picture, runtime::Workers& workers,
                                          const IsAbandoned& is_abandoned = {});

}  // namespace scree::tools::view
