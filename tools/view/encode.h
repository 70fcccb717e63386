// Pictures as bytes to send, encoded in strips on many threads.
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
  uint32_t channels = 3;  // 3: RGB; 4: RGB and a byte that is left out
  std::span<const uint8_t> bytes;
};

/// Tested before each strip; true ends the work, and the encoder returns no bytes.
using IsAbandoned = std::function<bool()>;

/// A baseline JPEG with a restart marker after each strip, in which every byte is as if one thread had made it.
/// `quality`: 1 to 100. `is_sharp`: full resolution for colour (4:4:4) in place of a quarter (4:2:0). Errors kMemory.
Result<std::vector<std::byte>> encode_jpeg(const PixelView& picture, int quality, bool is_sharp,
                                           runtime::Workers& workers, const IsAbandoned& is_abandoned = {});

/// A PNG of RGB, fast and not small: strips of rows, each the difference to the pixel on the left, deflated apart
/// (zlib's level 1). Errors kMemory.
Result<std::vector<std::byte>> encode_png(const PixelView& picture, runtime::Workers& workers,
                                          const IsAbandoned& is_abandoned = {});

}  // namespace scree::tools::view
