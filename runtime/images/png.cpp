#include <algorithm>
#include <csetjmp>
#include <cstdio>
#include <cstring>
#include <new>
#include <string>
#include <utility>
#include <vector>

#include <png.h>

#include "runtime/images/codecs.h"
#include "runtime/images/image.h"

namespace scree::runtime {
namespace {

/// libpng's last message. Trivially destructible, because a longjmp skips destructors.
struct PngMessage {
  char text[160] = {};
};

[[noreturn]] void on_png_error(png_structp png, png_const_charp text) {
  auto* const message = static_cast<PngMessage*>(png_get_error_ptr(png));
  std::snprintf(message->text, sizeof message->text, "%s", text);
  png_longjmp(png, 1);
}

/// libpng reports the kind of error only as text: "Out of memory", and "insufficient memory" from zlib.
ErrorCode code_of(const PngMessage& message) {
  return std::strstr(message.text, "memory") != nullptr ? ErrorCode::kMemory : ErrorCode::kFormat;
}

void on_png_warning(png_structp, png_const_charp) {}

/// Runs `body`, whose frame must own nothing, and returns whether libpng completed it.
template <class Body>
bool guarded(png_structp png, const Body& body) {
  if (setjmp(png_jmpbuf(png)) != 0) return false;
  body();
  return true;
}

/// A libpng struct and its info, for reading, freed together.
class PngHandle {
 public:
  PngHandle() : png_(png_create_read_struct(PNG_LIBPNG_VER_STRING, &message, on_png_error, on_png_warning)) {
    if (png_ != nullptr) info_ = png_create_info_struct(png_);
  }
  PngHandle(const PngHandle&) = delete;
  PngHandle& operator=(const PngHandle&) = delete;
  ~PngHandle() { png_destroy_read_struct(&png_, &info_, nullptr); }
  png_structp png() const { return png_; }
  png_infop info() const { return info_; }

  PngMessage message;

