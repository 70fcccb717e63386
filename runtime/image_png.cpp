#include <algorithm>
#include <cassert>
#include <csetjmp>
#include <cstdio>
#include <cstring>
#include <string>
#include <vector>

#include <png.h>

#include "runtime/image.h"
#include "runtime/image_codecs.h"
#include "runtime/part_file.h"

namespace scree::runtime {
namespace {

/// What libpng said last; trivially destructible, because a longjmp passes it by.
struct PngMessage {
  char text[160] = {};
};

[[noreturn]] void on_png_error(png_structp png, png_const_charp text) {
  auto* const message = static_cast<PngMessage*>(png_get_error_ptr(png));
  std::snprintf(message->text, sizeof message->text, "%s", text);
  png_longjmp(png, 1);
}

void on_png_warning(png_structp, png_const_charp) {}

/// Runs `body`, whose frame must own nothing, and returns whether libpng got to its end.
template <class Body>
bool guarded(png_structp png, const Body& body) {
  if (setjmp(png_jmpbuf(png)) != 0) return false;
  body();
  return true;
}

class PngReader {
 public:
  PngReader() : png_(png_create_read_struct(PNG_LIBPNG_VER_STRING, &message, on_png_error, on_png_warning)) {
    if (png_ != nullptr) info_ = png_create_info_struct(png_);
  }
  PngReader(const PngReader&) = delete;
  PngReader& operator=(const PngReader&) = delete;
  ~PngReader() { png_destroy_read_struct(&png_, &info_, nullptr); }
  png_structp png() const { return png_; }
  png_infop info() const { return info_; }

  PngMessage message;

 private:
  png_structp png_ = nullptr;
  png_infop info_ = nullptr;
};

class PngWriter {
 public:
  PngWriter() : png_(png_create_write_struct(PNG_LIBPNG_VER_STRING, &message, on_png_error, on_png_warning)) {
    if (png_ != nullptr) info_ = png_create_info_struct(png_);
  }
  PngWriter(const PngWriter&) = delete;
  PngWriter& operator=(const PngWriter&) = delete;
  ~PngWriter() { png_destroy_write_struct(&png_, &info_); }
  png_structp png() const { return png_; }
  png_infop info() const { return info_; }

  PngMessage message;

