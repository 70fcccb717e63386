#include "tools/synth/block_texture.h"

#include <zstd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <string_view>

#include "format/blocks/format.h"
#include "format/bytes.h"
#include "tools/synth/block_encoder.h"
#include "tools/synth/scene_functions.h"

namespace scree::synth {
namespace {

constexpr int kZstdLevel = 3;
constexpr uint32_t kNoiseLevels = 6;

/// Periodic noise of several octaves with its mip levels, in 0 to 255. Sides are multiples of 2^(kNoiseLevels - 1).
class NoiseTile {
 public:
  NoiseTile(uint32_t seed, uint32_t side) : side_(side) {
    std::vector<uint8_t> texels(size_t{side} * side);
    for (uint32_t y = 0; y < side; ++y)
      for (uint32_t x = 0; x < side; ++x) {
        double sum = 0, height = 1;
        for (uint32_t period = 4, octave = 0; octave < 8; ++octave, period *= 2, height *= 0.66)
          sum += height * (lattice(seed + octave, period, static_cast<double>(x) * period / side,
                                   static_cast<double>(y) * period / side) -
                           0.5);
        texels[size_t{y} * side + x] = static_cast<uint8_t>(std::clamp(128.0 + 110.0 * sum, 0.0, 255.0));
      }
    levels_.push_back(std::move(texels));
    while (levels_.size() < kNoiseLevels) levels_.push_back(halved(levels_.back()));
  }

  /// The noise around texel (x, y) of level `level`.
  uint32_t at(uint32_t level, uint32_t x, uint32_t y) const {
    if (level >= kNoiseLevels) return 128;
    const uint32_t side = side_ >> level;
    return levels_[level][size_t{y % side} * side + x % side];
  }

 private:
  static double lattice(uint32_t seed, uint32_t period, double x, double y) {
    const auto i = static_cast<uint32_t>(x), j = static_cast<uint32_t>(y);
    const auto value = [&](uint32_t a, uint32_t b) { return unit24(hash2(seed, a % period, b % period)); };
    const double wx = smooth_step(x - i), wy = smooth_step(y - j);
    return mix(mix(value(i, j), value(i + 1, j), wx), mix(value(i, j + 1), value(i + 1, j + 1), wx), wy);
  }

  static std::vector<uint8_t> halved(const std::vector<uint8_t>& from) {
    const auto side = static_cast<size_t>(std::sqrt(static_cast<double>(from.size()))), half = side / 2;
    std::vector<uint8_t> to(half * half);
    for (size_t y = 0; y < half; ++y)
      for (size_t x = 0; x < half; ++x) {
        const uint8_t* const texel = &from[2 * y * side + 2 * x];
        to[y * half + x] = static_cast<uint8_t>((texel[0] + texel[1] + texel[side] + texel[side + 1] + 2) / 4);
      }
    return to;
  }

  uint32_t side_;
  std::vector<std::vector<uint8_t>> levels_;
};

/// The texels of a picture. Two tiles of different periods are mixed, so that the pattern does not repeat within 15,360
/// texels.
class Picture {
 public:
  explicit Picture(const BlockTexture& texture) : texture_(texture) {
    for (size_t c = 0; c < 3; ++c) {
      dark_[c] =
          static_cast<int>(30 + hash2(texture.seed, 1, 0) % 60 + hash2(texture.seed, 2, static_cast<uint32_t>(c)) % 30);
      light_[c] = dark_[c] + 60 + static_cast<int>(hash2(texture.seed, 3, static_cast<uint32_t>(c)) % 50);
    }
  }

  std::array<uint8_t, 4> texel(uint32_t level, uint32_t x, uint32_t y) const {
    const int value = noise(level, x, y);
    switch (texture_.picture) {
      case BlockPicture::kColor:
      case BlockPicture::kCutout: {
        std::array<uint8_t, 4> color{0, 0, 0, 255};
        for (size_t c = 0; c < 3; ++c)
          color[c] = static_cast<uint8_t>(std::clamp(dark_[c] + (light_[c] - dark_[c]) * value / 256, 0, 255));
        if (texture_.picture == BlockPicture::kCutout) color[3] = alpha(level, x, y);
        return color;
      }
      case BlockPicture::kSurface:
        return {static_cast<uint8_t>(std::clamp(90 + value / 2, 0, 255)), static_cast<uint8_t>(value > 190 ? 255 : 0),
                0, 255};
      case BlockPicture::kNormals:
        return {slope(noise(level, x + 1, y) - value), slope(noise(level, x, y + 1) - value), 255, 255};
      case BlockPicture::kSpecular:
        return {static_cast<uint8_t>(value), 0, 0, 255};
    }
    return {};
  }

