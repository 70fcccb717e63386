// The two libraries behind decode_image, check_image and write_png. Both report errors by longjmp: nothing with a
// destructor lives in a frame that a jump may leave.
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

/// `info`: what the probe said, within the limits of decode_image.
Result<Image> decode_png(ImageFile& file, const ImageInfo& info);
Result<Image> decode_jpeg(ImageFile& file, const ImageInfo& info);

/// The same without a picture; they give Image::warning.
Result<std::string> check_png(ImageFile& file, const ImageInfo& info);
Result<std::string> check_jpeg(ImageFile& file, const ImageInfo& info);

}  // namespace scree::runtime
