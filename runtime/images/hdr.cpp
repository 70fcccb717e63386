#include "runtime/images/hdr.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <string>
#include <string_view>
#include <vector>

namespace scree::runtime {
namespace {

constexpr size_t kMostHeaderBytes = 64 << 10;

Error error(ErrorCode code, std::string text) {
  return {code, "HDR: " + std::move(text)};
}

class Reader {
 public:
  explicit Reader(std::span<const std::byte> file) : file_(file) {}

  Result<HdrSize> header() {
    std::string_view text(reinterpret_cast<const char*>(file_.data()), std::min(file_.size(), kMostHeaderBytes));
    if (!text.starts_with("#?")) return error(ErrorCode::kFormat, "is no Radiance picture, which begins with #?");
    // The header's lines end with an empty line. The line after it has the size.
    bool is_size = false;
    size_t at = 0;
    while (true) {
      const size_t end = text.find('\n', at);
      if (end == std::string_view::npos) return error(ErrorCode::kTruncated, "the header has no end");
      std::string_view line = text.substr(at, end - at);
      if (line.ends_with('\r')) line.remove_suffix(1);
      at = end + 1;
      if (is_size) {
        at_ = at;
        return size_of(line);
      }
      if (line.empty()) is_size = true;
      if (line.starts_with("FORMAT=") && line != "FORMAT=32-bit_rle_rgbe")
        return error(ErrorCode::kUnsupported, "a format other than 32-bit_rle_rgbe");
    }
  }

  /// Reads the next row: 4 bytes per pixel, red, green, blue and exponent.
  Result<void> row(std::span<uint8_t> rgbe) {
    const size_t width = rgbe.size() / 4;
    if (left() >= 4 && width >= 8 && width < 32768 && byte(0) == 2 && byte(1) == 2 && byte(2) == width >> 8 &&
        byte(3) == (width & 255)) {
      at_ += 4;
      return runs(rgbe, width);
    }
    return pixels(rgbe, width);
  }

 private:
  static Result<HdrSize> size_of(std::string_view line) {
    HdrSize size;
    const char* const end = line.data() + line.size();
    if (!line.starts_with("-Y ")) return order();
    const auto height = std::from_chars(line.data() + 3, end, size.height);
    const std::string_view rest(height.ptr, static_cast<size_t>(end - height.ptr));
    if (height.ec != std::errc{} || !rest.starts_with(" +X ")) return order();
    const auto width = std::from_chars(rest.data() + 4, end, size.width);
    if (width.ec != std::errc{} || width.ptr != end) return order();
    if (size.width == 0 || size.height == 0 || uint64_t{size.width} * size.height > kMaxHdrPixels)
      return error(ErrorCode::kRange, std::to_string(size.width) + " x " + std::to_string(size.height) +
                                          " pixels, expected 1 to " + std::to_string(kMaxHdrPixels));
    if (size.width > kMaxHdrWidth)  // a row is held in memory before it is read
      return error(ErrorCode::kRange, "rows of " + std::to_string(size.width) + " pixels, expected at most " +
                                          std::to_string(kMaxHdrWidth));
    return size;
  }
  static Error order() { return error(ErrorCode::kUnsupported, "the size is not given as -Y HEIGHT +X WIDTH"); }
  static Error truncated() { return error(ErrorCode::kTruncated, "the file ends"); }

  size_t left() const { return file_.size() - at_; }
  uint8_t byte(size_t offset) const { return static_cast<uint8_t>(file_[at_ + offset]); }

  /// Reads a row that is run-length coded channel by channel. A count above 128 repeats the next byte count - 128
  /// times; another count is the number of bytes that follow.
  Result<void> runs(std::span<uint8_t> rgbe, size_t width) {
    for (size_t channel = 0; channel < 4; ++channel) {
      for (size_t x = 0; x < width;) {
        if (left() < 2) return truncated();
        const uint8_t count = byte(0);
        const bool is_run = count > 128;
        const size_t length = is_run ? count - 128u : count;
        const size_t bytes = is_run ? 1 : length;
        if (length == 0 || length > width - x) return error(ErrorCode::kFormat, "a run passes the row's end");
        if (left() < 1 + bytes) return truncated();
        for (size_t i = 0; i < length; ++i) rgbe[4 * (x + i) + channel] = byte(1 + (is_run ? 0 : i));
        at_ += 1 + bytes;
        x += length;
      }
    }
    return {};
  }

  /// Reads a row of pixels. The pixel (1, 1, 1, n) is a repeat: it repeats the pixel before n times. The next repeat in
  /// a row of repeats counts 256 times as much.
  Result<void> pixels(std::span<uint8_t> rgbe, size_t width) {
    uint32_t shift = 0;
    for (size_t x = 0; x < width;) {
      if (left() < 4) return truncated();
      const std::array<uint8_t, 4> pixel{byte(0), byte(1), byte(2), byte(3)};
      at_ += 4;
      if (pixel[0] != 1 || pixel[1] != 1 || pixel[2] != 1) {
        std::copy(pixel.begin(), pixel.end(), rgbe.begin() + static_cast<ptrdiff_t>(4 * x));
        ++x;
        shift = 0;
        continue;
      }
      const uint64_t count = shift < 32 ? uint64_t{pixel[3]} << shift : UINT64_MAX;
      if (x == 0 || count > width - x) return error(ErrorCode::kFormat, "a run passes the row's end");
      for (uint64_t i = 0; i < count; ++i, ++x) std::copy_n(&rgbe[4 * (x - 1)], 4, &rgbe[4 * x]);
      shift += 8;
    }
    return {};
  }

  std::span<const std::byte> file_;
  size_t at_ = 0;
};

}  // namespace

Result<HdrSize> read_hdr_size(std::span<const std::byte> file) {
  return Reader(file).header();
}

Result<void> read_hdr(std::span<const std::byte> file,
                      const std::function<void(uint32_t y, std::span<const float> row)>& take) {
  Reader reader(file);
  const HdrSize size = SCREE_TRY(reader.header());
  std::array<float, 256> scale{};  // by exponent; exponent 0 is black
  for (int i = 1; i < 256; ++i) scale[static_cast<size_t>(i)] = std::ldexp(1.0f, i - 136);
  std::vector<uint8_t> rgbe(size_t{4} * size.width);
  std::vector<float> row(size_t{3} * size.width);
  for (uint32_t y = 0; y < size.height; ++y) {
    if (const Result<void> read = reader.row(rgbe); !read)
      return Error{read.error().code, read.error().message + ", in row " + std::to_string(y)};
    for (size_t x = 0; x < size.width; ++x)
      for (size_t c = 0; c < 3; ++c)
        row[3 * x + c] = (static_cast<float>(rgbe[4 * x + c]) + 0.5f) * scale[rgbe[4 * x + 3]];
    take(y, row);
  }
  return {};
}

}  // namespace scree::runtime
