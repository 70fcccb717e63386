#include "runtime/images/image.h"
#include "runtime/images/png_writer.h"

#include <array>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <limits>
#include <random>
#include <span>
#include <string>
#include <vector>

#include "tests/format/jpeg/jpeg_maker.h"
#include "tests/full_disk.h"
#include "tests/models.h"
#include "tests/results.h"
#include "tests/tools/flat_images.h"
#include "tests/tools/temp_folder.h"

using namespace scree;
using namespace scree::runtime;
using namespace scree::tests;
using scree::format::ImageCodec;

namespace {

std::vector<uint8_t> noise(size_t size) {
  std::mt19937 random(7);
  std::vector<uint8_t> bytes(size);
  for (uint8_t& byte : bytes) byte = static_cast<uint8_t>(random());
  return bytes;
}

/// Checks that check_image and decode_image agree on a file, both in memory and read on demand.
void check_agrees(const std::vector<std::byte>& file) {
  const Result<Image> decoded = decode_image(file);
  const auto read = [&](uint64_t offset, std::span<std::byte> out) -> Result<void> {
    REQUIRE(offset + out.size() <= file.size());
    std::memcpy(out.data(), file.data() + offset, out.size());
    return {};
  };
  for (const bool is_read : {false, true}) {
    const Result<std::string> checked = check_image(is_read ? ImageFile(file.size(), read) : ImageFile(file));
    REQUIRE(static_cast<bool>(checked) == static_cast<bool>(decoded));
    if (decoded) {
      CHECK(*checked == decoded->warning);
    } else {
      CHECK(checked.error().code == decoded.error().code);
      CHECK(checked.error().message == decoded.error().message);
    }
  }
}

/// A JPEG with restart markers.
std::vector<std::byte> make_jpeg(int width, int height, size_t components, bool is_progressive) {
  return scree::tests::make_jpeg({.width = width,
                                  .height = height,
                                  .factors = std::vector(components, std::pair(1, 1)),
                                  .restart = 20,
                                  .is_progressive = is_progressive});
}

/// Checks the file, truncated copies and copies with flipped bits.
void check_agrees_when_damaged(const std::vector<std::byte>& file, int times) {
  check_agrees(file);
  std::mt19937 random(11);
  for (int i = 0; i < times; ++i) {
    std::vector<std::byte> damaged(file.begin(), file.begin() + static_cast<std::ptrdiff_t>(file.size() * i / times));
    check_agrees(damaged);
    damaged = file;
    for (int flips = 0; flips <= i % 4; ++flips)
      damaged[random() % file.size()] ^= static_cast<std::byte>(1u << (random() % 8));
    check_agrees(damaged);
  }
}

}  // namespace

TEST_CASE("a PNG is read as it was written", "[image]") {
  const ScratchPath scratch("round.png");
  const std::string path = scratch.string();
  for (const uint32_t channels : {3u, 4u}) {
    for (const auto& [width, height] : {std::array{1u, 1u}, std::array{7u, 5u}, std::array{300u, 2u}}) {
      const std::vector<uint8_t> pixels = noise(size_t{width} * height * channels);
      REQUIRE(scree::runtime::write_png(path, {width, height, channels, pixels}));
      const std::vector<std::byte> file = read_bytes(path);
      const ImageInfo info = must(probe_image(file));
      CHECK(info.codec == ImageCodec::kPng);
      CHECK(info.width == width);
      CHECK(info.height == height);
      CHECK(info.channels == channels);
      const Image image = must(decode_image(file));
      REQUIRE(image.rgba.size() == size_t{4} * width * height);
      bool same = true;
      for (size_t i = 0; i < size_t{width} * height; ++i)
        for (size_t c = 0; c < 4; ++c) same &= image.rgba[4 * i + c] == (c < channels ? pixels[i * channels + c] : 255);
      CHECK(same);

      for (size_t size = 0; size < file.size();
           size += 1 + file.size() / 50) {  // every prefix is an error, never a crash
        const std::vector<std::byte> prefix(file.begin(), file.begin() + static_cast<std::ptrdiff_t>(size));
        (void)decode_image(prefix);
        if (size < file.size() - 40) CHECK_FALSE(decode_image(prefix));
      }
    }
  }
  CHECK_FALSE(std::filesystem::exists(path + ".part"));
}

TEST_CASE("a picture that cannot be written leaves no file", "[image]") {
  const std::vector<uint8_t> pixels(3, 0);
  const TempFolder folder;
  check_refusal(scree::runtime::write_png(folder.file("none/a.png"), {1, 1, 3, pixels}), ErrorCode::kFile,
                "No such file");

  folder.write("folder.png/x", "");  // the rename fails
  CHECK_FALSE(scree::runtime::write_png(folder.file("folder.png"), {1, 1, 3, pixels}));
  CHECK(folder.names().size() == 1);

  const std::string full = folder.file("full.pfm");
  const std::vector<float> values(100, 1.0f);
  const auto write_floats = [&] { return scree::runtime::write_pfm(full, 10, 10, values); };
  check_refusal(on_full_disk(100, write_floats), ErrorCode::kFile, "full.pfm.part: write: File too large");
  const std::vector<uint8_t> rgb(300, 7);
  const auto write_bytes = [&] { return scree::runtime::write_png(full, {10, 10, 3, rgb}); };
  check_refusal(on_full_disk(10, write_bytes), ErrorCode::kFile, "File too large");
  CHECK(folder.names().size() == 1);
}

