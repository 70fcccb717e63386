// Writes PNGs in strips of rows, on many threads. libpng, which reads them, has no threads and filters more slowly.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "format/container/part_file.h"
#include "format/result.h"
#include "runtime/threads/workers.h"

namespace scree::runtime {

/// 8-bit sRGB pixels, rows from the top without padding.
struct PixelView {
  uint32_t width = 0;  // at least 1, a row at most 2^24 bytes
  uint32_t height = 0;
  uint32_t channels = 3;           // 3: RGB; 4: RGBA, not premultiplied
  std::span<const uint8_t> bytes;  // width * height * channels
};

/// Called before each strip. If it returns true, the encoder stops, and returns or writes no bytes.
using IsAbandoned = std::function<bool()>;

struct PngOptions {
  bool is_small = false;       // tries all filters, not two: 1 to 6% fewer bytes, in two to three times the time
  bool has_alpha = true;       // false: a fourth channel is left out
  Workers* workers = nullptr;  // null: the caller's thread does all the work
  IsAbandoned is_abandoned{};
};

/// A PNG in memory. Strips of about 256 KiB are deflated one by one, so that the number of threads does not change the
/// bytes, which are 0.2% more. Errors kMemory.
Result<std::vector<std::byte>> encode_png(const PixelView& picture, const PngOptions& options = {});

/// For encoders of pictures: appends the lowest 8 bits of each value.
template <class... Values>
void append_bytes(std::vector<std::byte>& out, Values... values) {
  (out.push_back(static_cast<std::byte>(values)), ...);
}

/// Writes a PNG to a file. Errors kFile, kMemory.
Result<void> write_png(const std::string& path, const PixelView& picture, const PngOptions& options = {},
                       format::Existing existing = format::Existing::kReplace);

}  // namespace scree::runtime