 private:
  /// Holes of about 100 texels with soft borders. Squares of 16 texels between them are opaque on every level, so that
  /// even a small picture has opaque texels.
  uint8_t alpha(uint32_t level, uint32_t x, uint32_t y) const {
    if (((x << level >> 4 ^ y << level >> 4) & 3) == 0) return 255;
    return static_cast<uint8_t>(std::clamp((noise(level + 3, x >> 3, y >> 3) - 104) * 24, 0, 255));
  }
  static uint8_t slope(int difference) { return static_cast<uint8_t>(std::clamp(128 + 3 * difference, 0, 255)); }

  int noise(uint32_t level, uint32_t x, uint32_t y) const {
    static const NoiseTile wide(11, 1024), narrow(12, 960);
    // Every seed below 57,600 has its own offset, which is a whole number of texels on all levels that are not uniform.
    const uint32_t right = texture_.seed * 7 % 240 * 64 >> std::min(level, 6u);
    const uint32_t down = texture_.seed / 240 % 240 * 64 >> std::min(level, 6u);
    return static_cast<int>((wide.at(level, x + right, y + down) + narrow.at(level, y + right, x + down)) / 2);
  }

  const BlockTexture& texture_;
  std::array<int, 3> dark_{}, light_{};
};

std::vector<std::byte> make_level(const BlockTexture& texture, uint32_t level) {
  const format::BlockFormat format = block_format_of(texture.picture);
  const uint32_t width = std::max(1u, texture.width >> level), height = std::max(1u, texture.height >> level);
  std::vector<std::byte> blocks(format::block_level_bytes(format, width, height));
  const Picture picture(texture);
  std::byte* out = blocks.data();
  BlockTexels texels;
  for (uint32_t y = 0; y < height; y += 4)
    for (uint32_t x = 0; x < width; x += 4, out += format::block_bytes(format)) {
      for (uint32_t i = 0; i < 16; ++i)
        texels[i] = picture.texel(level, std::min(x + i % 4, width - 1), std::min(y + i / 4, height - 1));
      if (format == format::BlockFormat::kBc7) {
        encode_bc7(texels, out);
      } else if (format == format::BlockFormat::kBc5) {
        encode_bc5(texels, out);
      } else {
        encode_bc4(texels, 0, out);
      }
    }
  return blocks;
}

// ---- The file ----

constexpr uint32_t kHeaderBytes = 80;
constexpr uint32_t kLevelBytes = 24;

struct FileFormat {
  uint32_t vk_format;
  uint32_t model;  // of the data format descriptor
  uint32_t transfer;
  std::string_view swizzle;
};

FileFormat file_format_of(BlockPicture picture) {
  constexpr uint32_t kLinear = 1, kSrgb = 2;
  if (picture == BlockPicture::kSurface) return {141, 132, kLinear, "1rg1"};
  if (picture == BlockPicture::kNormals) return {141, 132, kLinear, ""};
  if (picture == BlockPicture::kSpecular) return {139, 131, kLinear, "111r"};
  return {146, 134, kSrgb, ""};
}

class FileBytes {
 public:
  void word(uint32_t value) {
    bytes.resize(bytes.size() + 4);
    format::store(bytes.data() + bytes.size() - 4, value);
  }
  void text(std::string_view letters) {
    const auto all = std::as_bytes(std::span(letters));
    bytes.insert(bytes.end(), all.begin(), all.end());
  }
  void entry(std::string_view key, std::string_view value) {
    word(static_cast<uint32_t>(key.size() + value.size() + 2));
    text(key);
    bytes.push_back(std::byte{0});
    text(value);
    bytes.push_back(std::byte{0});
    bytes.resize(format::align_up(bytes.size(), 4));
  }

