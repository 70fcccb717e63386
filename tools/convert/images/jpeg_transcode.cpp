#include "tools/convert/images/jpeg_transcode.h"

#include <cstdlib>
#include <utility>

#include "format/jpeg/parse.h"
#include "runtime/images/image.h"
#include "runtime/images/jpeg_errors.h"
#include "runtime/images/jpeg_writer.h"

namespace scree::convert {
namespace {

using runtime::Image;
using runtime::JpegCoding;
using runtime::JpegErrors;
using runtime::JpegWriter;

/// Warnings after which libjpeg invents coefficients are treated as errors, because the result replaces the source.
void on_message(j_common_ptr info, int level) {
  if (level >= 0) return;  // traces
  JpegErrors& errors = JpegErrors::of(info);
  switch (info->err->msg_code) {
    case JWRN_JPEG_EOF:
    case JWRN_HIT_MARKER:
    case JWRN_HUFF_BAD_CODE:
    case JWRN_ARITH_BAD_CODE:
    case JWRN_MUST_RESYNC:
      info->err->format_message(info, errors.fatal);
      errors.leave();
    default:
      if (info->err->num_warnings++ == 0) info->err->format_message(info, errors.warning);
  }
}

/// Owns reader, writer and output, so that an early return frees libjpeg's memory.
class Transcoder {
 public:
  Transcoder() {
    reader_.err = writer_.err = errors_.set_up();
    errors_.manager.emit_message = on_message;
    progress_.progress_monitor = JpegErrors::limit_scans;
  }
  Transcoder(const Transcoder&) = delete;
  Transcoder& operator=(const Transcoder&) = delete;
  ~Transcoder() {
    jpeg_destroy_compress(&writer_);  // do nothing if nothing was created
    jpeg_destroy_decompress(&reader_);
    std::free(out_);
  }

  bool transcode(std::span<const std::byte> file) {
    file_bytes_ = file.size();
    return errors_.guarded([&] {
      jpeg_create_decompress(&reader_);
      reader_.progress = &progress_;
      jpeg_mem_src(&reader_, reinterpret_cast<const unsigned char*>(file.data()), file.size());
      jpeg_read_header(&reader_, TRUE);
      jvirt_barray_ptr* const coefficients = jpeg_read_coefficients(&reader_);
      jpeg_create_compress(&writer_);
      jpeg_mem_dest(&writer_, &out_, &out_bytes_);
      jpeg_copy_critical_parameters(&reader_, &writer_);
      writer_.optimize_coding = TRUE;
      jpeg_write_coefficients(&writer_, coefficients);
      jpeg_finish_compress(&writer_);
      jpeg_finish_decompress(&reader_);
    });
  }

  std::vector<std::byte> file() const {
    const auto* const bytes = reinterpret_cast<const std::byte*>(out_);
    return {bytes, bytes + out_bytes_};
  }
  std::string warning() const { return errors_.manager.num_warnings > 0 ? errors_.warning : ""; }

  /// The error after transcode() returned false, with the number of bytes that libjpeg had read.
  Error failure() const {
    const int message = errors_.manager.msg_code;
    const bool ended = message == JWRN_JPEG_EOF || message == JWRN_HIT_MARKER;
    const uint64_t left = reader_.src != nullptr ? reader_.src->bytes_in_buffer : 0;
    const uint64_t at = file_bytes_ - (left <= file_bytes_ ? left : 0);
    return errors_.error(ended ? ErrorCode::kTruncated : ErrorCode::kFormat, "byte " + std::to_string(at) + ": ");
  }

 private:
  JpegErrors errors_{};
  uint64_t file_bytes_ = 0;
  jpeg_progress_mgr progress_{};
  jpeg_decompress_struct reader_{};
  jpeg_compress_struct writer_{};
  unsigned char* out_ = nullptr;
  unsigned long out_bytes_ = 0;
};

/// Checks the size in the header before libjpeg allocates memory for it, or spends time on it.
Result<void> check_pixels(const format::JpegHeader& header, uint64_t bytes) {
  const uint64_t pixels = uint64_t{header.width} * header.height;
  if (pixels > runtime::kMaxImagePixels) {
    return Error{ErrorCode::kRange, "JPEG: " + std::to_string(uint32_t{header.width}) + " x " +
                                        std::to_string(uint32_t{header.height}) + " pixels, expected at most 2^28"};
  }
  if (!header.is_arithmetic && pixels / 64 > 8 * (bytes - header.data_offset)) {
    return Error{ErrorCode::kTruncated,
                 "JPEG: byte " + std::to_string(bytes) + ": the file ends, expected at least one bit per block"};
  }
  if (!runtime::may_hold_pixels(pixels, bytes)) {
    return Error{ErrorCode::kTruncated,
                 "JPEG: " + std::to_string(pixels) + " pixels in " + std::to_string(bytes) + " bytes"};
  }
  return {};
}

}  // namespace

Result<TranscodedJpeg> transcode_jpeg(std::span<const std::byte> file) {
  const auto header = SCREE_TRY(format::parse_jpeg(file));
  const format::JpegVerdict verdict = format::judge_jpeg(header);
  if (verdict.treatment == format::JpegTreatment::kRefuse || verdict.treatment == format::JpegTreatment::kReencode)
    return Error{ErrorCode::kUnsupported, "JPEG: " + verdict.reason};
  SCREE_TRY(check_pixels(header, file.size()));
  Transcoder transcoder;
  if (!transcoder.transcode(file)) return transcoder.failure();
  TranscodedJpeg result{transcoder.file(), (verdict.reason.empty() ? "sequential" : verdict.reason) +
                                               std::string(", stored as baseline with the same coefficients")};
  if (const std::string warning = transcoder.warning(); !warning.empty()) result.note += "; " + warning;
  return result;
}

Result<std::vector<std::byte>> encode_jpeg(const Image& image, int quality, bool is_grey) {
  JpegCoding coding;
  coding.width = image.width;
  coding.height = image.height;
  coding.colour = is_grey ? format::JpegColour::kGrey : format::JpegColour::kYcbcr;
  coding.quality = quality;
  auto writer = SCREE_TRY(JpegWriter::create(coding));
  const size_t channels = is_grey ? 1 : 3;
  std::vector<uint8_t> row(channels * image.width);
  for (uint32_t y = 0; y < image.height; ++y) {
    const uint8_t* from = image.rgba.data() + size_t{4} * image.width * y;
    for (size_t x = 0; x < image.width; ++x)
      for (size_t c = 0; c < channels; ++c) row[channels * x + c] = from[4 * x + c];
    SCREE_TRY(writer.row(row));
  }
  return writer.finish();
}

Result<TranscodedJpeg> reencode_jpeg(std::span<const std::byte> file, int quality) {
  const auto header = SCREE_TRY(format::parse_jpeg(file));
  const format::JpegVerdict verdict = format::judge_jpeg(header);
  if (verdict.treatment == format::JpegTreatment::kRefuse)
    return Error{ErrorCode::kUnsupported, "JPEG: " + verdict.reason};
  SCREE_TRY(check_pixels(header, file.size()));
  const auto image = SCREE_TRY(runtime::decode_image(file));
  auto coded = SCREE_TRY(encode_jpeg(image, quality));
  TranscodedJpeg result{std::move(coded), (verdict.reason.empty() ? "JPEG" : verdict.reason) +
                                              ", decoded and encoded again with quality " + std::to_string(quality)};
  if (!image.warning.empty()) result.note += "; " + image.warning;
  return result;
}

}  // namespace scree::convert
