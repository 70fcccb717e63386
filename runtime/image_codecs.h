// The two libraries behind decode_image and write_png. Both report errors by longjmp: nothing with a destructor lives
// in a frame that a jump may leave.
#pragma once

#include <cstddef>
#include <span>

#include "format/result.h"
#include "runtime/image.h"

namespace scree::runtime {

/// Heads only; `file` starts with the codec's signature.
Result<ImageInfo> probe_png(std::span<const std::byte> file);
Result<ImageInfo> probe_jpeg(std::span<const std::byte> file);

/// `info`: what the probe said, within the limits of decode_image.
Result<Image> decode_png(std::span<const std::byte> file, const ImageInfo& info);
Result<Image> decode_jpeg(std::span<const std::byte> file, const ImageInfo& info);

}  // namespace scree::runtime
