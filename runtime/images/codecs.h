// The libraries behind decode_image, check_image and write_png. Those of PNG and JPEG report errors by longjmp: nothing
// with a destructor lives in a frame that a jump may leave.
#pragma once

#include <string>

#include "format/result.h"
#include "runtime/images/image.h"

namespace scree::runtime {

/// Progressive JPEGs may hold any number of scans over the whole picture in a few bytes each; real ones have ten or so.
inline constexpr int kMaxJpegScans = 500;

/// Heads only; `file` starts with the codec's signature. What they say of a file whose reading failed is void: the
/// caller looks at ImageFile::error().
Result<ImageInfo> probe_png(ImageFile& file);
Result<ImageInfo> probe_jpeg(ImageFile& file);
Result<ImageInfo> probe_webp(ImageFile& file);

/// `info`: what the probe said, within the limits of decode_image.
Result<Image> decode_png(ImageFile& file, const ImageInfo& info);
Result<Image> decode_jpeg(ImageFile& file, const ImageInfo& info);
/// libwebp has the whole file in memory, and up to 5 bytes a pixel beside the picture.
Result<Image> decode_webp(ImageFile& file, const ImageInfo& info);

/// The same without a picture; they give Image::warning.
Result<std::string> check_png(ImageFile& file, const ImageInfo& info);
Result<std::string> check_jpeg(ImageFile& file, const ImageInfo& info);

}  // namespace scree::runtime
