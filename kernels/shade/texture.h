// Samples a texture: wrap modes, bilinear filtering in linear light, and interpolation between mip levels. A level is
// decoded, a JPEG, or blocks.
#pragma once

#include <cmath>

#include "format/blocks/pixels.h"
#include "kernels/math.h"
#include "kernels/scene_view.h"
#include "kernels/shade/approximate.h"
#include "kernels/shade/block_cache.h"
#include "kernels/shade/shared_words.h"
#include "kernels/shade/texel_pager.h"
#include "kernels/shade/texture_point.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

/// The two texels around a wrapped point and the weight of the second.
struct TexelPair {
  uint32_t first;
  uint32_t second;
  float weight;
};

SCREE_HD inline TexelPair texel_pair(uint32_t wrapped, uint32_t size, format::Wrap wrap) {
  // From the centre of texel 0, in 2^-32 texels.
  const int64_t place = static_cast<int64_t>(uint64_t{wrapped} * size) - (int64_t{1} << 31);
  const int32_t first = static_cast<int32_t>(place >> 32);
  TexelPair pair;
  pair.weight = static_cast<float>(static_cast<uint32_t>(place)) * (1.0f / 4294967296.0f);
  const int32_t last = static_cast<int32_t>(size) - 1;
  const int32_t second = first + 1;
  if (wrap == format::Wrap::kRepeat) {
    pair.first = static_cast<uint32_t>(first < 0 ? last : first);
    pair.second = static_cast<uint32_t>(second > last ? 0 : second);
  } else {  // mirrored neighbours are the edge texel itself
    pair.first = static_cast<uint32_t>(first < 0 ? 0 : first);
    pair.second = static_cast<uint32_t>(second > last ? last : second);
  }
  return pair;
}

/// Grey, for a picture that does not wait for its pages and has no coarser level.
inline constexpr uint32_t kAbsentTexel = 0xff808080;

/// A page's raw bytes, or null if it is absent. Marks the page as wanted in the current round in any case.
SCREE_HD inline const uint8_t* want_page(const TexelPages& pages, uint64_t number) {
  if (load_cached(pages.wanted + number) != pages.round) store_relaxed(pages.wanted + number, pages.round);
  return pages.blocks[number];
}

/// The picture of a JPEG level. `page`: the address of the level's page, if it has one.
SCREE_HD inline const format::JpegPicture* jpeg_of(const JpegLevel& level, const uint8_t* page) {
  return level.page == JpegLevel::kNotPaged ? &level.picture
                                            : reinterpret_cast<const format::JpegPicture*>(page + level.place);
}

/// The picture of a JPEG level, or null if its page is absent. Marks the page as wanted.
SCREE_HD inline const format::JpegPicture* want_jpeg(const TexelPages& pages, const JpegLevel& level) {
  if (level.page == JpegLevel::kNotPaged) return &level.picture;
  const uint8_t* const page = want_page(pages, level.page);
  return page == nullptr ? nullptr : jpeg_of(level, page);
}

SCREE_HD inline bool absent_texels(uint32_t texels[4]) {
  for (uint32_t i = 0; i < 4; ++i) texels[i] = kAbsentTexel;
  return false;
}

/// The four bytes of a decoded texel, which is 4-byte aligned.
SCREE_HD inline uint32_t load_texel(const uint8_t* texel) {
#if defined(__CUDA_ARCH__)
  return *reinterpret_cast<const uint32_t*>(texel);
#else
  uint32_t word;
  std::memcpy(&word, texel, sizeof word);
  return word;
#endif
}

