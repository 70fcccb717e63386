#include "runtime/images/png_writer.h"

#include <algorithm>
#include <atomic>
#include <cassert>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <mutex>
#include <new>
#include <string_view>

#include <isa-l.h>
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
    const auto put = [&](size_t i, int left, int corner) {
      const uint8_t difference = static_cast<uint8_t>(row[i] - prediction<kFilter>(left, above[i], corner));
      to[i] = difference;
      return std::min(difference, static_cast<uint8_t>(-difference));
    };
    uint32_t sum = 0;
    for (size_t i = 0; i < channels_; ++i) sum += put(i, 0, 0);
    for (size_t i = channels_; i < size;) {
      uint16_t sum_of_piece = 0;  // 16 bits are faster
      for (const size_t end = std::min(i + 256, size); i < end; ++i)
        sum_of_piece = static_cast<uint16_t>(sum_of_piece + put(i, row[i - channels_], above[i - channels_]));
      sum += sum_of_piece;
    }
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

/// Deflates pieces of one stream, without zlib's header, to whole bytes, by ISA-L. It takes a sixth of the time of
/// zlib's level 1.
class Deflater {
 public:
  /// The deflated piece, valid until the next call. Other pieces may follow, unless `is_last`.
  std::span<const std::byte> deflate(std::span<uint8_t> piece, bool is_last) {
    isal_deflate_init(stream_.get());
    stream_->level = 2;
    stream_->level_buf = level_memory_.get();
    stream_->level_buf_size = ISAL_DEF_LVL2_DEFAULT;
    stream_->flush = FULL_FLUSH;
    stream_->end_of_stream = is_last ? 1 : 0;
    stream_->next_in = piece.data();
    stream_->avail_in = static_cast<uint32_t>(piece.size());
    for (;;) {
      const size_t done = stream_->total_out;
      out_.resize(std::max(out_.size(), done + piece.size() + 1024));
      stream_->next_out = reinterpret_cast<uint8_t*>(out_.data()) + done;
      stream_->avail_out = static_cast<uint32_t>(out_.size() - done);
      [[maybe_unused]] const int status = isal_deflate(stream_.get());
      assert(status == COMP_OK);
      if (stream_->avail_out != 0) return std::span(out_).first(stream_->total_out);
    }
  }

 private:
  std::unique_ptr<isal_zstream> stream_ = std::make_unique<isal_zstream>();
  std::unique_ptr<uint8_t[]> level_memory_ = std::make_unique<uint8_t[]>(ISAL_DEF_LVL2_DEFAULT);
  Bytes out_;
};

/// A strip of the image data. `data`: its IDAT chunk; of the last strip only the deflated bytes, because its chunk also
/// has the checksum of all strips.
struct Strip {
  Bytes data;
  uint32_t adler = 0;  // of the unpacked bytes
  size_t raw_bytes = 0;
};

/// Filters and deflates strips of a picture, one after the other. A thread has its own, whose memory is used again for
/// each strip.
class StripEncoder {
 public:
  StripEncoder(const PixelView& picture, uint32_t channels, bool is_small)
      : picture_(picture),
        channels_(channels),
        row_bytes_(size_t{picture.width} * channels),
        is_small_(is_small),
        filter_(row_bytes_, channels) {
    for (std::vector<uint8_t>& row : rgb_)
      if (channels != picture.channels) row.resize(row_bytes_);
  }

  /// Rows [first, first + count), deflated, and their checksum.
  std::span<const std::byte> encode(uint32_t first, uint32_t count, Strip& out) {
    raw_.resize((1 + row_bytes_) * count);
    const uint8_t* above = first == 0 ? nullptr : row(first - 1);
    for (uint32_t y = 0; y < count; ++y) {
      const uint8_t* const pixels = row(first + y);
      filter_.filter(pixels, above, is_small_, raw_.data() + y * (1 + row_bytes_));
      above = pixels;
    }
    out.raw_bytes = raw_.size();
    out.adler = isal_adler32(1, raw_.data(), raw_.size());
    return deflater_.deflate(raw_, first + count == picture_.height);
  }

 private:
  /// The pixels of a row, without their alpha if it is left out; valid for the next call too.
  const uint8_t* row(uint32_t y) {
    const uint8_t* const from = picture_.bytes.data() + size_t{y} * picture_.width * picture_.channels;
    if (channels_ == picture_.channels) return from;
    uint8_t* const to = rgb_[y % 2].data();
    for (size_t i = 0; i < picture_.width; ++i) std::memcpy(to + 3 * i, from + 4 * i, 3);
    return to;
  }

  const PixelView& picture_;
  const uint32_t channels_;
  const size_t row_bytes_;
  const bool is_small_;
  RowFilter filter_;
  Deflater deflater_;
  std::vector<uint8_t> rgb_[2];
  std::vector<uint8_t> raw_;
};

/// The encoders of the threads that work on a picture.
class StripEncoders {
 public:
  StripEncoders(const PixelView& picture, uint32_t channels, bool is_small)
      : picture_(picture), channels_(channels), is_small_(is_small) {}

  std::unique_ptr<StripEncoder> take() {
    {
      const std::lock_guard lock(mutex_);
      if (!free_.empty()) {
        std::unique_ptr<StripEncoder> taken = std::move(free_.back());
        free_.pop_back();
        return taken;
      }
    }
    return std::make_unique<StripEncoder>(picture_, channels_, is_small_);
  }
  void give_back(std::unique_ptr<StripEncoder> encoder) {
    const std::lock_guard lock(mutex_);
    free_.push_back(std::move(encoder));
  }

 private:
  const PixelView& picture_;
  const uint32_t channels_;
  const bool is_small_;
  std::mutex mutex_;
  std::vector<std::unique_ptr<StripEncoder>> free_;
};

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
  StripEncoders encoders(picture, channels, options.is_small);
  std::atomic<bool> is_left{false};
  constexpr std::byte kZlibHead[2] = {std::byte{0x78}, std::byte{0x01}};
  const auto head_of = [&](uint64_t strip) { return std::span<const std::byte>(kZlibHead, strip == 0 ? 2 : 0); };
  const auto make_strip = [&](uint64_t i) {
    if (is_left || (options.is_abandoned && options.is_abandoned())) return is_left.store(true);
    const uint32_t first = static_cast<uint32_t>(i) * per_strip;
    const uint32_t count = std::min(per_strip, picture.height - first);
    std::unique_ptr<StripEncoder> encoder = encoders.take();
    const std::span<const std::byte> deflated = encoder->encode(first, count, strips[i]);
    // The last one gets the checksum of all strips.
    if (i + 1 < strips.size()) {
      strips[i].data = make_chunk("IDAT", {head_of(i), deflated});
    } else {
      strips[i].data.assign(deflated.begin(), deflated.end());
    }
    encoders.give_back(std::move(encoder));
  };
  if (options.workers != nullptr) {
    options.workers->for_each(strips.size(), make_strip);
  } else {
    for (uint64_t i = 0; i < strips.size(); ++i) make_strip(i);
  }
  if (is_left) return {};

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
