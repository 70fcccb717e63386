// Makes KTX2 and DDS files for the tests.
#pragma once

#include <zlib.h>
#include <zstd.h>

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <random>
#include <string>
#include <vector>

#include "format/blocks/format.h"
#include "runtime/images/block_file.h"

namespace scree::tests {

using FileBytes = std::vector<std::byte>;

template <class T>
void put(FileBytes& file, T value) {
  const size_t at = file.size();
  file.resize(at + sizeof(T));
  std::memcpy(file.data() + at, &value, sizeof(T));
}

inline void put_text(FileBytes& file, const std::string& text) {
  for (const char c : text) put(file, c);
}

/// The bytes with another value at one place.
template <class T>
FileBytes with(FileBytes bytes, size_t at, T value) {
  std::memcpy(bytes.data() + at, &value, sizeof(value));
  return bytes;
}

/// The content of a file.
struct BlockRecipe {
  uint32_t vk_format = 145;  // BC7_UNORM
  uint32_t model = 134;      // of the data format descriptor
  format::BlockFormat format = format::BlockFormat::kBc7;
  uint32_t width = 8, height = 8, levels = 1;
  uint32_t scheme = 0;  // 0 none, 2 zstd, 3 zlib
  std::string swizzle{}, orientation{};
  uint32_t seed = 1;
  uint32_t channel = 0;         // of the first sample,
  uint32_t second_channel = 0;  // and of a second one if not 0, for models without a VkFormat
};

/// Blocks of a level: random bytes, many of them equal so that they compress.
inline FileBytes level_blocks(const BlockRecipe& recipe, uint32_t level) {
  std::mt19937 random(recipe.seed * 100 + level);
  FileBytes blocks(format::block_level_bytes(recipe.format, std::max(1u, recipe.width >> level),
                                             std::max(1u, recipe.height >> level)));
  for (size_t i = 0; i < blocks.size(); ++i)
    blocks[i] = i >= 64 && i / 64 % 2 == 1 ? blocks[i - 64] : static_cast<std::byte>(random());
  return blocks;
}

inline FileBytes packed_by(uint32_t scheme, const FileBytes& raw) {
  if (scheme == 0) return raw;
  FileBytes packed(ZSTD_compressBound(raw.size()) + compressBound(raw.size()));
  if (scheme == 2) {
    packed.resize(ZSTD_compress(packed.data(), packed.size(), raw.data(), raw.size(), 3));
  } else {
    uLongf size = packed.size();
    compress(reinterpret_cast<Bytef*>(packed.data()), &size, reinterpret_cast<const Bytef*>(raw.data()), raw.size());
    packed.resize(size);
  }
  return packed;
}

/// A KTX2 file, with its smallest level first as the format requires.
inline FileBytes make_ktx2(const BlockRecipe& recipe) {
  FileBytes keys;
  for (const auto& [key, value] : {std::pair{"KTXorientation", recipe.orientation}, {"KTXswizzle", recipe.swizzle}}) {
    if (value.empty()) continue;
    const std::string entry = std::string(key) + '\0' + value + '\0';
    put(keys, static_cast<uint32_t>(entry.size()));
    put_text(keys, entry);
    keys.resize((keys.size() + 3) & ~size_t{3});
  }
  const uint32_t levels = std::max(1u, recipe.levels);
  constexpr uint32_t kRgbModel = 1;
  const uint32_t samples = recipe.model == kRgbModel    ? format::block_channels(recipe.format)
                           : recipe.second_channel != 0 ? 2
                                                        : 1;
  const uint32_t descriptor_at = 80 + 24 * levels, descriptor_bytes = 28 + 16 * samples;
  FileBytes file;
  put_text(file, std::string("\xabKTX 20\xbb\r\n\x1a\n", 12));
  for (const uint32_t word :
       {recipe.vk_format, 1u, recipe.width, recipe.height, 0u, 0u, 1u, recipe.levels, recipe.scheme, descriptor_at,
        descriptor_bytes, keys.empty() ? 0 : descriptor_at + descriptor_bytes, static_cast<uint32_t>(keys.size()), 0u,
        0u, 0u, 0u})
    put(file, word);
  FileBytes data;
  std::vector<uint64_t> index(3 * levels);
  uint64_t begin = descriptor_at + descriptor_bytes + keys.size();
  begin = (begin + 15) / 16 * 16;
  for (uint32_t l = levels; l-- > 0;) {
    const FileBytes raw = level_blocks(recipe, l), packed = packed_by(recipe.scheme, raw);
    data.resize((data.size() + 15) / 16 * 16);
    index[3 * l] = begin + data.size();
    index[3 * l + 1] = packed.size();
    index[3 * l + 2] = raw.size();
    data.insert(data.end(), packed.begin(), packed.end());
  }
  for (const uint64_t word : index) put(file, word);
  put(file, descriptor_bytes);
  put(file, 0u);
  put(file, 2u | (24 + 16 * samples) << 16);
  put(file, recipe.model | 1u << 8 | 1u << 16);
  if (recipe.vk_format == 0) put(file, 0x0303u);  // blocks of 4 x 4
  file.resize(descriptor_at + 28);
  for (uint32_t i = 0; i < samples; ++i) {
    const bool is_reversed = recipe.vk_format == 44 || recipe.vk_format == 50;
    if (recipe.vk_format == 0) {
      put(file, 64 * i | 63u << 16 | (i == 0 ? recipe.channel : recipe.second_channel) << 24);
    } else {
      put(file, 8 * i | 7u << 16 | (i == 3 ? 15 : is_reversed ? 2 - i : i) << 24);
    }
    file.resize(file.size() + 12);
  }
  file.insert(file.end(), keys.begin(), keys.end());
  file.resize(begin);
  file.insert(file.end(), data.begin(), data.end());
  return file;
}

/// A DDS file with a DX10 header. `dxgi`: the format's number.
inline FileBytes make_dds(const BlockRecipe& recipe, uint32_t dxgi) {
  FileBytes file;
  put_text(file, "DDS ");
  for (const uint32_t word : {124u, 0x21007u, recipe.height, recipe.width, 0u, 0u, recipe.levels}) put(file, word);
  file.resize(76);
  put(file, 32u);
  put(file, 4u);
  put_text(file, "DX10");
  file.resize(108);
  put(file, 0x1000u);
  file.resize(128);
  for (const uint32_t word : {dxgi, 3u, 0u, 1u, 0u}) put(file, word);
  for (uint32_t l = 0; l < std::max(1u, recipe.levels); ++l) {
    const FileBytes blocks = level_blocks(recipe, l);
    file.insert(file.end(), blocks.begin(), blocks.end());
  }
  return file;
}

/// Files of all formats and packings for a fuzz corpus and for tests.
inline std::vector<std::pair<std::string, FileBytes>> block_files() {
  using format::BlockFormat;
  std::vector<std::pair<std::string, FileBytes>> files;
  files.emplace_back("bc7.ktx2", make_ktx2({.width = 13, .height = 6, .levels = 4, .swizzle = "1rg1"}));
  files.emplace_back("bc5_zstd.ktx2", make_ktx2({.vk_format = 141,
                                                 .model = 132,
                                                 .format = BlockFormat::kBc5,
                                                 .width = 24,
                                                 .height = 16,
                                                 .levels = 2,
                                                 .scheme = 2,
                                                 .swizzle = "111r",
                                                 .orientation = "rd"}));
  files.emplace_back("bc1_zlib.ktx2", make_ktx2({.vk_format = 132,
                                                 .model = 128,
                                                 .format = BlockFormat::kBc1,
                                                 .width = 20,
                                                 .height = 20,
                                                 .levels = 5,
                                                 .scheme = 3}));
  files.emplace_back("rgba8.ktx2",
                     make_ktx2({.vk_format = 44, .model = 1, .format = BlockFormat::kRgba8, .levels = 0}));
  files.emplace_back("r8.ktx2", make_ktx2({.vk_format = 9, .model = 1, .format = BlockFormat::kR8, .width = 5}));
  files.emplace_back(
      "uastc_zstd.ktx2",
      make_ktx2({.vk_format = 0, .model = 166, .width = 30, .height = 18, .levels = 2, .scheme = 2, .channel = 3}));
  files.emplace_back("bc3.dds", make_dds({.format = BlockFormat::kBc3, .width = 9, .height = 5, .levels = 4}, 77));
  files.emplace_back("bc4.dds", make_dds({.format = BlockFormat::kBc4, .width = 4, .height = 4}, 80));
  files.emplace_back("bgra.dds", make_dds({.format = BlockFormat::kRgba8, .width = 3, .height = 2}, 87));
  return files;
}

}  // namespace scree::tests
