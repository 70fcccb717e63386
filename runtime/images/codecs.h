// The libraries behind decode_image, check_image and write_png. Those for PNG and JPEG report errors by longjmp, so a
// stack frame that a jump may leave must hold nothing with a destructor.
#pragma once

#include <string>

#include "format/result.h"
#include "runtime/images/image.h"

namespace scree::runtime {

/// Progressive JPEGs may hold any number of scans over the whole picture in a few bytes each. Real files have about
/// ten.
inline constexpr int kMaxJpegScans = 500;

/// Read headers only; `file` must start with the codec's signature. If reading the file failed, their result is
/// invalid, so the caller checks ImageFile::error().
Result<ImageInfo> probe_png(ImageFile& file);
Result<ImageInfo> probe_jpeg(ImageFile& file);
Result<ImageInfo> probe_webp(ImageFile& file);

/// `info`: the result of the probe, within the limits of decode_image.
Result<Image> decode_png(ImageFile& file, const ImageInfo& info);
Result<Image> decode_jpeg(ImageFile& file, const ImageInfo& info);
/// libwebp has the whole file in memory, and up to 5 bytes a pixel beside the picture.
Result<Image> decode_webp(ImageFile& file, const ImageInfo& info);

/// The same checks without a picture. They return Image::warning.
Result<std::string> check_png(ImageFile& file, const ImageInfo& info);
Result<std::string> check_jpeg(ImageFile& file, const ImageInfo& info);

}  // namespace scree::runtime
