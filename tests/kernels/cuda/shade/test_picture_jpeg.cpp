// JPEGs that a GPU encodes from pictures in its memory, compared with libjpeg's for the same pixels.
#include <cmath>
#include <random>
#include <vector>

#include "kernels/cuda/shade/picture_jpeg.h"
#include "runtime/images/image.h"
#include "runtime/images/jpeg_head.h"
#include "runtime/images/jpeg_writer.h"
#include "tests/gpu.h"
#include "tests/results.h"

namespace kernels = scree::kernels;
namespace runtime = scree::runtime;

namespace {

struct Pixels {
  uint32_t width, height;
  std::vector<uint32_t> rgba;
};

/// Waves of all wavelengths, and some noise.
Pixels waves(uint32_t width, uint32_t height, double noise) {
  Pixels out{width, height, std::vector<uint32_t>(size_t{width} * height)};
  std::mt19937 random(width * 31 + height);
  std::uniform_real_distribution<double> around(-noise, noise);
  for (uint32_t y = 0; y < height; ++y)
    for (uint32_t x = 0; x < width; ++x) {
      const double at[3] = {128 + 100 * std::sin(0.002 * x * x) * std::cos(0.05 * y),
                            128 + 90 * std::sin(0.11 * (x + y)), 0.7 * x + 0.4 * y};
      uint32_t& pixel = out.rgba[size_t{y} * width + x];
      pixel = 0xff000000u;
      for (int c = 0; c < 3; ++c) {
        const double value = std::fmod(at[c], 256.0) + around(random);
        pixel |= static_cast<uint32_t>(std::lround(std::clamp(value, 0.0, 255.0))) << (8 * c);
      }
    }
  return out;
}

/// `coder`: kept between pictures, as in a viewer.
std::vector<std::byte> encode_on_gpu(kernels::CudaJpegCoder& coder, const Pixels& picture, int quality, bool is_sharp) {
  auto device = must(kernels::DeviceBuffer::allocate(picture.rgba.size() * sizeof(uint32_t), "a picture"));
  REQUIRE(cudaMemcpy(device.data(), picture.rgba.data(), device.bytes(), cudaMemcpyHostToDevice) == cudaSuccess);
  auto head = must(runtime::make_jpeg_head(picture.width, picture.height, quality, is_sharp,
                                           static_cast<uint16_t>(kernels::jpeg_segment_mcus(is_sharp))));
  const auto coded = must(coder.encode(reinterpret_cast<const uint32_t*>(device.data()), head.header, is_sharp));
  std::vector<std::byte> file = head.bytes;
  file.insert(file.end(), coded.begin(), coded.end());
  file.insert(file.end(), {std::byte{0xff}, std::byte{0xd9}});
  return file;
}

std::vector<std::byte> encode_by_libjpeg(const Pixels& picture, int quality, bool is_sharp) {
  runtime::JpegCoding coding{.width = picture.width, .height = picture.height};
  coding.components[0].h = coding.components[0].v = is_sharp ? 1 : 2;
  coding.quality = quality;
  coding.has_own_tables = false;
  auto writer = must(runtime::JpegWriter::create(coding));
  std::vector<uint8_t> row(size_t{3} * picture.width);
  for (uint32_t y = 0; y < picture.height; ++y) {
    for (size_t x = 0; x < picture.width; ++x)
      for (size_t c = 0; c < 3; ++c)
        row[3 * x + c] = static_cast<uint8_t>(picture.rgba[size_t{y} * picture.width + x] >> (8 * c));
    REQUIRE(writer.row(row));
  }
  return must(writer.finish());
}

/// Root mean square of the differences between two pictures' channels.
double difference(const runtime::Image& image, const Pixels& picture) {
  REQUIRE(image.warning.empty());
  REQUIRE(image.width == picture.width);
  REQUIRE(image.height == picture.height);
  double sum = 0;
  for (size_t i = 0; i < picture.rgba.size(); ++i)
    for (size_t c = 0; c < 3; ++c) {
      const double d = image.rgba[4 * i + c] - static_cast<double>(picture.rgba[i] >> (8 * c) & 255u);
      sum += d * d;
    }
  return std::sqrt(sum / (3.0 * static_cast<double>(picture.rgba.size())));
}

}  // namespace

TEST_CASE("a GPU's JPEG is as accurate and as large as libjpeg's", "[cuda][jpeg]") {
  if (!scree::tests::has_gpu()) return;
  kernels::CudaJpegCoder coder;
  struct Case {
    uint32_t width, height;
    double noise;
    int quality;
  };
  // Sizes that end within an MCU and within a segment. Noise at the best quality exceeds the first buffer.
  for (const Case& at : {Case{321, 203, 4, 85}, Case{1, 1, 0, 85}, Case{17, 9, 0, 40}, Case{250, 64, 60, 95},
                         Case{256, 96, 70, 30}, Case{128, 96, 128, 100}, Case{640, 8, 0, 1}}) {
    for (const bool is_sharp : {false, true}) {
      CAPTURE(at.width, at.height, at.quality, is_sharp);
      const Pixels picture = waves(at.width, at.height, at.noise);
      const std::vector<std::byte> ours = encode_on_gpu(coder, picture, at.quality, is_sharp);
      const std::vector<std::byte> theirs = encode_by_libjpeg(picture, at.quality, is_sharp);
      const auto our_image = must(runtime::decode_image(ours));
      const auto their_image = must(runtime::decode_image(theirs));
      CHECK(difference(our_image, picture) <= 1.01 * difference(their_image, picture) + 0.1);
      // Restart markers and the DC values behind them take at most 24 bytes per segment.
      const double segments = at.width * at.height / (is_sharp ? 640.0 : 1280.0) + 2;
      CHECK(static_cast<double>(ours.size()) <= 1.02 * static_cast<double>(theirs.size()) + 24 * segments);
    }
  }
}

TEST_CASE("a GPU's JPEG of one colour has that colour", "[cuda][jpeg]") {
  if (!scree::tests::has_gpu()) return;
  kernels::CudaJpegCoder coder;
  for (const uint32_t rgba : {0xff000000u, 0xffffffffu, 0xff0000ffu, 0xffff0000u, 0xff7f3f1fu}) {
    const Pixels picture{40, 24, std::vector<uint32_t>(size_t{40} * 24, rgba)};
    for (const bool is_sharp : {false, true}) {
      const auto image = must(runtime::decode_image(encode_on_gpu(coder, picture, 100, is_sharp)));
      CAPTURE(rgba, is_sharp);
      CHECK(difference(image, picture) <= 1.0);
    }
  }
}