 private:
  png_structp png_;
  png_infop info_ = nullptr;
};

struct Source {
  ImageFile& file;
  uint64_t at;
  bool ended;
};

/// Fills `out`. Never calls longjmp. Returns whether `out` was filled.
bool read_png_source(Source& source, png_bytep out, size_t size) {
  while (size > 0) {
    const std::span<const std::byte> bytes = source.file.from(source.at);
    if (bytes.empty()) {
      source.ended = true;
      return false;
    }
    const size_t part = std::min(size, bytes.size());
    std::memcpy(out, bytes.data(), part);
    out += part;
    size -= part;
    source.at += part;
  }
  return true;
}

void read_png_bytes(png_structp png, png_bytep out, size_t size) {
  if (!read_png_source(*static_cast<Source*>(png_get_io_ptr(png)), out, size))
    png_error(png, "ends before its data do");
}

uint32_t big_endian(ImageFile& file, uint64_t offset) {
  uint32_t value = 0;
  for (uint64_t i = 0; i < 4; ++i) value = value << 8 | file.byte(offset + i);
  return value;
}

constexpr uint64_t kSignatureBytes = 8;
constexpr uint64_t kChunkOverheadBytes = 12;  // length, type, checksum
constexpr uint64_t kHeaderEnd = kSignatureBytes + kChunkOverheadBytes + 13;

bool chunk_is(ImageFile& file, uint64_t offset, const char* type) {
  for (uint64_t i = 0; i < 4; ++i)
    if (file.byte(offset + 4 + i) != static_cast<unsigned char>(type[i])) return false;
  return true;
}

/// Whether a tRNS chunk lies before the image data.
bool has_transparency(ImageFile& file) {
  uint64_t offset = kHeaderEnd;
  while (file.size() - offset >= kChunkOverheadBytes && !chunk_is(file, offset, "IDAT")) {
    if (chunk_is(file, offset, "tRNS")) return true;
    const uint64_t size = uint64_t{big_endian(file, offset)} + kChunkOverheadBytes;
    if (size > file.size() - offset) break;
    offset += size;
  }
  return false;
}

/// Decodes a picture. `place(row_bytes)` returns the address of the first row and the step in bytes from row to row.
/// With a step of 0, all rows (of all passes of an interlaced file) overwrite each other, so that the picture takes no
/// memory.
template <class Place>
Result<void> read_png(ImageFile& file, const ImageInfo& info, const Place& place) {
  // Deflate expands at most 1032 times, and a sample takes at least one bit. So a small file with a huge size in its
  // header is refused before memory is allocated.
  if (uint64_t{info.width} * info.height / 8 / 1032 > file.size())
    return Error{ErrorCode::kTruncated, "PNG: " + std::to_string(info.width) + " x " + std::to_string(info.height) +
                                            " pixels in " + std::to_string(file.size()) + " bytes"};
  PngHandle reader;
  if (reader.info() == nullptr) return Error{ErrorCode::kMemory, "PNG: out of memory"};
  const png_structp png = reader.png();
  const png_infop png_info = reader.info();
  Source source{file, 0, false};
  const auto failure = [&] {
    if (file.error()) return *file.error();
    return Error{source.ended ? ErrorCode::kTruncated : code_of(reader.message),
                 std::string("PNG: ") + reader.message.text};
  };

  size_t row_bytes = 0;
  int passes = 0;
  if (!guarded(png, [&] {
        png_set_read_fn(png, &source, read_png_bytes);
        png_set_user_limits(png, kMaxDecodedSide, kMaxDecodedSide);
        // Otherwise libpng keeps text, profiles and other chunks, up to 8 MB each.
        png_set_keep_unknown_chunks(png, PNG_HANDLE_CHUNK_NEVER, nullptr, -1);
        png_read_info(png, png_info);
        png_set_expand(png);  // palettes, grey below 8 bits and tRNS
        png_set_scale_16(png);
        png_set_gray_to_rgb(png);
        png_set_add_alpha(png, 0xff, PNG_FILLER_AFTER);
        passes = png_set_interlace_handling(png);
        png_read_update_info(png, png_info);
        row_bytes = png_get_rowbytes(png, png_info);
      }))
    return failure();
  if (row_bytes != size_t{4} * info.width) return Error{ErrorCode::kFormat, "PNG: header read in two ways"};

  const auto [pixels, stride] = place(row_bytes);
  uint8_t* const first = pixels;
  const size_t step = stride;
  if (!guarded(png, [&] {
        for (int pass = 0; pass < passes; ++pass)
          for (uint32_t y = 0; y < info.height; ++y) png_read_row(png, first + y * step, nullptr);
      }))
    return failure();
  return {};
}

}  // namespace

Result<ImageInfo> probe_png(ImageFile& file) {
  constexpr unsigned char kSignature[kSignatureBytes] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
  if (file.size() < kHeaderEnd)
    return Error{ErrorCode::kTruncated,
                 "PNG: " + std::to_string(file.size()) + " bytes, but its header takes " + std::to_string(kHeaderEnd)};
  for (uint64_t i = 0; i < kSignatureBytes; ++i)
    if (file.byte(i) != kSignature[i])
      return Error{ErrorCode::kFormat, "PNG: bytes 4 to 7 of the signature were changed"};
  if (big_endian(file, kSignatureBytes) != 13 || !chunk_is(file, kSignatureBytes, "IHDR"))
    return Error{ErrorCode::kFormat, "PNG: the first chunk is not an IHDR of 13 bytes"};
  ImageInfo info{.codec = format::ImageCodec::kPng, .width = big_endian(file, 16), .height = big_endian(file, 20)};
  if (info.width == 0 || info.height == 0 || info.width > 0x7fffffff || info.height > 0x7fffffff)
    return Error{ErrorCode::kFormat, "PNG: " + std::to_string(info.width) + " x " + std::to_string(info.height) +
                                         " pixels, expected 1 to 2^31 - 1 per side"};
  const auto type = file.byte(25);
  switch (type) {
    case PNG_COLOR_TYPE_GRAY:
      info.channels = 1;
      break;
    case PNG_COLOR_TYPE_GRAY_ALPHA:
      info.channels = 2;
      break;
    case PNG_COLOR_TYPE_RGB:
    case PNG_COLOR_TYPE_PALETTE:
      info.channels = 3;
      break;
    case PNG_COLOR_TYPE_RGB_ALPHA:
      info.channels = 4;
      break;
    default:
      return Error{ErrorCode::kFormat, "PNG: colour type " + std::to_string(type) + ", expected 0, 2, 3, 4 or 6"};
  }
  if ((info.channels & 1u) != 0 && has_transparency(file)) ++info.channels;
  return info;
}

Result<Image> decode_png(ImageFile& file, const ImageInfo& info) {
  Image image{.width = info.width, .height = info.height};
  const Result<void> read = read_png(file, info, [&](size_t row_bytes) {
    image.rgba.resize(row_bytes * info.height);
    return std::pair(image.rgba.data(), row_bytes);
  });
  if (!read) return read.error();
  return image;
}

Result<std::string> check_png(ImageFile& file, const ImageInfo& info) {
  std::vector<uint8_t> row;
  const Result<void> read = read_png(file, info, [&](size_t row_bytes) {
    row.resize(row_bytes);
    return std::pair(row.data(), size_t{0});
  });
  if (!read) return read.error();
  return std::string();
}

}  // namespace scree::runtime