 private:
  png_structp png_ = nullptr;
  png_infop info_ = nullptr;
};

struct Source {
  const std::byte* at;
  size_t left;
  bool ended;
};

void read_png_bytes(png_structp png, png_bytep out, size_t size) {
  auto* const source = static_cast<Source*>(png_get_io_ptr(png));
  if (size > source->left) {
    source->ended = true;
    png_error(png, "ends before its data do");
  }
  std::memcpy(out, source->at, size);
  source->at += size;
  source->left -= size;
}

void write_png_bytes(png_structp png, png_bytep bytes, size_t size) {
  // The file remembers the failure and commit() reports it; going on to the end costs no more than a jump would save.
  static_cast<PartFile*>(png_get_io_ptr(png))->write(bytes, size);
}

void flush_png_bytes(png_structp) {}

uint32_t big_endian(std::span<const std::byte> file, size_t offset) {
  uint32_t value = 0;
  for (size_t i = 0; i < 4; ++i) value = value << 8 | static_cast<uint32_t>(file[offset + i]);
  return value;
}

constexpr size_t kSignatureBytes = 8;
constexpr size_t kChunkOverheadBytes = 12;  // length, type, checksum
constexpr size_t kHeaderEnd = kSignatureBytes + kChunkOverheadBytes + 13;

bool chunk_is(std::span<const std::byte> file, size_t offset, const char* type) {
  return std::memcmp(file.data() + offset + 4, type, 4) == 0;
}

/// Whether a tRNS chunk comes before the image data.
bool has_transparency(std::span<const std::byte> file) {
  size_t offset = kHeaderEnd;
  while (file.size() - offset >= kChunkOverheadBytes && !chunk_is(file, offset, "IDAT")) {
    if (chunk_is(file, offset, "tRNS")) return true;
    const uint64_t size = uint64_t{big_endian(file, offset)} + kChunkOverheadBytes;
    if (size > file.size() - offset) break;
    offset += size;
  }
  return false;
}

}  // namespace

Result<ImageInfo> probe_png(std::span<const std::byte> file) {
  constexpr unsigned char kSignature[kSignatureBytes] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
  if (file.size() < kHeaderEnd)
    return Error{ErrorCode::kTruncated,
                 "PNG: " + std::to_string(file.size()) + " bytes, but its header takes " + std::to_string(kHeaderEnd)};
  if (std::memcmp(file.data(), kSignature, kSignatureBytes) != 0)
    return Error{ErrorCode::kFormat, "PNG: bytes 4 to 7 of the signature were changed"};
  if (big_endian(file, kSignatureBytes) != 13 || !chunk_is(file, kSignatureBytes, "IHDR"))
    return Error{ErrorCode::kFormat, "PNG: the first chunk is not an IHDR of 13 bytes"};
  ImageInfo info{};
  info.codec = format::ImageCodec::kPng;
  info.width = big_endian(file, 16);
  info.height = big_endian(file, 20);
  if (info.width == 0 || info.height == 0 || info.width > 0x7fffffff || info.height > 0x7fffffff)
    return Error{ErrorCode::kFormat, "PNG: " + std::to_string(info.width) + " x " + std::to_string(info.height) +
                                         " pixels, expected 1 to 2^31 - 1 a side"};
  const auto type = static_cast<unsigned>(file[25]);
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

Result<Image> decode_png(std::span<const std::byte> file, const ImageInfo& info) {
  // Deflate makes at most 1032 bytes of one, so a small file that declares a huge picture is found out before the
  // memory for it is taken. One bit a sample is the least there is.
  if (uint64_t{info.width} * info.height / 8 / 1032 > file.size())
    return Error{ErrorCode::kTruncated, "PNG: " + std::to_string(info.width) + " x " + std::to_string(info.height) +
                                            " pixels in " + std::to_string(file.size()) + " bytes"};
  PngReader reader;
  if (reader.info() == nullptr) return Error{ErrorCode::kMemory, "PNG: out of memory"};
  const png_structp png = reader.png();
  const png_infop png_info = reader.info();
  Source source{file.data(), file.size(), false};
  const auto failure = [&] {
    return Error{source.ended ? ErrorCode::kTruncated : ErrorCode::kFormat, std::string("PNG: ") + reader.message.text};
  };

  size_t row_bytes = 0;
  if (!guarded(png, [&] {
        png_set_read_fn(png, &source, read_png_bytes);
        png_set_user_limits(png, kMaxDecodedSide, kMaxDecodedSide);
        png_read_info(png, png_info);
        png_set_expand(png);  // palettes, grey below 8 bits and tRNS
        png_set_scale_16(png);
        png_set_gray_to_rgb(png);
        png_set_add_alpha(png, 0xff, PNG_FILLER_AFTER);
        png_set_interlace_handling(png);
        png_read_update_info(png, png_info);
        row_bytes = png_get_rowbytes(png, png_info);
      }))
    return failure();
  if (row_bytes != size_t{4} * info.width) return Error{ErrorCode::kFormat, "PNG: header read in two ways"};

  Image image;
  image.width = info.width;
  image.height = info.height;
  image.rgba.resize(row_bytes * info.height);
  std::vector<png_bytep> rows(info.height);
  for (size_t y = 0; y < rows.size(); ++y) rows[y] = image.rgba.data() + y * row_bytes;
  const png_bytepp first_row = rows.data();
  if (!guarded(png, [&] { png_read_image(png, first_row); })) return failure();
  return image;
}

Result<void> write_png(const std::string& path, uint32_t width, uint32_t height, uint32_t channels,
                       std::span<const uint8_t> pixels) {
  assert(channels == 3 || channels == 4);
  assert(pixels.size() == uint64_t{width} * height * channels);
  Result<PartFile> created = PartFile::create(path);
  if (!created) return created.error();
  PartFile* const file = &*created;
  PngWriter writer;
  if (writer.info() == nullptr) return Error{ErrorCode::kMemory, path + ": out of memory"};
  const png_structp png = writer.png();
  const png_infop info = writer.info();
  const uint8_t* const first = pixels.data();
  const size_t row_bytes = size_t{width} * channels;
  const bool written = guarded(png, [&] {
    png_set_write_fn(png, file, write_png_bytes, flush_png_bytes);
    png_set_user_limits(png, 0x7fffffff, 0x7fffffff);
    // 1920 x 1080 of a textured scene on one EPYC core: level 3 takes 172 ms and 3.89 MB, level 6 (the default) 443 ms
    // and 3.69 MB.
    png_set_compression_level(png, 3);
    png_set_IHDR(png, info, width, height, 8, channels == 4 ? PNG_COLOR_TYPE_RGB_ALPHA : PNG_COLOR_TYPE_RGB,
                 PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    png_set_sRGB(png, info, PNG_sRGB_INTENT_PERCEPTUAL);
    png_write_info(png, info);
    for (uint32_t y = 0; y < height; ++y) png_write_row(png, first + y * row_bytes);
    png_write_end(png, info);
  });
  if (!written) return Error{ErrorCode::kFile, path + ": PNG: " + writer.message.text};
  return file->commit();
}

}  // namespace scree::runtime
