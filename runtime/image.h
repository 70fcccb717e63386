// Pictures in and out: PNG and JPEG decoding, PNG, PFM and raw writing. Every writer goes through `path`.part and a
// rename, so that nobody sees half a picture.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "format/layout.h"
#include "format/result.h"

namespace scree::runtime {

/// What the head of an image file says.
struct ImageInfo {
  format::ImageCodec codec;
  uint32_t width;  // pixels, at least 1
  uint32_t height;
  uint32_t channels;  // 1 grey, 2 grey and alpha, 3 colour, 4 colour and alpha (PNG) or CMYK (JPEG)
};

/// Reads the size of a PNG or JPEG file from its head; decodes nothing, allocates nothing. `file`: the image file's
/// bytes; the codec is told by the first of them. Errors kFormat (neither, or malformed), kTruncated.
Result<ImageInfo> probe_image(std::span<const std::byte> file);

/// A decoded picture: 4 bytes a pixel, RGBA, not premultiplied, rows top to bottom. Colour stays as it is coded (sRGB
/// in glTF, which has gamma, profile and orientation tags ignored).
struct Image {
  uint32_t width = 0;
  uint32_t height = 0;
  std::vector<uint8_t> rgba;
  std::string warning;  // what the decoder put up with ("ends before its data do", ...); empty where all was well
};

inline constexpr uint64_t kMaxImagePixels = uint64_t{1} << 28;  // 16384 x 16384, 1 GiB decoded
inline constexpr uint32_t kMaxDecodedSide = 65536;              // kernels::TextureView has levels for no more

/// Decodes a PNG (any colour type, depth and interlace; 16 bits are rounded to 8) or JPEG (grey, YCbCr, RGB, CMYK,
/// YCCK; baseline and progressive). Sizes are checked before anything is allocated. Corrupt entropy-coded JPEG data is
/// put up with and named in Image::warning, as other decoders do; all else is an error: kFormat (what the library
/// said), kTruncated, kRange (more than kMaxImagePixels or kMaxDecodedSide), kUnsupported, kMemory. Reentrant.
Result<Image> decode_image(std::span<const std::byte> file);

/// Writes 8-bit sRGB pixels. `channels`: 3 (RGB) or 4 (RGBA, not premultiplied); `pixels`: width * height * channels
/// bytes, rows top to bottom, no padding. Errors kFile.
Result<void> write_png(const std::string& path, uint32_t width, uint32_t height, uint32_t channels,
                       std::span<const uint8_t> pixels);

/// Writes one float a pixel as a PFM (Portable Float Map, grey): "Pf", size, scale -1.0 (little-endian), rows bottom to
/// top as the format has it. `values`: width * height, rows top to bottom; infinities are written as they are. Errors
/// kFile.
Result<void> write_pfm(const std::string& path, uint32_t width, uint32_t height, std::span<const float> values);

/// Writes a visibility buffer: width * height 64-bit little-endian words, rows top to bottom, nothing else in the file.
/// Each is kernels::pack_sample(depth code, triangle id); all ones is background. Errors kFile.
Result<void> write_visibility(const std::string& path, std::span<const uint64_t> samples);

}  // namespace scree::runtime