TEST_CASE("a PFM has its rows bottom to top, little-endian", "[image]") {
  const ScratchPath scratch("depth.pfm");
  const std::string path = scratch.string();
  const std::vector<float> values{1.0f, 2.0f, 3.0f, 4.0f, 5.0f, std::numeric_limits<float>::infinity()};
  REQUIRE(scree::runtime::write_pfm(path, 2, 3, values));
  const std::vector<std::byte> file = read_bytes(path);
  const std::string head = "Pf\n2 3\n-1.0\n";
  REQUIRE(file.size() == head.size() + 24);
  CHECK(std::memcmp(file.data(), head.data(), head.size()) == 0);
  std::array<float, 6> rows{};
  std::memcpy(rows.data(), file.data() + head.size(), 24);
  CHECK(rows[0] == 5.0f);
  CHECK(std::isinf(rows[1]));
  CHECK(rows[2] == 3.0f);
  CHECK(rows[4] == 1.0f);
  CHECK(rows[5] == 2.0f);
}

TEST_CASE("a visibility buffer file has its words and nothing else", "[image]") {
  const ScratchPath scratch("visibility.bin");
  const std::string path = scratch.string();
  const std::vector<uint64_t> samples{0x0123456789abcdefu, ~uint64_t{0}};
  REQUIRE(scree::runtime::write_visibility(path, samples));
  const std::vector<std::byte> file = read_bytes(path);
  REQUIRE(file.size() == 16);
  CHECK(std::memcmp(file.data(), samples.data(), 16) == 0);
}

TEST_CASE("a file that is no image is named", "[image]") {
  const std::vector<std::byte> empty;
  REQUIRE_FALSE(probe_image(empty));
  CHECK(probe_image(empty).error().code == ErrorCode::kTruncated);
  const char riff[] = "RIFF....WAVEfmt ";
  std::vector<std::byte> wave(sizeof riff);
  std::memcpy(wave.data(), riff, sizeof riff);
  REQUIRE_FALSE(probe_image(wave));
  CHECK(probe_image(wave).error().message == "no PNG, JPEG, WebP, KTX2 or DDS: begins with 52 49 46 46");
}

TEST_CASE("a huge picture in a few bytes is refused before memory is allocated", "[image]") {
  const ScratchPath scratch("bomb.png");
  const std::string path = scratch.string();
  REQUIRE(scree::runtime::write_png(path, {2, 2, 3, noise(12)}));
  std::vector<std::byte> file = read_bytes(path);
  file[16] = file[20] = std::byte{0};
  file[17] = file[21] = std::byte{0};
  file[18] = file[22] = std::byte{0x20};  // 8194 x 8194
  CHECK(refusal(decode_image(file)).code == ErrorCode::kTruncated);
  file[17] = std::byte{1};  // 81920 wide
  CHECK(refusal(decode_image(file)).code == ErrorCode::kRange);

  // A JPEG may lack some data, but not all of it.
  const std::string flat = scree::tests::flat_jpeg(64, scree::tests::JpegKind::kBaseline);
  file.assign(reinterpret_cast<const std::byte*>(flat.data()),
              reinterpret_cast<const std::byte*>(flat.data() + flat.size()));
  size_t frame = 2;  // SOF0
  while (file[frame] != std::byte{0xff} || file[frame + 1] != std::byte{0xc0}) ++frame;
  file[frame + 5] = file[frame + 7] = std::byte{0x3f};  // 16383 x 16383
  file[frame + 6] = file[frame + 8] = std::byte{0xff};
  REQUIRE(file.size() < 8192);
  const std::string words = "pixels in " + std::to_string(file.size()) + " bytes";
  check_refusal(decode_image(file), ErrorCode::kTruncated, words);
  CHECK(refusal(check_image(file)).message == refusal(decode_image(file)).message);
}

