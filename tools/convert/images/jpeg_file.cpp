#include "tools/convert/images/jpeg_file.h"

#include <new>
#include <utility>

#include "format/jpeg/index.h"
#include "tools/convert/images/jpeg_transcode.h"

namespace scree::convert {
namespace {

using format::JpegTreatment;

Result<std::vector<std::byte>> encode(const format::JpegHeader& header, std::span<const std::byte> file) {
  const auto bound = SCREE_TRY(format::jpeg_index_bound(header, file.size()));
  std::vector<std::byte> bytes(bound);
  const auto encoded = SCREE_TRY(format::encode_jpeg_index(bytes, header, file));
  bytes.resize(encoded.bytes);
  bytes.shrink_to_fit();
  return bytes;
}

Result<IndexedJpeg> index_or_throw(std::span<const std::byte> file) {
  const auto header = SCREE_TRY(format::parse_jpeg(file));
  const format::JpegVerdict verdict = format::judge_jpeg(header);
  if (verdict.treatment == JpegTreatment::kRefuse) return Error{ErrorCode::kUnsupported, "JPEG: " + verdict.reason};
  if (verdict.treatment == JpegTreatment::kAsItIs) {
    Result<std::vector<std::byte>> bytes = encode(header, file);
    if (bytes) return IndexedJpeg{std::move(*bytes), {}};
    // A scan that repeats a component is found only after the first scan. Transcoding combines the coefficients of all
    // scans.
    if (bytes.error().code != ErrorCode::kUnsupported) return bytes.error();
  }
  TranscodedJpeg other = SCREE_TRY(verdict.treatment == JpegTreatment::kReencode ? reencode_jpeg(file, kReencodeQuality)
                                                                                 : transcode_jpeg(file));
  const auto other_header = SCREE_TRY(format::parse_jpeg(other.file));
  std::vector<std::byte> bytes = SCREE_TRY(encode(other_header, other.file));
  return IndexedJpeg{std::move(bytes), std::move(other.note)};
}

}  // namespace

Result<IndexedJpeg> index_jpeg(std::span<const std::byte> file) try {
  return index_or_throw(file);
} catch (const std::bad_alloc&) {
  return Error{ErrorCode::kMemory, "JPEG: out of memory"};
}

}  // namespace scree::convert