/// The four texels of two columns and two rows, row by row, as coded: red in the low byte, alpha in the high one. For
/// levels that are not JPEGs. Returns whether they are present; texels of levels that are not paged always are.
/// `kMayBePaged`: whether the level may lie in pages.
template <bool kMayBePaged>
SCREE_HD inline bool stored_texels(const TexelPages& pages, const TextureView& texture, uint32_t level,
                                   const TexelPair& column, const TexelPair& row, uint32_t texels[4]) {
  const uint32_t width = max_of(texture.width >> level, 1u);
  if (level >= texture.block_level_count) {
    const uint8_t* first = texture.texels + 4 * texture.level_offset[level];
    for (uint32_t i = 0; i < 4; ++i) {
      const uint64_t x = i % 2 == 0 ? column.first : column.second;
      const uint64_t y = i < 2 ? row.first : row.second;
      texels[i] = load_texel(first + 4 * (y * width + x));
    }
    return true;
  }
  // The blocks that hold each row, and the row's number counted from their top.
  const uint8_t* blocks[2];
  uint32_t y[2] = {row.first, row.second};
  if (kMayBePaged && level < texture.paged_level_count) {
    const format::BlockRows rows = format::block_rows(texture.block_format, width, max_of(texture.height >> level, 1u));
    const uint32_t page_height = rows.rows_per_page * format::block_side(texture.block_format);
    const uint32_t page[2] = {y[0] / page_height, y[1] / page_height};
    for (uint32_t i = 0; i < 2; ++i) {
      y[i] -= page[i] * page_height;
      blocks[i] = i == 1 && page[1] == page[0] ? blocks[0] : want_page(pages, texture.level_offset[level] + page[i]);
    }
    if (blocks[0] == nullptr || blocks[1] == nullptr) return absent_texels(texels);
  } else {
    blocks[0] = blocks[1] = texture.blocks + texture.level_offset[level];
  }
  uint32_t found[4];  // in memory, since the loop is not unrolled
#if defined(__CUDA_ARCH__)
#pragma unroll 1
#endif
  for (uint32_t i = 0; i < 4; ++i)
    found[i] = format::block_image_pixel(texture.block_format, texture.swizzle, i < 2 ? blocks[0] : blocks[1], width,
                                         i % 2 == 0 ? column.first : column.second, i < 2 ? y[0] : y[1]);
  for (uint32_t i = 0; i < 4; ++i) texels[i] = found[i];
  return true;
}

/// The source of a sample's texels: the decoded levels, and on a CPU the scene's block cache and pages. Only texels of
/// pages may be missing.
struct SceneTexels {
#if defined(__CUDA_ARCH__)
  static constexpr bool kMayMiss = false;
#else
  static constexpr bool kMayMiss = true;
#endif
  struct Lane {           // the state of a lane's lookups
    bool missed = false;  // a page was absent, for the current pixel
  };

  BlockCache* blocks;  // SceneView::blocks
  TexelPages pages{};

  /// Returns whether the texels' pages are present.
  SCREE_HD bool fetch(Lane&, const TextureView& texture, uint32_t level, const TexelPair& column, const TexelPair& row,
                      uint32_t texels[4]) const {
#if !defined(__CUDA_ARCH__)
    if (level < texture.jpeg_level_count) {
      const uint32_t x[2] = {column.first, column.second};
      const uint32_t y[2] = {row.first, row.second};
      const JpegLevel& jpeg = texture.jpeg[level];
      const format::JpegPicture* const picture = want_jpeg(pages, jpeg);
      if (picture == nullptr) return absent_texels(texels);
      blocks->fetch(*picture, jpeg.number, x, y, texels);
      return true;
    }
#endif
    return stored_texels<kMayMiss>(pages, texture, level, column, row, texels);
  }
};

/// Linear light of four 8-bit codes, `shift` bits from the low end of their texels.
struct LinearCodes {
  const float* table;
  SCREE_HD void read(const uint32_t texels[4], uint32_t shift, float values[4]) const {
    for (uint32_t i = 0; i < 4; ++i) values[i] = table[texels[i] >> shift & 255u];
  }
};