TEST_CASE("the check accepts exactly the images that decode", "[image]") {
  for (const size_t components : {1u, 3u, 4u})
    for (const bool is_progressive : {false, true})
      check_agrees_when_damaged(make_jpeg(173, 91, components, is_progressive), 40);
  const ScratchPath scratch("check.png");
  const std::string path = scratch.string();
  REQUIRE(scree::runtime::write_png(path, {301, 200, 4, noise(size_t{301} * 200 * 4)}));
  check_agrees_when_damaged(read_bytes(path), 40);
  scree::tests::write_flat_png(path, 203, true);
  check_agrees_when_damaged(read_bytes(path), 40);
  for (const auto kind : {scree::tests::JpegKind::kBaseline, scree::tests::JpegKind::kProgressive}) {
    const std::string text = scree::tests::flat_jpeg(128, kind);
    const auto* const bytes = reinterpret_cast<const std::byte*>(text.data());
    const std::vector<std::byte> file(bytes, bytes + text.size());
    const Image image = must(decode_image(file));
    CHECK(image.warning.empty());
    for (const size_t i : {size_t{0}, image.rgba.size() - 4}) CHECK(image.rgba[i] == 128);
    check_agrees_when_damaged(file, 40);
  }
}

TEST_CASE("an image file that cannot be read is a read error", "[image]") {
  const std::vector<std::byte> file = make_jpeg(700, 400, 3, false);
  REQUIRE(file.size() > 2 * 65536);
  for (const uint64_t limit : {uint64_t{0}, uint64_t{65536}}) {
    const auto read = [&](uint64_t offset, std::span<std::byte> out) -> Result<void> {
      if (offset >= limit) return scree::Error{ErrorCode::kFile, "the disk has gone"};
      std::memcpy(out.data(), file.data() + offset, out.size());
      return {};
    };
    check_refusal(check_image(ImageFile(file.size(), read)), {ErrorCode::kFile, "the disk has gone"});
  }
}

TEST_CASE("real JPEGs decode, or give the reason", "[image][models]") {
  const std::filesystem::path folder = scree::tests::real_models("jpeg");
  if (folder.empty()) return;
  size_t decoded = 0, refused = 0;
  for (const auto& path : files_below(folder)) {
    INFO(path);
    const std::vector<std::byte> file = read_bytes(path);
    const Result<Image> image = decode_image(file);
    check_agrees(file);
    if (!image) {
      CHECK(image.error().message.find("JPEG: ") == 0);
      CHECK(image.error().message.size() > 10);
      ++refused;
      continue;
    }
    const ImageInfo info = must(probe_image(file));
    CHECK(info.width == image->width);
    CHECK(info.height == image->height);
    CHECK(image->rgba.size() == size_t{4} * image->width * image->height);
    ++decoded;
  }
  CHECK(decoded >= 90);
  CHECK(refused < 30);
}

TEST_CASE("one picture in many codings decodes to the same pixels", "[image][models]") {
  const std::filesystem::path folder = scree::tests::real_models("jpeg/go-libjpeg");
  if (folder.empty()) return;
  // The files video-001 of go-libjpeg show one picture. Its CMYK file was converted to ink and back without a profile.
  const Image reference = must(decode_image(read_bytes(folder / "video-001.jpeg")));
  for (const char* name : {"video-001.progressive.jpeg", "video-001.q50.420.jpeg", "video-001.q50.444.jpeg",
                           "video-001.rgb.jpeg", "video-001.cmyk.jpeg", "video-001.q50.410.jpeg"}) {
    INFO(name);
    const Image image = must(decode_image(read_bytes(folder / name)));
    REQUIRE(image.rgba.size() == reference.rgba.size());
    double difference = 0;
    for (size_t i = 0; i < image.rgba.size(); ++i) difference += std::abs(image.rgba[i] - reference.rgba[i]);
    const bool is_cmyk = std::string(name).find("cmyk") != std::string::npos;
    CHECK(difference / static_cast<double>(image.rgba.size()) < (is_cmyk ? 30.0 : 8.0));
  }
}

TEST_CASE("malformed, cut and bit-flipped JPEGs never crash", "[image][models]") {
  const std::filesystem::path folder = scree::tests::real_models("bad/jpeg");
  if (folder.empty()) return;
  size_t files = 0;
  for (const auto& path : files_below(folder)) {
    INFO(path);
    const std::vector<std::byte> bad = read_bytes(path);
    const Result<Image> image = decode_image(bad);
    if (!image) CHECK_FALSE(image.error().message.empty());
    check_agrees(bad);
    ++files;
  }
  CHECK(files > 200);

  const std::vector<std::byte> whole =
      read_bytes(scree::tests::models_path() / "jpeg" / "go-libjpeg" / "video-001.progressive.jpeg");
  REQUIRE(whole.size() > 1000);
  std::mt19937 random(3);
  for (int i = 0; i < 60; ++i) {
    std::vector<std::byte> file(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(whole.size() * i / 60));
    check_agrees(file);
    file = whole;
    file[random() % file.size()] ^= static_cast<std::byte>(1u << (random() % 8));
    check_agrees(file);
  }
  const std::vector<std::byte> half(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(whole.size() / 2));
  const Result<Image> cut = decode_image(half);
  if (cut) {
    CHECK(cut->warning == "JPEG: Premature end of JPEG file");
  } else {
    CHECK_FALSE(cut.error().message.empty());
  }
}
