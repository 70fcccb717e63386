#include <bit>
#include <cstddef>
#include <cstring>
#include <span>
#include <string>
#include <vector>

#include "runtime/images/codecs.h"
#include "runtime/images/image.h"
#include "runtime/images/jpeg_errors.h"

namespace scree::runtime {
namespace {

/// libjpeg's source: windows of an ImageFile. A file that ends early gets an end marker and a warning, as in libjpeg's
/// own sources.
struct JpegSource {
  jpeg_source_mgr manager;  // first: libjpeg passes on a pointer to it
  ImageFile* file;
  uint64_t next;  // offset behind libjpeg's current window
};

JpegSource& source_of(j_decompress_ptr info) {
  return *reinterpret_cast<JpegSource*>(info->src);
}

/// Moves to the next window. Never calls longjmp. Returns false at the end of the file.
bool next_window(JpegSource& source) {
  const std::span<const std::byte> bytes = source.file->from(source.next);
  source.manager.next_input_byte = reinterpret_cast<const JOCTET*>(bytes.data());
  source.manager.bytes_in_buffer = bytes.size();
  source.next += bytes.size();
  return !bytes.empty();
}

boolean fill_jpeg_input(j_decompress_ptr info) {
  static constexpr JOCTET kEnd[2] = {0xff, JPEG_EOI};
  JpegSource& source = source_of(info);
  if (next_window(source)) return TRUE;
  if (source.file->error()) JpegErrors::of(reinterpret_cast<j_common_ptr>(info)).leave();
  WARNMS(info, JWRN_JPEG_EOF);
  source.manager.next_input_byte = kEnd;
  source.manager.bytes_in_buffer = sizeof kEnd;
  return TRUE;
}

void skip_jpeg_input(j_decompress_ptr info, long bytes) {
  if (bytes <= 0) return;
  JpegSource& source = source_of(info);
  const size_t skipped = static_cast<size_t>(bytes);
  if (skipped <= source.manager.bytes_in_buffer) {
    source.manager.next_input_byte += skipped;
    source.manager.bytes_in_buffer -= skipped;
  } else {
    source.next += skipped - source.manager.bytes_in_buffer;
    source.manager.bytes_in_buffer = 0;
  }
}

void ignore_jpeg_call(j_decompress_ptr) {}

/// Replaces libjpeg's array of a picture's coefficients when a file is only checked. From earlier scans the entropy
/// decoders need only which coefficients are not zero, and these never become zero again. So one bit per coefficient is
/// enough, instead of 16. The rows in use have libjpeg's own form.
struct CoefficientMasks {
  JDIMENSION blocks_a_row;
  JDIMENSION rows;
  JDIMENSION window_rows;
  JDIMENSION first;  // row of the window
  bool is_held;      // whether the window holds rows
  JBLOCKARRAY window;
  uint64_t* masks;  // a word per block
};

/// Stores the masks of the window's rows before libjpeg moves to other rows.
void store_window(const CoefficientMasks& array) {
  for (JDIMENSION row = 0; row < array.window_rows && array.first + row < array.rows; ++row) {
    uint64_t* const masks = array.masks + size_t{array.first + row} * array.blocks_a_row;
    for (JDIMENSION block = 0; block < array.blocks_a_row; ++block) {
      uint64_t mask = 0;
      for (unsigned i = 0; i < DCTSIZE2; ++i) mask |= uint64_t{array.window[row][block][i] != 0} << i;
      masks[block] = mask;
    }
  }
}

void load_window(CoefficientMasks& array, JDIMENSION first) {
  array.first = first;
  array.is_held = true;
  for (JDIMENSION row = 0; row < array.window_rows && first + row < array.rows; ++row) {
    const uint64_t* const masks = array.masks + size_t{first + row} * array.blocks_a_row;
    std::memset(array.window[row], 0, sizeof(JBLOCK) * array.blocks_a_row);
    for (JDIMENSION block = 0; block < array.blocks_a_row; ++block)
      for (uint64_t mask = masks[block]; mask != 0; mask &= mask - 1)
        array.window[row][block][std::countr_zero(mask)] = 1;
  }
}

jvirt_barray_ptr request_masks(j_common_ptr info, int pool, boolean, JDIMENSION blocks_a_row, JDIMENSION rows,
                               JDIMENSION window_rows) {
  const size_t mask_bytes = sizeof(uint64_t) * blocks_a_row * rows;
  auto* const array = static_cast<CoefficientMasks*>(info->mem->alloc_small(info, pool, sizeof(CoefficientMasks)));
  *array = {blocks_a_row, rows, window_rows, 0, false, nullptr, nullptr};
  array->window = info->mem->alloc_barray(info, pool, blocks_a_row, window_rows);
  array->masks = static_cast<uint64_t*>(info->mem->alloc_large(info, pool, mask_bytes));
  std::memset(array->masks, 0, mask_bytes);
  return reinterpret_cast<jvirt_barray_ptr>(array);
}

JBLOCKARRAY access_masks(j_common_ptr info, jvirt_barray_ptr handle, JDIMENSION first, JDIMENSION count, boolean) {
  auto& array = *reinterpret_cast<CoefficientMasks*>(handle);
  if (count > array.window_rows || first > array.rows || count > array.rows - first)
    ERREXIT(info, JERR_BAD_VIRTUAL_ACCESS);
  if (!array.is_held || first < array.first || first + count > array.first + array.window_rows) {
    if (array.is_held) store_window(array);
    load_window(array, first);
  }
  return array.window + (first - array.first);
}

/// Owns the decompressor, so that an early return frees libjpeg's memory.
class JpegReader {
 public:
  explicit JpegReader(ImageFile& file) : file_(file) {
    jpeg_.err = errors_.set_up();
    progress_.progress_monitor = JpegErrors::limit_scans;
    source_.file = &file;
    source_.manager.init_source = ignore_jpeg_call;
    source_.manager.fill_input_buffer = fill_jpeg_input;
    source_.manager.skip_input_data = skip_jpeg_input;
    source_.manager.resync_to_restart = jpeg_resync_to_restart;
    source_.manager.term_source = ignore_jpeg_call;
  }
  JpegReader(const JpegReader&) = delete;
  JpegReader& operator=(const JpegReader&) = delete;
  ~JpegReader() { jpeg_destroy_decompress(&jpeg_); }  // does nothing before creation

