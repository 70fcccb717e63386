// Pictures in and out: PNG, JPEG, KTX2 and DDS decoding, PNG, PFM and raw writing. Every writer goes through
// `path`.part and a rename, so that nobody sees half a picture.
#pragma once

#include <concepts>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "format/container/part_file.h"
#include "format/layout.h"
#include "format/result.h"

namespace scree::runtime {

/// What the head of an image file says.
struct ImageInfo {
  format::ImageCodec codec;
  uint32_t width;  // pixels, at least 1
  uint32_t height;
  uint32_t channels;     // 1 grey, 2 grey and alpha, 3 colour, 4 colour and alpha (PNG) or CMYK (JPEG); of the blocks
  bool is_coded_anew;    // JPEG: progressive or arithmetic; making it sequential holds 2 bytes a sample
  uint64_t block_bytes;  // KTX2 and DDS: of level 0, unpacked; else 0
};

/// The bytes of an image file: in memory, or read as they are needed, so that a large file takes a window of memory.
/// Used by one thread at a time.
class ImageFile {
 public:
  using Read = std::function<Result<void>(uint64_t offset, std::span<std::byte> out)>;

  /// A view of bytes that stay where they are.
  template <class Bytes>
  requires std::convertible_to<const Bytes&, std::span<const std::byte>> ImageFile(const Bytes& bytes)
      : window_(bytes) {
    size_ = window_.size();
  }
  /// `read`: fills `out` with the bytes at `offset`, which lie below `size`.
  ImageFile(uint64_t size, Read read) : size_(size), read_(std::move(read)) {}
  ImageFile(ImageFile&&) = default;
  ImageFile& operator=(ImageFile&&) = default;

  uint64_t size() const { return size_; }

  /// Bytes from `offset` on, as many as are at hand: none at the end of the file or after an error. They are there
  /// until the next call.
  std::span<const std::byte> from(uint64_t offset);

  /// Byte `offset`, 0 past the end of the file or after an error.
  uint32_t byte(uint64_t offset) {
    const std::span<const std::byte> bytes = from(offset);
    return bytes.empty() ? 0 : static_cast<uint32_t>(bytes[0]);
  }

  /// The first read that failed; after that the file looks as if it ended.
  const std::optional<Error>& error() const { return error_; }

 private:
  uint64_t size_ = 0;
  Read read_;
  std::vector<std::byte> buffer_;
  uint64_t first_ = 0;  // of the window
  std::span<const std::byte> window_;
  std::optional<Error> error_;
};

/// Reads the size of a PNG, JPEG, KTX2 or DDS file from its head; decodes nothing. The codec is told by the first
/// bytes. Errors kFormat (none of them, or malformed), kTruncated, and those of reading the file.
Result<ImageInfo> probe_image(ImageFile file);

/// The same for pictures that decode_image() would try: errors as its own where what the header says is too much.
Result<ImageInfo> probe_decodable(ImageFile file);

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

/// Whether `bytes` of a file can be a picture of so many pixels: at most 2^15 of them a byte, so that a file of 200
/// bytes takes no more than 26 MB. A PNG holds 8,256 a byte at most, a JPEG 256, a progressive one 512 (a bit a block).
/// Arithmetic coding alone, which browsers do not read, could do with less for one colour.
constexpr bool may_hold_pixels(uint64_t pixels, uint64_t bytes) {
  return pixels >> 15 <= bytes;
}

/// Decodes a PNG (any colour type, depth and interlace; 16 bits are rounded to 8) or JPEG (grey, YCbCr, RGB, CMYK,
/// YCCK; baseline and progressive), or level 0 of what open_block_file() takes. Sizes are checked before anything is
/// allocated. Corrupt entropy-coded JPEG data is put up with and named in Image::warning, as other decoders do; all
/// else is an error: kFormat (what the library said), kTruncated (also where the file is too small for so many pixels),
/// kRange (more than kMaxImagePixels or kMaxDecodedSide), kUnsupported, kMemory, and those of reading the file.
/// Reentrant.
Result<Image> decode_image(ImageFile file);

/// What decode_image would say: an error where it has one, else its warning, which is empty where all was well. Decodes
/// the whole file without holding the picture; see image_check_bytes.
Result<std::string> check_image(ImageFile file);

/// At most what check_image takes for a picture of this size, bytes: some rows, and for a JPEG a bit a coefficient, as
/// the scans of a progressive one build upon each other (96 MiB for 16384 x 16384 in colour).
uint64_t image_check_bytes(const ImageInfo& info);

/// Writes 8-bit sRGB pixels. `channels`: 3 (RGB) or 4 (RGBA, not premultiplied); `pixels`: width * height * channels
/// bytes, rows top to bottom, no padding. Errors kFile.
Result<void> write_png(const std::string& path, uint32_t width, uint32_t height, uint32_t channels,
                       std::span<const uint8_t> pixels, format::Existing existing = format::Existing::kReplace);

/// The same in memory. Errors kMemory.
Result<std::vector<std::byte>> encode_png(uint32_t width, uint32_t height, uint32_t channels,
                                          std::span<const uint8_t> pixels);

/// Writes one or three floats a pixel as a PFM (Portable Float Map): "Pf" or "PF", size, scale -1.0 (little-endian),
/// rows bottom to top as the format has it. `values`: width * height, or three times as many, rows top to bottom;
/// infinities are written as they are. Errors kFile.
Result<void> write_pfm(const std::string& path, uint32_t width, uint32_t height, std::span<const float> values,
                       format::Existing existing = format::Existing::kReplace);

/// Writes a visibility buffer: width * height 64-bit little-endian words, rows top to bottom, nothing else in the file.
/// Each is kernels::pack_sample(depth code, triangle id); all ones is background. Errors kFile.
Result<void> write_visibility(const std::string& path, std::span<const uint64_t> samples,
                              format::Existing existing = format::Existing::kReplace);

}  // namespace scree::runtime
