// WebP files: lossless files decode to the encoded pixels, lossy files to similar ones; malformed files are refused.
#include <array>
#include <cstdlib>
#include <cstring>

#include "runtime/images/image.h"
#include "tests/results.h"
#include "tests/runtime/images/webp_files.h"

namespace scree::runtime {
namespace {

using tests::make_webp;
using tests::smooth_pixels;

/// A file that is read on demand.
ImageFile read_from(const std::vector<std::byte>& file) {
  return {file.size(), [&](uint64_t offset, std::span<std::byte> out) -> Result<void> {
            std::memcpy(out.data(), file.data() + offset, out.size());
            return {};
          }};
}

std::vector<std::byte> cut(std::vector<std::byte> file, size_t size) {
  file.resize(size);
  file.shrink_to_fit();
  return file;
}

TEST_CASE("a WebP decodes to the encoded picture", "[webp]") {
  for (const bool has_alpha : {false, true})
    for (const auto& [width, height] : {std::pair{1u, 1u}, {37u, 19u}, {300u, 200u}}) {
      const std::vector<uint8_t> pixels = smooth_pixels(width, height, has_alpha);
      const auto exact = make_webp(pixels, width, height);
      const auto info = must(probe_image(exact));
      CHECK(info.is_webp);
      CHECK(info.codec == format::ImageCodec::kPng);
      CHECK(info.width == width);
      CHECK(info.height == height);
      CHECK(info.channels == (has_alpha && width > 1 ? 4u : 3u));  // a single pixel is opaque
      for (const auto& image : {decode_image(exact), decode_image(read_from(exact))}) {
        REQUIRE(image);
        CHECK((image->rgba == pixels));
        CHECK(image->warning.empty());
      }
      CHECK(check_image(read_from(exact)));
      const auto lossy = must(decode_image(make_webp(pixels, width, height, 95)));
      REQUIRE(lossy.rgba.size() == pixels.size());
      int off = 0;
      for (size_t i = 0; i < pixels.size(); ++i) off = std::max(off, std::abs(int{lossy.rgba[i]} - int{pixels[i]}));
      CHECK(off <= 12);
    }
}

TEST_CASE("malformed WebP files are refused with one line", "[webp][bad]") {
  const std::vector<uint8_t> pixels = smooth_pixels(24, 16, true);
  for (const float quality : {0.0f, 80.0f}) {
    const std::vector<std::byte> whole = make_webp(pixels, 24, 16, quality);
    for (size_t size = 0; size < whole.size(); ++size)
      CHECK(refusal(check_image(cut(whole, size))).message.find('\n') == std::string::npos);
    const auto half = check_image(cut(whole, whole.size() / 2));
    CHECK(half.error().code == ErrorCode::kTruncated);
    CHECK(half.error().message == "WebP: ends before its data do");
    // Any damage gives an error or a picture of this size.
    for (size_t i = 0; i < whole.size() * 8; ++i) {
      std::vector<std::byte> bad = whole;
      bad[i / 8] ^= std::byte{1} << i % 8;
      const auto info = probe_image(bad);
      const auto image = decode_image(bad);
      CHECK(bool(image) == bool(check_image(bad)));
      if (image) CHECK(image->rgba.size() == size_t{4} * info->width * info->height);
    }
  }
}

TEST_CASE("an animated WebP is refused", "[webp][bad]") {
  constexpr std::array<unsigned char, 30> kHead = {'R', 'I', 'F', 'F', 22, 0, 0, 0, 'W', 'E', 'B', 'P', 'V', 'P', '8',
                                                   'X', 10,  0,   0,   0,  2, 0, 0, 0,   7,   0,   0,   7,   0,   0};
  std::vector<std::byte> file(kHead.size());
  std::memcpy(file.data(), kHead.data(), kHead.size());
  check_refusal(probe_image(file), {ErrorCode::kUnsupported, "WebP: an animation, but glTF has still pictures"});
}

TEST_CASE("a large WebP of one colour is read", "[webp]") {
  const uint32_t side = 2048;
  const std::vector<std::byte> file = make_webp(std::vector<uint8_t>(size_t{4} * side * side, 200), side, side);
  const auto checked = check_image(file);
  INFO(file.size());
  if (!checked) FAIL(checked.error().message);
}

}  // namespace
}  // namespace scree::runtime
