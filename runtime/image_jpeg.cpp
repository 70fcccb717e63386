#include <csetjmp>
#include <cstdio>
#include <string>

#include <jerror.h>
#include <jpeglib.h>

#include "runtime/image.h"
#include "runtime/image_codecs.h"

namespace scree::runtime {
namespace {

/// Progressive files may hold any number of scans over the whole picture in a few bytes each; real ones have ten or so.
constexpr int kMaxScans = 500;

/// libjpeg's error manager with a way out; trivially destructible.
struct JpegErrors {
  jpeg_error_mgr manager;  // first: libjpeg hands back a pointer to it
  std::jmp_buf escape;
  char fatal[JMSG_LENGTH_MAX];
  char warning[JMSG_LENGTH_MAX];
};

[[noreturn]] void on_jpeg_error(j_common_ptr info) {
  auto* const errors = reinterpret_cast<JpegErrors*>(info->err);
  if (errors->fatal[0] == 0) info->err->format_message(info, errors->fatal);
  std::longjmp(errors->escape, 1);
}

void on_jpeg_message(j_common_ptr info, int level) {
  if (level >= 0) return;  // traces
  auto* const errors = reinterpret_cast<JpegErrors*>(info->err);
  if (info->err->num_warnings++ == 0) info->err->format_message(info, errors->warning);
}

void on_jpeg_progress(j_common_ptr info) {
  if (reinterpret_cast<j_decompress_ptr>(info)->input_scan_number <= kMaxScans) return;
  auto* const errors = reinterpret_cast<JpegErrors*>(info->err);
  std::snprintf(errors->fatal, sizeof errors->fatal, "more than %d scans", kMaxScans);
  on_jpeg_error(info);
}

/// Owns the decompressor, so that an early return frees what libjpeg took.
struct JpegReader {
  JpegReader() {
    info.err = jpeg_std_error(&errors.manager);
    errors.manager.error_exit = on_jpeg_error;
    errors.manager.emit_message = on_jpeg_message;
    progress.progress_monitor = on_jpeg_progress;
  }
  JpegReader(const JpegReader&) = delete;
  JpegReader& operator=(const JpegReader&) = delete;
  ~JpegReader() { jpeg_destroy_decompress(&info); }  // does nothing where nothing was created

  jpeg_decompress_struct info{};
  jpeg_progress_mgr progress{};
  JpegErrors errors{};
};

/// Runs `body`, whose frame must own nothing, and returns whether libjpeg got to its end.
template <class Body>
bool guarded(JpegErrors& errors, const Body& body) {
  if (setjmp(errors.escape) != 0) return false;
  body();
  return true;
}

/// CMYK to RGB in place, alpha 255, without a profile: light = (1 - ink) * (1 - black). Adobe writes light instead of
/// ink.
void convert_cmyk(std::span<uint8_t> pixels, bool holds_light) {
  const unsigned flip = holds_light ? 0 : 255;
  for (size_t i = 0; i + 4 <= pixels.size(); i += 4) {
    const unsigned black = pixels[i + 3] ^ flip;
    for (size_t c = 0; c < 3; ++c) pixels[i + c] = static_cast<uint8_t>(((pixels[i + c] ^ flip) * black + 127) / 255);
    pixels[i + 3] = 255;
  }
}

}  // namespace

Result<ImageInfo> probe_jpeg(std::span<const std::byte> file) {
  const auto byte = [&](size_t i) { return static_cast<uint32_t>(file[i]); };
  const Error ended{ErrorCode::kTruncated, "JPEG: ends before its frame header"};
  size_t at = 2;  // past SOI
  for (;;) {
    while (at < file.size() && byte(at) != 0xff) ++at;
    while (at < file.size() && byte(at) == 0xff) ++at;
    if (at >= file.size()) return ended;
    const uint32_t marker = byte(at++);
    if (marker == 0 || marker == 1 || (marker >= 0xd0 && marker <= 0xd8)) continue;  // stand alone
    if (marker == 0xd9 || marker == 0xda) return Error{ErrorCode::kFormat, "JPEG: image data before a frame header"};
    if (file.size() - at < 2) return ended;
    const uint32_t length = byte(at) << 8 | byte(at + 1);
    if (length < 2) return Error{ErrorCode::kFormat, "JPEG: a segment of " + std::to_string(length) + " bytes"};
    const bool is_frame = marker >= 0xc0 && marker <= 0xcf && marker != 0xc4 && marker != 0xc8 && marker != 0xcc;
    if (!is_frame) {
      if (length > file.size() - at) return ended;
      at += length;
      continue;
    }
    if (length < 8) return Error{ErrorCode::kFormat, "JPEG: a frame header of " + std::to_string(length) + " bytes"};
    if (file.size() - at < 8) return ended;
    ImageInfo info{};
    info.codec = format::ImageCodec::kJpeg;
    info.height = byte(at + 3) << 8 | byte(at + 4);
    info.width = byte(at + 5) << 8 | byte(at + 6);
    info.channels = byte(at + 7);
    if (info.width == 0) return Error{ErrorCode::kFormat, "JPEG: width 0"};
    if (info.height == 0)
      return Error{ErrorCode::kUnsupported, "JPEG: height 0 (given after the data, by a DNL marker)"};
    if (info.channels != 1 && info.channels != 3 && info.channels != 4)
      return Error{ErrorCode::kUnsupported, "JPEG: " + std::to_string(info.channels) + " channels, expected 1, 3 or 4"};
    return info;
  }
}

Result<Image> decode_jpeg(std::span<const std::byte> file, const ImageInfo& info) {
  JpegReader reader;
  jpeg_decompress_struct* const jpeg = &reader.info;
  const auto failure = [&] {
    const bool out_of_memory = reader.errors.manager.msg_code == JERR_OUT_OF_MEMORY;
    return Error{out_of_memory ? ErrorCode::kMemory : ErrorCode::kFormat, std::string("JPEG: ") + reader.errors.fatal};
  };
  bool is_cmyk = false;
  if (!guarded(reader.errors, [&] {
        jpeg_create_decompress(jpeg);
        jpeg->progress = &reader.progress;
        jpeg_mem_src(jpeg, reinterpret_cast<const unsigned char*>(file.data()), file.size());
        jpeg_read_header(jpeg, TRUE);
        is_cmyk = jpeg->jpeg_color_space == JCS_CMYK || jpeg->jpeg_color_space == JCS_YCCK;
        jpeg->out_color_space = is_cmyk ? JCS_CMYK : JCS_EXT_RGBA;
      }))
    return failure();
  if (jpeg->image_width != info.width || jpeg->image_height != info.height)
    return Error{ErrorCode::kFormat, "JPEG: several frame headers"};

  Image image;
  image.width = info.width;
  image.height = info.height;
  image.rgba.resize(size_t{4} * info.width * info.height);
  uint8_t* const first = image.rgba.data();
  if (!guarded(reader.errors, [&] {
        jpeg_start_decompress(jpeg);
        while (jpeg->output_scanline < jpeg->output_height) {
          JSAMPROW row = first + size_t{4} * info.width * jpeg->output_scanline;
          jpeg_read_scanlines(jpeg, &row, 1);
        }
      }))
    return failure();
  if (is_cmyk) convert_cmyk(image.rgba, jpeg->saw_Adobe_marker != 0);
  if (reader.errors.manager.num_warnings > 0) image.warning = std::string("JPEG: ") + reader.errors.warning;
  return image;
}

}  // namespace scree::runtime
