#include "runtime/images/png_writer.h"

#include <algorithm>
#include <atomic>
#include <cassert>
#include <cstdlib>
#include <cstring>
#include <new>
#include <string_view>

#include <zlib.h>

namespace scree::runtime {
namespace {

using Bytes = std::vector<std::byte>;

constexpr size_t kStripBytes = size_t{256} << 10;  // smaller strips would lose a noticeable share at their ends

/// A row's bytes are stored as differences to predictions. Values are those of PNG (W3C Recommendation, 9.2).
enum class Filter : uint8_t { kSub = 1, kUp = 2, kAverage = 3, kPaeth = 4 };

template <Filter kFilter>
uint8_t prediction(int left, int above, int corner) {
  if constexpr (kFilter == Filter::kSub) return static_cast<uint8_t>(left);
  if constexpr (kFilter == Filter::kUp) return static_cast<uint8_t>(above);
  if constexpr (kFilter == Filter::kAverage) return static_cast<uint8_t>((left + above) / 2);
  const int by_left = std::abs(above - corner);
  const int by_above = std::abs(left - corner);
  const int by_corner = std::abs(left + above - 2 * corner);
  const int nearest = by_left <= by_above && by_left <= by_corner ? left : by_above <= by_corner ? above : corner;
  return static_cast<uint8_t>(nearest);
}

/// Tries filters for one row after the other, and takes the one whose differences are smallest in sum.
class RowFilter {
 public:
  RowFilter(size_t row_bytes, uint32_t channels) : channels_(channels), zeros_(row_bytes), differences_(row_bytes) {}

  /// Writes the filter's number and the differences to `out`. `above`: the row above, null for the first row.
  void filter(const uint8_t* row, const uint8_t* above, bool tries_all, uint8_t* out) {
    row_ = row;
    above_ = above != nullptr ? above : zeros_.data();
    least_ = ~uint32_t{0};
    attempt<Filter::kSub>(out);
    attempt<Filter::kUp>(out);
    if (!tries_all) return;
    attempt<Filter::kAverage>(out);
    attempt<Filter::kPaeth>(out);
  }

 private:
  template <Filter kFilter>
  void attempt(uint8_t* out) {
    const size_t size = differences_.size();
    const uint8_t* const row = row_;
    const uint8_t* const above = above_;
    uint8_t* const to = differences_.data();
    uint32_t sum = 0;
    const auto put = [&](size_t i, int left, int corner) {
      const uint8_t difference = static_cast<uint8_t>(row[i] - prediction<kFilter>(left, above[i], corner));
      to[i] = difference;
      sum += difference < 128 ? difference : 256u - difference;
    };
    for (size_t i = 0; i < channels_; ++i) put(i, 0, 0);
    for (size_t i = channels_; i < size; ++i) put(i, row[i - channels_], above[i - channels_]);
    if (sum >= least_) return;
    least_ = sum;
    out[0] = static_cast<uint8_t>(kFilter);
    std::memcpy(out + 1, to, size);
  }

  const size_t channels_;
  std::vector<uint8_t> zeros_;
  std::vector<uint8_t> differences_;
  const uint8_t* row_ = nullptr;
  const uint8_t* above_ = nullptr;
  uint32_t least_ = 0;
};

/// A strip of the image data: deflate blocks that end at a byte, and the checksum of their unpacked bytes. `data` are
/// the bytes of its IDAT chunk, of the last strip those that go into it.
struct Strip {
  Bytes data;
  uint32_t adler = 0;
  size_t raw_bytes = 0;
};

/// `count` RGBA pixels without their alpha.
std::vector<uint8_t> without_alpha(const uint8_t* rgba, size_t count) {
  std::vector<uint8_t> rgb(3 * count);
  for (size_t i = 0; i < count; ++i) std::memcpy(rgb.data() + 3 * i, rgba + 4 * i, 3);
  return rgb;
}

/// A deflater of raw data, without zlib's header, with a window of 32 KiB.
class Deflater {
 public:
  explicit Deflater(int level)
      : is_open_(deflateInit2(&stream, level, Z_DEFLATED, -15, 8, Z_DEFAULT_STRATEGY) == Z_OK) {}
  Deflater(const Deflater&) = delete;
  Deflater& operator=(const Deflater&) = delete;
  ~Deflater() {
    if (is_open_) deflateEnd(&stream);
  }
  bool is_open() const { return is_open_; }  // false: no memory

