// Reads and writes pictures: PNG, JPEG, WebP, KTX2 and DDS decoding; PNG, PFM and raw writing. Every writer writes
// `path`.part and renames it, so that an incomplete picture never has the name.
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

/// Facts from the header of an image file.
struct ImageInfo {
  format::ImageCodec codec;  // the codec in a .scree file, where a WebP becomes a PNG
  bool is_webp;
  uint32_t width;  // pixels, at least 1
  uint32_t height;
  uint32_t channels;        // 1 grey, 2 grey and alpha, 3 colour, 4 colour and alpha (PNG, WebP) or CMYK (JPEG); for
                            // blocks: their channels
  bool needs_transcode;     // JPEG: progressive or arithmetic; transcoding takes 2 bytes of memory per sample
  uint64_t block_bytes;     // KTX2 and DDS: of level 0, unpacked or decoded; else 0
  bool is_decoded;          // KTX2 of UASTC or BasisLZ, which become RGBA8
  uint64_t codebook_bytes;  // KTX2 of BasisLZ: memory that decoding takes beside the pixels; else 0
};

/// The bytes of an image file: in memory, or read on demand, so that a large file takes only a window of memory. Used
/// by one thread at a time.
class ImageFile {
 public:
  using Read = std::function<Result<void>(uint64_t offset, std::span<std::byte> out)>;

  /// A view of bytes that must stay valid and unchanged.
  template <class Bytes>
  requires std::convertible_to<const Bytes&, std::span<const std::byte>> ImageFile(const Bytes& bytes)
      : window_(bytes) {
    size_ = window_.size();
  }
  static constexpr uint64_t kWindowBytes = 64 << 10;
  static constexpr uint64_t kHeadBytes = 16 << 10;  // enough for the head of nearly any file
  /// `read`: fills `out`, of at most `window_bytes`, with the bytes at `offset`, which lie below `size`.
  ImageFile(uint64_t size, Read read, uint64_t window_bytes = kWindowBytes)
      : size_(size), read_(std::move(read)), window_bytes_(window_bytes) {}
  ImageFile(ImageFile&&) = default;
  ImageFile& operator=(ImageFile&&) = default;

  uint64_t size() const { return size_; }

  /// The available bytes from `offset` on: none at the end of the file or after an error. Valid until the next call.
  std::span<const std::byte> from(uint64_t offset);

  /// Fills `out` with the bytes at `offset`. Errors kTruncated, and errors of reading the file.
  Result<void> copy(uint64_t offset, std::span<std::byte> out);

  /// Byte `offset`, 0 past the end of the file or after an error.
  uint32_t byte(uint64_t offset) {
    const std::span<const std::byte> bytes = from(offset);
    return bytes.empty() ? 0 : static_cast<uint32_t>(bytes[0]);
  }

  /// The error of the first failed read. All later reads return no bytes.
  const std::optional<Error>& error() const { return error_; }

 private:
  uint64_t size_ = 0;
  Read read_;
  uint64_t window_bytes_ = kWindowBytes;
  std::vector<std::byte> buffer_;
  uint64_t first_ = 0;  // offset of the window
  std::span<const std::byte> window_;
  std::optional<Error> error_;
};

/// Reads the size of a PNG, JPEG, WebP, KTX2 or DDS file from its header; decodes nothing. The codec follows from the
/// first bytes. Errors kFormat (none of these, or malformed), kTruncated, kUnsupported, and errors of reading the file.
Result<ImageInfo> probe_image(ImageFile file);

/// The same for pictures that decode_image() would accept: also returns its errors if the header exceeds its limits.
Result<ImageInfo> probe_decodable(ImageFile file);

/// A decoded picture: 4 bytes per pixel, RGBA, not premultiplied, rows top to bottom. Colours keep their encoding (sRGB
/// in glTF, which ignores gamma, profile and orientation tags).
struct Image {
  uint32_t width = 0;
  uint32_t height = 0;
  std::vector<uint8_t> rgba;
  std::string warning;  // defects that the decoder tolerated ("ends before its data do", ...); else empty
};

inline constexpr uint64_t kMaxImagePixels = uint64_t{1} << 28;  // 16384 x 16384, 1 GiB decoded
inline constexpr uint32_t kMaxDecodedSide = 65536;              // the largest side for which kernels::TextureView has
                                                                // levels

/// Whether a file of `bytes` bytes may be a picture of `pixels` pixels: at most 2^15 per byte, so that decoding a file
/// of 200 bytes takes at most 26 MB. A PNG holds at most 8,256 pixels per byte, a JPEG 256, a progressive JPEG 512 (a
/// bit per block). Only arithmetic coding, which browsers do not read, could need less for a single colour.
constexpr bool may_hold_pixels(uint64_t pixels, uint64_t bytes) {
  return pixels >> 15 <= bytes;
}

/// Decodes a PNG (any colour type, depth and interlace; 16 bits are rounded to 8), a JPEG (grey, YCbCr, RGB, CMYK,
/// YCCK; baseline and progressive), a WebP (lossy or lossless, not animated), or level 0 of a file for
/// open_block_file(). Sizes are checked before anything is allocated. Corrupt entropy-coded JPEG data are tolerated, as
/// in other decoders, and reported in Image::warning. Any other input is an error: kFormat (with the library's
/// message), kTruncated (also if the file is too small for that many pixels), kRange (more than kMaxImagePixels or
/// kMaxDecodedSide), kUnsupported, kMemory, and errors of reading the file. Reentrant.
Result<Image> decode_image(ImageFile file);

/// The same, but calls `take(rows)` with some rows after another, from the top, and stops early if it returns false.
/// Returns the facts of the file. Block images are decoded in bands, other pictures are taken whole.
Result<ImageInfo> decode_rows(ImageFile file, const std::function<bool(const Image& rows)>& take);

/// Makes the checks of decode_image(). Returns its error or its warning, which is empty for a good file. Decodes the
/// whole file without holding the picture, except that of a WebP; see image_check_bytes.
Result<std::string> check_image(ImageFile file);

/// Upper bound of the memory of check_image for a picture of this size in a file of this size, bytes. A WebP takes the
/// file and the picture. Others take some rows, and a JPEG a bit per coefficient, since the scans of a progressive JPEG
/// build upon each other (96 MiB for 16384 x 16384 in colour).
uint64_t image_check_bytes(const ImageInfo& info, uint64_t file_bytes);

/// The version of libwebp, such as "1.2.4". Empty if scree is built without it; WebP files are then kUnsupported.
std::string webp_version();

/// Writes one or three floats per pixel as a PFM (Portable Float Map): "Pf" or "PF", size, scale -1.0 (little-endian),
/// rows bottom to top as the format requires. `values`: width * height, or three times as many, rows top to bottom;
/// infinities are written unchanged. Errors kFile.
Result<void> write_pfm(const std::string& path, uint32_t width, uint32_t height, std::span<const float> values,
                       format::Existing existing = format::Existing::kReplace);

/// Writes only the samples of a visibility buffer: width * height 64-bit little-endian words, rows top to bottom. Each
/// is kernels::pack_sample(depth code, triangle id); all ones is background. Errors kFile.
Result<void> write_visibility(const std::string& path, std::span<const uint64_t> samples,
                              format::Existing existing = format::Existing::kReplace);

}  // namespace scree::runtime