  /// Call before open(). Files of several scans are then decoded into masks only, to check them.
  void keep_masks_only() { masks_only_ = true; }

  /// Reads the header and compares it with the probe's result.
  Result<void> open(const ImageInfo& info) {
    jpeg_decompress_struct* const jpeg = &jpeg_;
    if (!errors_.guarded([&] {
          jpeg_create_decompress(jpeg);
          jpeg->progress = &progress_;
          jpeg->src = &source_.manager;
          if (masks_only_) {
            jpeg->mem->request_virt_barray = request_masks;
            jpeg->mem->access_virt_barray = access_masks;
          }
          jpeg_read_header(jpeg, TRUE);
          is_cmyk_ = jpeg->jpeg_color_space == JCS_CMYK || jpeg->jpeg_color_space == JCS_YCCK;
          jpeg->out_color_space = is_cmyk_ ? JCS_CMYK : JCS_EXT_RGBA;
        }))
      return failure();
    if (jpeg_.image_width != info.width || jpeg_.image_height != info.height)
      return Error{ErrorCode::kFormat, "JPEG: several frame headers"};
    return {};
  }

  /// Decodes all rows: the first to `first`, each `stride` bytes behind the row before. With 0, each row overwrites the
  /// row before. Returns whether libjpeg reached the end.
  bool read_rows(uint8_t* first, size_t stride) {
    jpeg_decompress_struct* const jpeg = &jpeg_;
    return errors_.guarded([&] {
      jpeg_start_decompress(jpeg);
      // All scans are decoded by now. The remaining steps cannot fail, and they would need the coefficients, which are
      // not stored.
      if (masks_only_ && jpeg_has_multiple_scans(jpeg)) return;
      while (jpeg->output_scanline < jpeg->output_height) {
        JSAMPROW row = first + stride * jpeg->output_scanline;
        jpeg_read_scanlines(jpeg, &row, 1);
      }
    });
  }

  bool is_cmyk() const { return is_cmyk_; }
  bool holds_light() const { return jpeg_.saw_Adobe_marker != 0; }

  std::string warning() const {
    return errors_.manager.num_warnings > 0 ? std::string("JPEG: ") + errors_.warning : std::string();
  }

  Error failure() const { return file_.error() ? *file_.error() : errors_.error(); }

 private:
  ImageFile& file_;
  jpeg_decompress_struct jpeg_{};
  jpeg_progress_mgr progress_{};
  JpegErrors errors_{};
  JpegSource source_{};
  bool masks_only_ = false;
  bool is_cmyk_ = false;
};

/// CMYK to RGB in place, alpha 255, without a profile: light = (1 - ink) * (1 - black). Adobe stores light instead of
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

Result<ImageInfo> probe_jpeg(ImageFile& file) {
  const auto byte = [&](uint64_t i) { return file.byte(i); };
  const Error ended{ErrorCode::kTruncated, "JPEG: ends before its frame header"};
  uint64_t at = 2;  // past SOI
  for (;;) {
    while (at < file.size() && byte(at) != 0xff) ++at;
    while (at < file.size() && byte(at) == 0xff) ++at;
    if (at >= file.size()) return ended;
    const uint32_t marker = byte(at++);
    if (marker == 0 || marker == 1 || (marker >= 0xd0 && marker <= 0xd8)) continue;  // markers without a segment
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
    info.needs_transcode = marker != 0xc0 && marker != 0xc1;
    if (info.width == 0) return Error{ErrorCode::kFormat, "JPEG: width 0"};
    if (info.height == 0)
      return Error{ErrorCode::kUnsupported, "JPEG: height 0 (given after the data, by a DNL marker)"};
    if (info.channels != 1 && info.channels != 3 && info.channels != 4)
      return Error{ErrorCode::kUnsupported, "JPEG: " + std::to_string(info.channels) + " channels, expected 1, 3 or 4"};
    return info;
  }
}

Result<Image> decode_jpeg(ImageFile& file, const ImageInfo& info) {
  JpegReader reader(file);
  SCREE_TRY(reader.open(info));
  Image image{.width = info.width, .height = info.height};
  image.rgba.resize(size_t{4} * info.width * info.height);
  if (!reader.read_rows(image.rgba.data(), size_t{4} * info.width)) return reader.failure();
  if (reader.is_cmyk()) convert_cmyk(image.rgba, reader.holds_light());
  image.warning = reader.warning();
  return image;
}

Result<std::string> check_jpeg(ImageFile& file, const ImageInfo& info) {
  JpegReader reader(file);
  reader.keep_masks_only();
  SCREE_TRY(reader.open(info));
  std::vector<uint8_t> row(size_t{4} * info.width);
  if (!reader.read_rows(row.data(), 0)) return reader.failure();
  return reader.warning();
}

}  // namespace scree::runtime
