#include "tools/view/encode.h"

#include <algorithm>
#include <cassert>
#include <memory>
#include <new>

#include <turbojpeg.h>

#include "runtime/images/jpeg_head.h"

namespace scree::tools::view {
namespace {

using runtime::append_bytes;

using Bytes = std::vector<std::byte>;

/// Rows per strip: at least `least`, and few enough for a few strips per thread, so that no thread waits long for the
/// last strip.
uint32_t rows_per_strip(uint32_t rows, uint32_t threads, uint32_t least) {
  const uint32_t strips = std::max(1u, threads > 1 ? 3 * threads : 2);
  return std::max((rows + strips - 1) / strips, least);
}

void append(Bytes& out, std::span<const std::byte> more) {
  out.insert(out.end(), more.begin(), more.end());
}

struct TurboFree {
  void operator()(void* handle) const { tjDestroy(handle); }
};

/// The compressor of this thread, made once because making it clears 100 KB.
tjhandle compressor() {
  thread_local std::unique_ptr<void, TurboFree> handle(tjInitCompress());
  return handle.get();
}

/// A whole JPEG of rows [first, first + count); empty if libjpeg fails, for lack of memory.
Bytes jpeg_strip(const PixelView& picture, uint32_t first, uint32_t count, int quality, int sampling) {
  const tjhandle handle = compressor();
  if (handle == nullptr) return {};
  Bytes out(tjBufSize(static_cast<int>(picture.width), static_cast<int>(count), sampling));
  auto* place = reinterpret_cast<unsigned char*>(out.data());
  unsigned long size = out.size();
  const size_t row_bytes = size_t{picture.width} * picture.channels;
  const int failed =
      tjCompress2(handle, picture.bytes.data() + first * row_bytes, static_cast<int>(picture.width),
                  static_cast<int>(row_bytes), static_cast<int>(count), picture.channels == 4 ? TJPF_RGBX : TJPF_RGB,
                  &place, &size, sampling, quality, TJFLAG_NOREALLOC | TJFLAG_FASTDCT);
  out.resize(failed != 0 ? 0 : size);
  return out;
}

/// Joins the strips' data after one common header. Each strip starts from a DC of 0 at a byte boundary, as after a
/// restart marker. Source: T.81, B.2.1, B.2.4.4. Errors as parse_jpeg().
Result<Bytes> join_strips(Bytes head, const std::vector<Bytes>& strips) {
  Bytes out = std::move(head);
  size_t total = out.size() + 2;
  for (const Bytes& strip : strips) total += strip.size();
  out.reserve(total);
  for (size_t i = 0; i < strips.size(); ++i) {
    const format::JpegHeader header = SCREE_TRY(format::parse_jpeg(strips[i]));
    if (i != 0) append_bytes(out, 0xff, 0xd0 + (i - 1) % 8);
    const std::span<const std::byte> strip(strips[i]);
    append(out, strip.first(strip.size() - 2).subspan(header.data_offset));  // without the EOI marker
  }
  append_bytes(out, 0xff, 0xd9);
  return out;
}

Error out_of_memory() {
  return {ErrorCode::kMemory, "no memory left to encode a picture"};
}

}  // namespace

Result<Bytes> encode_jpeg(const PixelView& picture, int quality, bool is_sharp, runtime::Workers& workers,
                          const IsAbandoned& is_abandoned) try {
  assert(picture.bytes.size() == size_t{picture.width} * picture.height * picture.channels);
  const int sampling = is_sharp ? TJSAMP_444 : TJSAMP_420;
  const uint32_t mcu = is_sharp ? 8 : 16;
  const uint32_t mcus_across = (picture.width + mcu - 1) / mcu;
  const uint32_t mcu_rows = (picture.height + mcu - 1) / mcu;
  // At most 65,535 MCUs between restart markers: 16 bits.
  const uint32_t per_strip = std::min(rows_per_strip(mcu_rows, workers.count(), 2), std::max(65535 / mcus_across, 1u));
  const uint32_t strip_count = (mcu_rows + per_strip - 1) / per_strip;
  std::vector<Bytes> strips(strip_count);
  std::atomic<bool> is_left{false};
  workers.for_each(strip_count, [&](uint64_t i) {
    if (is_left || (is_abandoned && is_abandoned())) return is_left.store(true);
    const uint32_t first = static_cast<uint32_t>(i) * per_strip * mcu;
    strips[i] = jpeg_strip(picture, first, std::min(per_strip * mcu, picture.height - first), quality, sampling);
  });
  if (is_left) return Bytes();
  if (std::any_of(strips.begin(), strips.end(), [](const Bytes& strip) { return strip.empty(); }))
    return out_of_memory();
  runtime::JpegHead head = SCREE_TRY(runtime::make_jpeg_head(picture.width, picture.height, quality, is_sharp,
                                                             static_cast<uint16_t>(per_strip * mcus_across)));
  return join_strips(std::move(head.bytes), strips);
} catch (const std::bad_alloc&) {
  return out_of_memory();
}

}  // namespace scree::tools::view
