#include "runtime/image.h"

#include <array>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include <unistd.h>

#include "tests/catch.h"
#include "tests/models.h"

using scree::ErrorCode;
using scree::Result;
using scree::format::ImageCodec;
using scree::runtime::decode_image;
using scree::runtime::Image;
using scree::runtime::ImageInfo;
using scree::runtime::probe_image;

namespace {

std::filesystem::path scratch(const std::string& name) {
  return std::filesystem::temp_directory_path() / ("scree_" + std::to_string(::getpid()) + "_" + name);
}

std::vector<std::byte> read_file(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  const std::vector<char> text{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  std::vector<std::byte> bytes(text.size());
  if (!text.empty()) std::memcpy(bytes.data(), text.data(), text.size());
  return bytes;
}

std::vector<std::filesystem::path> files_below(const std::filesystem::path& folder) {
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder))
    if (entry.is_regular_file()) files.push_back(entry.path());
  return files;
}

std::vector<uint8_t> noise(size_t size) {
  std::mt19937 random(7);
  std::vector<uint8_t> bytes(size);
  for (uint8_t& byte : bytes) byte = static_cast<uint8_t>(random());
  return bytes;
}

}  // namespace

TEST_CASE("a PNG comes back as it was written", "[image]") {
  const auto path = scratch("round.png");
  for (const uint32_t channels : {3u, 4u}) {
    for (const auto& [width, height] : {std::array{1u, 1u}, std::array{7u, 5u}, std::array{300u, 2u}}) {
      const std::vector<uint8_t> pixels = noise(size_t{width} * height * channels);
      REQUIRE(scree::runtime::write_png(path.string(), width, height, channels, pixels));
      const std::vector<std::byte> file = read_file(path);
      const Result<ImageInfo> info = probe_image(file);
      REQUIRE(info);
      CHECK(info->codec == ImageCodec::kPng);
      CHECK(info->width == width);
      CHECK(info->height == height);
      CHECK(info->channels == channels);
      const Result<Image> image = decode_image(file);
      REQUIRE(image);
      REQUIRE(image->rgba.size() == size_t{4} * width * height);
      bool same = true;
      for (size_t i = 0; i < size_t{width} * height; ++i)
        for (size_t c = 0; c < 4; ++c)
          same &= image->rgba[4 * i + c] == (c < channels ? pixels[i * channels + c] : 255);
      CHECK(same);

      for (size_t size = 0; size < file.size();
           size += 1 + file.size() / 50) {  // every prefix is an error, never a crash
        const std::vector<std::byte> prefix(file.begin(), file.begin() + static_cast<std::ptrdiff_t>(size));
        (void)decode_image(prefix);
        if (size < file.size() - 40) CHECK_FALSE(decode_image(prefix));
      }
    }
  }
  CHECK_FALSE(std::filesystem::exists(path.string() + ".part"));
  std::filesystem::remove(path);
}

TEST_CASE("a picture that cannot be written leaves nothing behind", "[image]") {
  const std::vector<uint8_t> pixels(3, 0);
  const auto path = scratch("no_such_folder") / "a.png";
  const Result<void> written = scree::runtime::write_png(path.string(), 1, 1, 3, pixels);
  REQUIRE_FALSE(written);
  CHECK(written.error().code == ErrorCode::kFile);
  CHECK(written.error().message.find("No such file") != std::string::npos);

  const auto folder = scratch("folder.png");  // the rename fails
  std::filesystem::create_directories(folder / "x");
  CHECK_FALSE(scree::runtime::write_png(folder.string(), 1, 1, 3, pixels));
  CHECK_FALSE(std::filesystem::exists(folder.string() + ".part"));
  std::filesystem::remove_all(folder);

  if (std::filesystem::exists("/dev/full")) {
    const auto full = scratch("full.pfm");  // its .part is the device that is always full
    std::filesystem::create_symlink("/dev/full", full.string() + ".part");
    const std::vector<float> values(100, 1.0f);
    const Result<void> result = scree::runtime::write_pfm(full.string(), 10, 10, values);
    REQUIRE_FALSE(result);
    CHECK(result.error().message.find("No space left") != std::string::npos);
    CHECK_FALSE(std::filesystem::exists(full));
    CHECK_FALSE(std::filesystem::is_symlink(full.string() + ".part"));
  }
}

TEST_CASE("a PFM has its rows bottom to top, little-endian", "[image]") {
  const auto path = scratch("depth.pfm");
  const std::vector<float> values{1.0f, 2.0f, 3.0f, 4.0f, 5.0f, std::numeric_limits<float>::infinity()};
  REQUIRE(scree::runtime::write_pfm(path.string(), 2, 3, values));
  const std::vector<std::byte> file = read_file(path);
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
  std::filesystem::remove(path);
}

TEST_CASE("a visibility buffer is its words and nothing else", "[image]") {
  const auto path = scratch("visibility.bin");
  const std::vector<uint64_t> samples{0x0123456789abcdefu, ~uint64_t{0}};
  REQUIRE(scree::runtime::write_visibility(path.string(), samples));
  const std::vector<std::byte> file = read_file(path);
  REQUIRE(file.size() == 16);
  CHECK(std::memcmp(file.data(), samples.data(), 16) == 0);
  std::filesystem::remove(path);
}

