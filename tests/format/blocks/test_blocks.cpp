// Blocks and their pixels: the spec's examples, swizzles, sizes, and any bytes.
#include <array>
#include <cstring>
#include <map>
#include <random>
#include <string>

#include "format/blocks/bc7_block.h"
#include "format/blocks/pixels.h"
#include "tests/format/geometry/spec_vectors.h"

namespace scree::format {
namespace {

const std::map<std::string, BlockFormat> kFormats = {{"BC1", BlockFormat::kBc1}, {"BC2", BlockFormat::kBc2},
                                                     {"BC3", BlockFormat::kBc3}, {"BC4", BlockFormat::kBc4},
                                                     {"BC5", BlockFormat::kBc5}, {"BC7", BlockFormat::kBc7}};

std::array<uint32_t, 4> channels_of(uint32_t rgba) {
  return {rgba & 255, rgba >> 8 & 255, rgba >> 16 & 255, rgba >> 24};
}

}  // namespace

TEST_CASE("blocks of the spec", "[blocks][spec]") {
  std::map<uint32_t, int> modes;  // of BC7
  for (const auto& vector : tests::spec_vectors("blocks.txt")) {
    INFO(vector.text("name"));
    const auto bytes = vector.bytes("bytes");
    const auto pixels = vector.integers<uint32_t>("pixels");
    const BlockFormat format = kFormats.at(vector.text("format"));
    CHECK(vector.text("format") == block_format_name(format));
    REQUIRE(bytes.size() == block_bytes(format));
    REQUIRE(pixels.size() == 64);
    alignas(16) std::array<uint8_t, 16> block{};
    std::memcpy(block.data(), bytes.data(), bytes.size());
    for (uint32_t i = 0; i < 16; ++i)
      for (uint32_t c = 0; c < 4; ++c) CHECK(channels_of(block_pixel(format, block.data(), i))[c] == pixels[4 * i + c]);
    if (format == BlockFormat::kBc7) ++modes[static_cast<uint32_t>(std::countr_zero(uint32_t{block[0]} | 256))];
  }
  CHECK(modes.size() == 9);  // including the reserved one
}

TEST_CASE("a channel has the source of its swizzle", "[blocks]") {
  const uint32_t rgba = 0x40302010;
  CHECK(swizzled(rgba, kPlainSwizzle) == rgba);
  CHECK(swizzled(rgba, kOpaqueSwizzle) == 0xff302010);
  using enum ChannelSource;
  const uint16_t zorah = make_swizzle(kOne, kRed, kGreen, kOne);  // "1rg1"
  CHECK(swizzled(rgba, zorah) == 0xff2010ff);
  CHECK(swizzled(rgba, make_swizzle(kZero, kAlpha, kBlue, kZero)) == 0x00304000);
  // Applying one swizzle after another equals applying their combination.
  std::mt19937 random(1);
  for (int round = 0; round < 200; ++round) {
    const auto any = [&] {
      return make_swizzle(static_cast<ChannelSource>(random() % 6), static_cast<ChannelSource>(random() % 6),
                          static_cast<ChannelSource>(random() % 6), static_cast<ChannelSource>(random() % 6));
    };
    const uint16_t first = any(), second = any();
    CHECK(is_swizzle(first));
    CHECK(swizzled(swizzled(rgba, first), second) == swizzled(rgba, swizzle_of_swizzle(first, second)));
  }
  CHECK_FALSE(is_swizzle(6));
  CHECK_FALSE(is_swizzle(0x1000 | kPlainSwizzle));
}

TEST_CASE("levels have the bytes of their blocks", "[blocks]") {
  CHECK(block_level_bytes(BlockFormat::kBc1, 1, 1) == 8);
  CHECK(block_level_bytes(BlockFormat::kBc7, 4, 4) == 16);
  CHECK(block_level_bytes(BlockFormat::kBc7, 5, 4) == 32);
  CHECK(block_level_bytes(BlockFormat::kBc5, 4096, 4200) == 16ull * 1024 * 1050);
  CHECK(block_level_bytes(BlockFormat::kRgba8, 65536, 65536) == 1ull << 34);
  CHECK(block_level_bytes(BlockFormat::kRg8, 3, 5) == 30);
  CHECK(most_block_levels(1, 1) == 0);
  CHECK(most_block_levels(5, 3) == 2);
  CHECK(most_block_levels(65536, 1) == 16);
}

TEST_CASE("a pixel of a picture comes from its block", "[blocks]") {
  // 7 x 6 pixels of BC4: 2 x 2 blocks, each of one value.
  alignas(16) std::array<uint8_t, 32> blocks{};
  for (size_t i = 0; i < 4; ++i) blocks[8 * i] = blocks[8 * i + 1] = static_cast<uint8_t>(50 * (i + 1));
  for (uint32_t y = 0; y < 6; ++y)
    for (uint32_t x = 0; x < 7; ++x)
      CHECK((block_image_pixel(BlockFormat::kBc4, kPlainSwizzle, blocks.data(), 7, x, y) & 255) ==
            50 * (y / 4 * 2 + x / 4 + 1));
  CHECK(block_image_pixel(BlockFormat::kRg8, kPlainSwizzle, blocks.data(), 2, 0, 2) == 0xff006464);
}

TEST_CASE("a BC7 block decoded at once has the pixels that are decoded one by one", "[blocks]") {
  std::mt19937_64 random(7);
  for (uint32_t mode = 0; mode <= 8; ++mode)  // 8: the reserved one
    for (int round = 0; round < 4000; ++round) {
      BlockBits block{random(), random()};
      block.low = (block.low & ~((uint64_t{2} << mode) - 1)) | (mode < 8 ? uint64_t{1} << mode : 0);
      if (mode == 8) block.low &= ~uint64_t{255};
      std::array<uint32_t, 16> pixels{};
      bc7_pixels(block, pixels.data());
      for (uint32_t i = 0; i < 16; ++i)
        if (pixels[i] != bc7_pixel(block, i)) FAIL("mode " << mode << ", round " << round << ", pixel " << i);
    }
}

}  // namespace scree::format
