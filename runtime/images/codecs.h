// The libraries behind decode_image and check_image. libpng and libjpeg report errors by longjmp, so a stack
// frame that a jump may leave must hold nothing with a destructor.
#pragma once

#include <string>

#include "format/result.h"
#include "runtime/images/image.h"

namespace scree::runtime {

/// A hostile progressive JPEG can have many scans, each a few bytes long but as slow as a pass over the whole picture.
/// Real files have about ten.
inline constexpr int kMaxJpegScans = 500;

/// Read headers only; `file` must start with the codec's signature. If reading the file failed, the result is invalid,
/// so the caller checks ImageFile::error().
Result<ImageInfo> probe_png(ImageFile& file);
Result<ImageInfo> probe_jpeg(ImageFile& file);
Result<ImageInfo> probe_webp(ImageFile& file);

/// `info`: the result of the probe, within the limits of decode_image.
Result<Image> decode_png(ImageFile& file, const ImageInfo& info);
Result<Image> decode_jpeg(ImageFile& file, const ImageInfo& info);
/// libwebp holds the whole file in memory, and up to 5 bytes per pixel beside the picture.
Result<Image> decode_webp(ImageFile& file, const ImageInfo& info);

/// Make the checks of decode_png() and decode_jpeg() without a picture. Return Image::warning.
Result<std::string> check_png(ImageFile& file, const ImageInfo& info);
Result<std::string> check_jpeg(ImageFile& file, const ImageInfo& info);

}  // namespace scree::runtime