  z_stream stream{};

 private:
  const bool is_open_;
};

/// Filters and deflates rows [first, first + count). Returns false if zlib has no memory.
bool deflate_strip(const PixelView& picture, uint32_t channels, uint32_t first, uint32_t count, bool is_small,
                   Strip& out) {
  const size_t row_bytes = size_t{picture.width} * channels;
  const uint32_t before = first == 0 ? 0 : 1;  // the row above the strip
  const uint8_t* rows = picture.bytes.data() + size_t{first - before} * picture.width * picture.channels;
  std::vector<uint8_t> rgb;
  if (channels != picture.channels) {
    rgb = without_alpha(rows, size_t{picture.width} * (count + before));
    rows = rgb.data();
  }
  std::vector<uint8_t> raw((1 + row_bytes) * count);
  RowFilter filter(row_bytes, channels);
  for (uint32_t y = 0; y < count; ++y) {
    const uint8_t* const row = rows + (y + before) * row_bytes;
    filter.filter(row, y + before == 0 ? nullptr : row - row_bytes, is_small, raw.data() + y * (1 + row_bytes));
  }
  out.raw_bytes = raw.size();
  out.adler = static_cast<uint32_t>(adler32_z(1, raw.data(), raw.size()));
  Deflater deflater(is_small ? 3 : 1);
  if (!deflater.is_open()) return false;
  z_stream& stream = deflater.stream;
  const bool is_last = first + count == picture.height;
  out.data.resize(deflateBound(&stream, static_cast<uLong>(raw.size())) + 16);
  stream.next_in = raw.data();
  stream.avail_in = static_cast<uInt>(raw.size());
  stream.next_out = reinterpret_cast<Bytef*>(out.data.data());
  stream.avail_out = static_cast<uInt>(out.data.size());
  const int status = deflate(&stream, is_last ? Z_FINISH : Z_FULL_FLUSH);
  const bool is_done = status == (is_last ? Z_STREAM_END : Z_OK) && stream.avail_in == 0 && stream.avail_out > 0;
  out.data.resize(stream.total_out);
  return is_done;
}

void append_big_endian(Bytes& out, uint32_t value) {
  append_bytes(out, value >> 24, value >> 16, value >> 8, value);
}

/// A chunk whose data are the joined `parts`.
Bytes make_chunk(std::string_view type, std::initializer_list<std::span<const std::byte>> parts) {
  size_t size = 0;
  for (const std::span<const std::byte>& part : parts) size += part.size();
  Bytes out;
  out.reserve(size + 12);
  append_big_endian(out, static_cast<uint32_t>(size));
  const auto append = [&](std::span<const std::byte> more) { out.insert(out.end(), more.begin(), more.end()); };
  append(std::as_bytes(std::span(type)));
  for (const std::span<const std::byte>& part : parts) append(part);
  append_big_endian(out,
                    static_cast<uint32_t>(crc32_z(0, reinterpret_cast<const Bytef*>(out.data() + 4), out.size() - 4)));
  return out;
}

Error out_of_memory() {
  return {ErrorCode::kMemory, "no memory left to encode a picture"};
}

/// Passes the bytes of the file to take(), piece by piece; none if the picture was abandoned.
template <class Take>
Result<void> make_png(const PixelView& picture, const PngOptions& options, const Take& take) try {
  assert(picture.channels == 3 || picture.channels == 4);
  assert(picture.bytes.size() == uint64_t{picture.width} * picture.height * picture.channels);
  const uint32_t channels = options.has_alpha ? picture.channels : 3;
  const size_t row_bytes = size_t{picture.width} * channels;
  assert(row_bytes <= size_t{1} << 24);
  const uint32_t per_strip = static_cast<uint32_t>(std::max(kStripBytes / (row_bytes + 1), size_t{1}));
  std::vector<Strip> strips((picture.height + per_strip - 1) / per_strip);
  std::atomic<bool> is_left{false}, has_failed{false};
  constexpr std::byte kZlibHead[2] = {std::byte{0x78}, std::byte{0x01}};
  const auto head_of = [&](uint64_t strip) { return std::span<const std::byte>(kZlibHead, strip == 0 ? 2 : 0); };
  const auto make_strip = [&](uint64_t i) {
    if (is_left || (options.is_abandoned && options.is_abandoned())) return is_left.store(true);
    const uint32_t first = static_cast<uint32_t>(i) * per_strip;
    const uint32_t count = std::min(per_strip, picture.height - first);
    if (!deflate_strip(picture, channels, first, count, options.is_small, strips[i])) has_failed = true;
    // The last one gets the checksum of all strips.
    if (i + 1 < strips.size()) strips[i].data = make_chunk("IDAT", {head_of(i), strips[i].data});
  };
  if (options.workers != nullptr) {
    options.workers->for_each(strips.size(), make_strip);
  } else {
    for (uint64_t i = 0; i < strips.size(); ++i) make_strip(i);
  }
  if (is_left) return {};
  if (has_failed) return out_of_memory();

  Bytes head;
  append_big_endian(head, picture.width);
  append_big_endian(head, picture.height);
  append_bytes(head, 8, channels == 4 ? 6 : 2, 0, 0, 0);  // bits, RGBA or RGB, deflate, filters per row, not interlaced
  Bytes file;
  append_bytes(file, 0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n');
  constexpr std::byte kPerceptual[1] = {};
  for (const Bytes& chunk : {make_chunk("IHDR", {head}), make_chunk("sRGB", {kPerceptual})})
    file.insert(file.end(), chunk.begin(), chunk.end());
  Result<void> taken = take(file);
  uint32_t adler = 1;
  for (size_t i = 0; taken && i < strips.size(); ++i) {
    Strip& strip = strips[i];
    adler = static_cast<uint32_t>(adler32_combine(adler, strip.adler, static_cast<z_off_t>(strip.raw_bytes)));
    if (i + 1 == strips.size()) {
      Bytes end;
      append_big_endian(end, adler);
      strip.data = make_chunk("IDAT", {head_of(i), strip.data, end});
    }
    taken = take(strip.data);
    strip.data = {};
  }
  return taken ? take(make_chunk("IEND", {})) : taken;
} catch (const std::bad_alloc&) {
  return out_of_memory();
}

}  // namespace

Result<Bytes> encode_png(const PixelView& picture, const PngOptions& options) {
  Bytes file;
  const Result<void> made = make_png(picture, options, [&](const Bytes& more) -> Result<void> {
    file.insert(file.end(), more.begin(), more.end());
    return {};
  });
  if (!made) return made.error();
  return file;
}

Result<void> write_png(const std::string& path, const PixelView& picture, const PngOptions& options,
                       format::Existing existing) {
  format::PartFile file = SCREE_TRY(format::PartFile::create(path, format::PartFile::Content::kEmpty, existing));
  uint64_t end = 0;
  const Result<void> made = make_png(picture, options, [&](const Bytes& more) {
    const Result<void> done = file.write_at(end, more);
    end += more.size();
    return done;
  });
  if (!made) return made.error().code == ErrorCode::kFile ? made.error() : at(path, made.error());
  return end != 0 ? file.commit() : Result<void>();
}

}  // namespace scree::runtime