  std::vector<std::byte> bytes;
};

/// Writes the descriptor's size and a basic descriptor block.
void put_descriptor(FileBytes& file, BlockPicture picture) {
  const FileFormat format = file_format_of(picture);
  const bool is_bc5 = block_format_of(picture) == format::BlockFormat::kBc5;
  const uint32_t samples = is_bc5 ? 2 : 1, bits = picture == BlockPicture::kSpecular || is_bc5 ? 64 : 128;
  const uint32_t block_bytes = 24 + 16 * samples;
  file.word(4 + block_bytes);
  file.word(0);
  file.word(2 | block_bytes << 16);
  file.word(format.model | 1u << 8 | format.transfer << 16);
  file.word(3 | 3 << 8);  // 4 x 4 texels
  file.word(0);           // no bytes per plane: supercompressed
  file.word(0);
  for (uint32_t i = 0; i < samples; ++i) {
    file.word(64 * i | (bits - 1) << 16 | i << 24);
    file.word(0);
    file.word(0);
    file.word(UINT32_MAX);
  }
}

}  // namespace

format::BlockFormat block_format_of(BlockPicture picture) {
  if (picture == BlockPicture::kSurface || picture == BlockPicture::kNormals) return format::BlockFormat::kBc5;
  return picture == BlockPicture::kSpecular ? format::BlockFormat::kBc4 : format::BlockFormat::kBc7;
}

uint64_t block_bytes_of(const BlockTexture& texture, uint32_t longest) {
  uint64_t bytes = 0;
  for (uint32_t level = 0; level <= format::most_block_levels(texture.width, texture.height); ++level) {
    const uint32_t width = std::max(1u, texture.width >> level), height = std::max(1u, texture.height >> level);
    if (std::max(width, height) <= longest)
      bytes += format::block_level_bytes(block_format_of(texture.picture), width, height);
  }
  return bytes;
}

Result<std::vector<std::byte>> make_block_file(const BlockTexture& texture) {
  const FileFormat format = file_format_of(texture.picture);
  const uint32_t levels = format::most_block_levels(texture.width, texture.height) + 1;
  const uint32_t descriptor_at = kHeaderBytes + kLevelBytes * levels;
  FileBytes descriptor, keys;
  put_descriptor(descriptor, texture.picture);
  if (!format.swizzle.empty()) keys.entry("KTXswizzle", format.swizzle);
  keys.entry("KTXwriter", "scree " SCREE_VERSION);  // keys in sorted order

  FileBytes file;
  file.text(std::string_view("\xabKTX 20\xbb\r\n\x1a\n", 12));
  const auto descriptor_bytes = static_cast<uint32_t>(descriptor.bytes.size());
  constexpr uint32_t kZstd = 2;
  for (const uint32_t word :
       {format.vk_format, 1u, texture.width, texture.height, 0u, 0u, 1u, levels, kZstd, descriptor_at, descriptor_bytes,
        descriptor_at + descriptor_bytes, static_cast<uint32_t>(keys.bytes.size()), 0u, 0u, 0u, 0u})
    file.word(word);
  file.bytes.resize(descriptor_at);
  file.bytes.insert(file.bytes.end(), descriptor.bytes.begin(), descriptor.bytes.end());
  file.bytes.insert(file.bytes.end(), keys.bytes.begin(), keys.bytes.end());
  for (uint32_t level = levels; level-- > 0;) {  // the smallest first
    const std::vector<std::byte> blocks = make_level(texture, level);
    const size_t at = file.bytes.size();
    file.bytes.resize(at + ZSTD_compressBound(blocks.size()));
    const size_t packed =
        ZSTD_compress(file.bytes.data() + at, file.bytes.size() - at, blocks.data(), blocks.size(), kZstdLevel);
    if (ZSTD_isError(packed) != 0) return Error{ErrorCode::kFormat, std::string("zstd: ") + ZSTD_getErrorName(packed)};
    file.bytes.resize(at + packed);
    std::byte* const entry = file.bytes.data() + kHeaderBytes + kLevelBytes * level;
    format::store(entry, uint64_t{at});
    format::store(entry + 8, uint64_t{packed});
    format::store(entry + 16, uint64_t{blocks.size()});
  }
  return std::move(file.bytes);
}

}  // namespace scree::synth