/// Three channels of a level from bit `first` of its texels on. `codes`: as LinearCodes. Returns whether the texels'
/// pages are present.
template <class Texels, class Codes>
SCREE_HD inline bool sample_level(const Texels& source, typename Texels::Lane& lane, const TextureView& texture,
                                  const Codes& codes, uint32_t first, uint32_t level, uint32_t u, uint32_t v,
                                  bool nearest, float out[3]) {
  const uint32_t width = max_of(texture.width >> level, 1u);
  const uint32_t height = max_of(texture.height >> level, 1u);
  TexelPair column = texel_pair(u, width, texture.wrap_s);
  TexelPair row = texel_pair(v, height, texture.wrap_t);
  if (nearest) {
    column.weight = column.weight < 0.5f ? 0.0f : 1.0f;
    row.weight = row.weight < 0.5f ? 0.0f : 1.0f;
  }
  uint32_t texels[4];
  const bool is_present = source.fetch(lane, texture, level, column, row, texels);
  for (uint32_t i = 0; i < 4; ++i) texels[i] >>= first;
  for (uint32_t c = 0; c < 3; ++c) {
    float value[4];
    codes.read(texels, 8 * c, value);
    const float above = multiply_add(value[1] - value[0], column.weight, value[0]);
    const float below = multiply_add(value[3] - value[2], column.weight, value[2]);
    out[c] = multiply_add(below - above, row.weight, above);
  }
  return is_present;
}

/// Three channels at (u, v); 1 if there is no picture. `codes`, `first`: as for sample_level().
/// `footprint`: the square of the larger side of a pixel in texels of level 0; selects the mip levels.
template <class Texels, class Codes>
SCREE_HD inline void sample_channels(const Texels& source, typename Texels::Lane& lane, const TextureView& texture,
                                     const Codes& codes, uint32_t first, TexturePoint u, TexturePoint v,
                                     float footprint, float out[3]) {
  for (uint32_t c = 0; c < 3; ++c) out[c] = 1.0f;
  if (texture.level_count == 0) return;
  const uint32_t wrapped_u = wrap_point(u, texture.wrap_s);
  const uint32_t wrapped_v = wrap_point(v, texture.wrap_t);
  const bool is_magnified = footprint <= 1.0f;
  const bool nearest = is_magnified ? texture.magnified_nearest : texture.minified_nearest;
  const uint32_t level_count = texture.finest_level ? 1 : texture.level_count;
  const float last = static_cast<float>(level_count - 1);
  // NaN and infinite footprints (a plane seen edge-on) take the last level.
  float level = is_magnified ? 0.0f : footprint < 1e18f ? min_of(0.5f * logarithm(footprint), last) : last;
  if (texture.one_level) level = static_cast<float>(nearest_level(footprint, level_count));
  const uint32_t fine = static_cast<uint32_t>(level);
  const float between = level - static_cast<float>(fine);
  // A loop, so that a kernel contains one sampler: with two it was larger than the GPU's cache of instructions.
  uint32_t coarser = 0;  // levels that absent pages are away from the wanted one
#if defined(__CUDA_ARCH__)
#pragma unroll 1
#endif
  for (uint32_t i = 0; i == 0 || (i == 1 && between > 0);) {
    float some[3];
    const uint32_t at = fine + i + coarser;
    if (!sample_level(source, lane, texture, codes, first, at, wrapped_u, wrapped_v, nearest, some)) {
      if (!source.pages.takes_coarser) {
        lane.missed = true;
      } else if (at + 1 < texture.level_count) {
        ++coarser;
        continue;
      }
    }
    for (uint32_t c = 0; c < 3; ++c) out[c] = i == 0 ? some[c] : multiply_add(some[c] - out[c], between, out[c]);
    coarser = 0;
    ++i;
  }
}

/// The colour at (u, v). `table`: linear light of the 256 sRGB codes.
template <class Texels>
SCREE_HD inline void sample_texture(const Texels& source, typename Texels::Lane& lane, const TextureView& texture,
                                    const float* table, TexturePoint u, TexturePoint v, float footprint, float rgb[3]) {
  sample_channels(source, lane, texture, LinearCodes{table}, 0, u, v, footprint, rgb);
}

}  // namespace SCREE_ISA
}  // namespace scree::kernels