TEST_CASE("what is no image is named", "[image]") {
  const std::vector<std::byte> empty;
  REQUIRE_FALSE(probe_image(empty));
  CHECK(probe_image(empty).error().code == ErrorCode::kTruncated);
  const char riff[] = "RIFF....WEBPVP8 ";
  std::vector<std::byte> webp(sizeof riff);
  std::memcpy(webp.data(), riff, sizeof riff);
  REQUIRE_FALSE(probe_image(webp));
  CHECK(probe_image(webp).error().message == "neither PNG nor JPEG: begins with 52 49 46 46");
}

TEST_CASE("a huge picture in a few bytes is refused before its memory is taken", "[image]") {
  const auto path = scratch("bomb.png");
  REQUIRE(scree::runtime::write_png(path.string(), 2, 2, 3, noise(12)));
  std::vector<std::byte> file = read_file(path);
  file[16] = file[20] = std::byte{0};
  file[17] = file[21] = std::byte{0};
  file[18] = file[22] = std::byte{0x20};  // 8194 x 8194
  Result<Image> image = decode_image(file);
  REQUIRE_FALSE(image);
  CHECK(image.error().code == ErrorCode::kTruncated);
  file[17] = std::byte{1};  // 81920 wide
  image = decode_image(file);
  REQUIRE_FALSE(image);
  CHECK(image.error().code == ErrorCode::kRange);
  std::filesystem::remove(path);
}

TEST_CASE("real JPEGs decode, or say why not", "[image][models]") {
  const auto models = scree::tests::models_path();
  if (models.empty()) {
    WARN("no models beside the checkout");
    return;
  }
  size_t decoded = 0;
  size_t refused = 0;
  for (const auto& path : files_below(models / "jpeg")) {
    INFO(path.string());
    const std::vector<std::byte> file = read_file(path);
    const Result<Image> image = decode_image(file);
    if (!image) {
      CHECK(image.error().message.find("JPEG: ") == 0);
      CHECK(image.error().message.size() > 10);
      ++refused;
      continue;
    }
    const Result<ImageInfo> info = probe_image(file);
    REQUIRE(info);
    CHECK(info->width == image->width);
    CHECK(info->height == image->height);
    CHECK(image->rgba.size() == size_t{4} * image->width * image->height);
    ++decoded;
  }
  CHECK(decoded >= 90);
  CHECK(refused < 30);
}

TEST_CASE("one picture coded in many ways looks the same", "[image][models]") {
  const auto models = scree::tests::models_path();
  if (models.empty()) {
    WARN("no models beside the checkout");
    return;
  }
  // go-libjpeg's video-001 family holds one picture; CMYK goes through ink and back without a profile.
  const auto folder = models / "jpeg" / "go-libjpeg";
  const Result<Image> reference = decode_image(read_file(folder / "video-001.jpeg"));
  REQUIRE(reference);
  for (const char* name : {"video-001.progressive.jpeg", "video-001.q50.420.jpeg", "video-001.q50.444.jpeg",
                           "video-001.rgb.jpeg", "video-001.cmyk.jpeg", "video-001.q50.410.jpeg"}) {
    INFO(name);
    const Result<Image> image = decode_image(read_file(folder / name));
    REQUIRE(image);
    REQUIRE(image->rgba.size() == reference->rgba.size());
    double difference = 0;
    for (size_t i = 0; i < image->rgba.size(); ++i) difference += std::abs(image->rgba[i] - reference->rgba[i]);
    const bool is_cmyk = std::string(name).find("cmyk") != std::string::npos;
    CHECK(difference / static_cast<double>(image->rgba.size()) < (is_cmyk ? 30.0 : 8.0));
  }
}

TEST_CASE("malformed JPEGs never crash, nor do cut and bit-flipped ones", "[image][models]") {
  const auto models = scree::tests::models_path();
  if (models.empty()) {
    WARN("no models beside the checkout");
    return;
  }
  size_t files = 0;
  for (const auto& path : files_below(models / "bad" / "jpeg")) {
    INFO(path.string());
    const Result<Image> image = decode_image(read_file(path));
    if (!image) CHECK_FALSE(image.error().message.empty());
    ++files;
  }
  CHECK(files > 200);

  const std::vector<std::byte> whole = read_file(models / "jpeg" / "go-libjpeg" / "video-001.progressive.jpeg");
  REQUIRE(whole.size() > 1000);
  std::mt19937 random(3);
  for (int i = 0; i < 60; ++i) {
    std::vector<std::byte> file(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(whole.size() * i / 60));
    (void)decode_image(file);
    file = whole;
    file[random() % file.size()] ^= static_cast<std::byte>(1u << (random() % 8));
    (void)decode_image(file);
  }
  const std::vector<std::byte> half(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(whole.size() / 2));
  const Result<Image> cut = decode_image(half);
  if (cut) {
    CHECK(cut->warning == "JPEG: Premature end of JPEG file");
  } else {
    CHECK_FALSE(cut.error().message.empty());
  }
}
