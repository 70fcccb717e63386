#include <webp/decode.h>

#include <algorithm>
#include <span>
#include <string>
#include <vector>

#include "runtime/images/codecs.h"
#include "runtime/images/image.h"

namespace scree::runtime {
namespace {

/// Bytes of the file's header and of the first chunk's header. They include size, alpha and animation for every kind of
/// file.
constexpr size_t kHeadBytes = 64;

Error fail(VP8StatusCode status) {
  switch (status) {
    case VP8_STATUS_OUT_OF_MEMORY:
      return {ErrorCode::kMemory, "WebP: out of memory"};
    case VP8_STATUS_NOT_ENOUGH_DATA:
    case VP8_STATUS_SUSPENDED:
      return {ErrorCode::kTruncated, "WebP: ends before its data do"};
    case VP8_STATUS_UNSUPPORTED_FEATURE:
      return {ErrorCode::kUnsupported, "WebP: uses what libwebp " + webp_version() + " does not read"};
    default:
      return {ErrorCode::kFormat, "WebP: is malformed"};
  }
}

const uint8_t* bytes_of(std::span<const std::byte> bytes) {
  return reinterpret_cast<const uint8_t*>(bytes.data());
}

}  // namespace

std::string webp_version() {
  const int version = WebPGetDecoderVersion();
  return std::to_string(version >> 16) + "." + std::to_string(version >> 8 & 255) + "." + std::to_string(version & 255);
}

Result<ImageInfo> probe_webp(ImageFile& file) {
  std::vector<std::byte> head(static_cast<size_t>(std::min<uint64_t>(file.size(), kHeadBytes)));
  SCREE_TRY(file.copy(0, head));
  WebPBitstreamFeatures features;
  if (const VP8StatusCode status = WebPGetFeatures(bytes_of(head), head.size(), &features); status != VP8_STATUS_OK)
    return fail(status);
  if (features.has_animation != 0)
    return Error{ErrorCode::kUnsupported, "WebP: an animation, but glTF has still pictures"};
  if (features.width <= 0 || features.height <= 0) return fail(VP8_STATUS_BITSTREAM_ERROR);
  return ImageInfo{.codec = format::ImageCodec::kPng,
                   .is_webp = true,
                   .width = static_cast<uint32_t>(features.width),
                   .height = static_cast<uint32_t>(features.height),
                   .channels = features.has_alpha != 0 ? 4u : 3u};
}

Result<Image> decode_webp(ImageFile& file, const ImageInfo& info) {
  std::vector<std::byte> copy;
  std::span<const std::byte> bytes = file.from(0);
  if (bytes.size() != file.size()) {
    copy.resize(static_cast<size_t>(file.size()));
    SCREE_TRY(file.copy(0, copy));
    bytes = copy;
  }
  WebPDecoderConfig config;
  if (WebPInitDecoderConfig(&config) == 0) return fail(VP8_STATUS_UNSUPPORTED_FEATURE);
  if (const VP8StatusCode status = WebPGetFeatures(bytes_of(bytes), bytes.size(), &config.input);
      status != VP8_STATUS_OK)
    return fail(status);
  // The probe read only the header. libwebp checks more when it has the whole file.
  if (config.input.width != static_cast<int>(info.width) || config.input.height != static_cast<int>(info.height))
    return fail(VP8_STATUS_BITSTREAM_ERROR);
  Image image{.width = info.width, .height = info.height};
  image.rgba.resize(size_t{4} * info.width * info.height);
  config.output.colorspace = MODE_RGBA;
  config.output.is_external_memory = 1;
  config.output.u.RGBA.rgba = image.rgba.data();
  config.output.u.RGBA.stride = static_cast<int>(4 * info.width);
  config.output.u.RGBA.size = image.rgba.size();
  if (const VP8StatusCode status = WebPDecode(bytes_of(bytes), bytes.size(), &config); status != VP8_STATUS_OK)
    return fail(status);
  return image;
}

}  // namespace scree::runtime
