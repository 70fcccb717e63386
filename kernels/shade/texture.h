// Samples a texture: wrap modes, bilinear filtering in linear light, and interpolation between mip levels. A level is
// decoded, a JPEG, or blocks.
#pragma once

#include <cmath>

#include "format/blocks/pixels.h"
#include "kernels/math.h"
#include "kernels/scene_view.h"
#include "kernels/shade/approximate.h"
#include "kernels/shade/jpeg_group_cache.h"
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
  if (level.page == JpegLevel::kNotPaged) [[likely]]
    return &level.picture;
  const uint8_t* const page = want_page(pages, level.page);
  return page == nullptr ? nullptr : jpeg_of(level, page);
}

/// The picture of a JPEG level whose page is present.
SCREE_HD inline const format::JpegPicture* present_jpeg(const TexelPages& pages, const JpegLevel& level) {
  return jpeg_of(level, level.page == JpegLevel::kNotPaged ? nullptr : pages.blocks[level.page]);
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

/// Where four texels of a level lie, row by row. Textures of the same layout (material_views.h) have the same places.
struct TexelPlaces {
  // A texel's group of a JPEG; or its row of blocks times 2^16, plus its block's number in the row. Sources that look
  // groups up by pixels store the two columns and the two rows here.
  uint32_t group[4];
  uint32_t pixel[4];  // the texel's number in its group, in its block, or in a decoded level
  uint32_t same;      // which texels share a group: of sources that need it
};

/// `pair`s as a source that looks groups up by pixels keeps them.
SCREE_HD inline void keep_pairs(const TexelPair& column, const TexelPair& row, TexelPlaces& out) {
  out.group[0] = column.first;
  out.group[1] = column.second;
  out.group[2] = row.first;
  out.group[3] = row.second;
}

/// The pages of a paged level of blocks that hold the texels' upper and lower row.
struct PagesOfRows {
  uint32_t rows_per_page;  // of blocks
  uint32_t page[2];
};
SCREE_HD inline PagesOfRows pages_of_rows(const TextureView& texture, uint32_t level, const TexelPlaces& at) {
  const uint32_t per_page =
      format::block_rows(texture.block_format, max_of(texture.width >> level, 1u), max_of(texture.height >> level, 1u))
          .rows_per_page;
  return {per_page, {(at.group[0] >> 16) / per_page, (at.group[2] >> 16) / per_page}};
}

/// Sets the places of the texels of two columns and two rows of a level that is not a JPEG. Returns whether they are
/// present, and marks their pages; texels of levels that are not paged always are. `kMayBePaged`: whether the level may
/// lie in pages.
template <bool kMayBePaged>
SCREE_HD inline bool place_stored(const TexelPages& pages, const TextureView& texture, uint32_t level,
                                  const TexelPair& column, const TexelPair& row, TexelPlaces& out) {
  const bool is_block = level < texture.block_level_count;
  const uint32_t shift = is_block ? format::block_side_log(texture.block_format) : 0;
  const uint32_t inside = (1u << shift) - 1;
  const uint32_t width = is_block ? 4 : max_of(texture.width >> level, 1u);
  for (uint32_t i = 0; i < 4; ++i) {
    const uint32_t x = i % 2 == 0 ? column.first : column.second;
    const uint32_t y = i < 2 ? row.first : row.second;
    out.group[i] = y >> shift << 16 | x >> shift;
    out.pixel[i] = is_block ? (y & inside) * width + (x & inside) : y * width + x;
  }
  if (!kMayBePaged || level >= texture.paged_level_count) return true;
  const PagesOfRows rows = pages_of_rows(texture, level, out);
  bool is_present = true;
  for (uint32_t i = 0; i < 2; ++i)
    if (i == 0 || rows.page[1] != rows.page[0])
      is_present = want_page(pages, texture.level_offset[level] + rows.page[i]) != nullptr && is_present;
  return is_present;
}

/// The texels at places from place_stored(), as coded: red in the low byte, alpha in the high one.
template <bool kMayBePaged>
SCREE_HD inline void stored_texels(const TexelPages& pages, const TextureView& texture, uint32_t level,
                                   const TexelPlaces& at, uint32_t texels[4]) {
  if (level >= texture.block_level_count) {
    const uint8_t* const first = texture.texels + 4 * texture.level_offset[level];
    for (uint32_t i = 0; i < 4; ++i) texels[i] = load_texel(first + 4 * uint64_t{at.pixel[i]});
    return;
  }
  // The blocks that hold each row, and the number of the row of blocks counted from there.
  const uint8_t* blocks[2];
  uint32_t row[2] = {at.group[0] >> 16, at.group[2] >> 16};
  if (kMayBePaged && level < texture.paged_level_count) {
    const PagesOfRows rows = pages_of_rows(texture, level, at);
    for (uint32_t i = 0; i < 2; ++i) {
      blocks[i] = pages.blocks[texture.level_offset[level] + rows.page[i]];
      row[i] -= rows.page[i] * rows.rows_per_page;
    }
  } else {
    blocks[0] = blocks[1] = texture.blocks + texture.level_offset[level];
  }
  const uint32_t side = format::block_side(texture.block_format);
  const uint32_t across = (max_of(texture.width >> level, 1u) + side - 1) / side;
  uint32_t found[4];  // in memory, since the loop is not unrolled
#if defined(__CUDA_ARCH__)
#pragma unroll 1
#endif
  for (uint32_t i = 0; i < 4; ++i) {
    const uint64_t number = uint64_t{i < 2 ? row[0] : row[1]} * across + (at.group[i] & 0xffffu);
    const uint8_t* const block = (i < 2 ? blocks[0] : blocks[1]) + number * format::block_bytes(texture.block_format);
    found[i] = format::swizzled(format::block_pixel(texture.block_format, block, at.pixel[i]), texture.swizzle);
  }
  for (uint32_t i = 0; i < 4; ++i) texels[i] = found[i];
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

  JpegGroupCache* blocks;  // SceneView::blocks
  TexelPages pages{};

  /// Sets the places of the texels of two columns and two rows. Returns whether their pages are present.
  SCREE_HD bool place(Lane&, const TextureView& texture, uint32_t level, const TexelPair& column, const TexelPair& row,
                      TexelPlaces& out) const {
#if !defined(__CUDA_ARCH__)
    if (level < texture.jpeg_level_count) {
      keep_pairs(column, row, out);
      return want_jpeg(pages, texture.jpeg[level]) != nullptr;
    }
#endif
    return place_stored<kMayMiss>(pages, texture, level, column, row, out);
  }

  SCREE_HD void fetch(Lane&, const TextureView& texture, uint32_t level, const TexelPlaces& at,
                      uint32_t texels[4]) const {
#if !defined(__CUDA_ARCH__)
    if (level < texture.jpeg_level_count) {
      const JpegLevel& jpeg = texture.jpeg[level];
      blocks->fetch(*present_jpeg(pages, jpeg), jpeg.number, at.group, at.group + 2, texels);
      return;
    }
#endif
    stored_texels<kMayMiss>(pages, texture, level, at, texels);
  }
};

/// Linear light of the 8-bit codes of four texels, by channel.
struct LinearCodes {
  const float* table;
  SCREE_HD void read(const uint32_t texels[4], float values[3][4]) const {
    for (uint32_t c = 0; c < 3; ++c)
      for (uint32_t i = 0; i < 4; ++i) values[c][i] = table[texels[i] >> 8 * c & 255u];
  }
};

/// The mip levels of a sample: `fine` and, if `between` is above 0, `fine + 1`.
struct SampledLevels {
  uint32_t fine;
  float between;
  bool nearest;  // one texel of each level, not four

  SCREE_HD uint32_t count() const { return between > 0 ? 2 : 1; }
};

/// `footprint`: the square of the larger side of a pixel in texels of level 0. The texture must have levels.
SCREE_HD inline SampledLevels sampled_levels(const TextureView& texture, float footprint) {
  const bool is_magnified = footprint <= 1.0f;
  const uint32_t level_count = texture.finest_level ? 1 : texture.level_count;
  const float last = static_cast<float>(level_count - 1);
  // NaN and infinite footprints (a plane seen edge-on) take the last level.
  float level = is_magnified ? 0.0f : footprint < 1e18f ? min_of(0.5f * logarithm(footprint), last) : last;
  if (texture.one_level) level = static_cast<float>(nearest_level(footprint, level_count));
  const uint32_t fine = static_cast<uint32_t>(level);
  return {fine, level - static_cast<float>(fine), is_magnified ? texture.magnified_nearest : texture.minified_nearest};
}

/// A point on a mip level: its four texels, and the weights of the second column and of the second row.
struct alignas(16) LevelPoint {
  TexelPlaces texels;
  float column_weight;
  float row_weight;
  uint32_t level;  // or kAbsent: pages are absent

  static constexpr uint32_t kAbsent = ~uint32_t{0};
};

/// Finds a point on a level. `u`, `v`: from wrap_point(). If a page is absent, either the next coarser level is taken,
/// or lane.missed is set.
template <class Texels>
SCREE_HD inline void place_level(const Texels& source, typename Texels::Lane& lane, const TextureView& texture,
                                 uint32_t level, uint32_t u, uint32_t v, bool nearest, LevelPoint& out) {
  for (;; ++level) {
    TexelPair column = texel_pair(u, max_of(texture.width >> level, 1u), texture.wrap_s);
    TexelPair row = texel_pair(v, max_of(texture.height >> level, 1u), texture.wrap_t);
    if (nearest) {
      column.weight = column.weight < 0.5f ? 0.0f : 1.0f;
      row.weight = row.weight < 0.5f ? 0.0f : 1.0f;
    }
    out.column_weight = column.weight;
    out.row_weight = row.weight;
    out.level = level;
    if (source.place(lane, texture, level, column, row, out.texels)) [[likely]]
      return;
    if (source.pages.takes_coarser && level + 1 < texture.level_count) continue;
    if (!source.pages.takes_coarser) lane.missed = true;
    out.level = LevelPoint::kAbsent;
    return;
  }
}

/// Three channels of a texture at a point on a level, from bit `first` of its texels on. The point may be of another
/// texture of the same layout. `codes`: as LinearCodes.
template <class Texels, class Codes>
SCREE_HD inline void sample_level(const Texels& source, typename Texels::Lane& lane, const TextureView& texture,
                                  const Codes& codes, uint32_t first, const LevelPoint& at, float out[3]) {
  uint32_t texels[4];
  if (at.level == LevelPoint::kAbsent) [[unlikely]] {
    for (uint32_t i = 0; i < 4; ++i) texels[i] = kAbsentTexel;
  } else {
    source.fetch(lane, texture, at.level, at.texels, texels);
  }
  if (first != 0)
    for (uint32_t i = 0; i < 4; ++i) texels[i] >>= first;
  float values[3][4];
  codes.read(texels, values);
  for (uint32_t c = 0; c < 3; ++c) {
    const float* const value = values[c];
    const float above = multiply_add(value[1] - value[0], at.column_weight, value[0]);
    const float below = multiply_add(value[3] - value[2], at.column_weight, value[2]);
    out[c] = multiply_add(below - above, at.row_weight, above);
  }
}

/// Adds level `i` (0 or 1) of a sample to `out`.
SCREE_HD inline void mix_level(uint32_t i, const float channels[3], float between, float out[3]) {
  for (uint32_t c = 0; c < 3; ++c) out[c] = i == 0 ? channels[c] : multiply_add(channels[c] - out[c], between, out[c]);
}

/// The colour at (u, v); white if there is no picture. `table`: linear light of the 256 sRGB codes. `footprint`: as for
/// sampled_levels().
template <class Texels>
SCREE_HD inline void sample_texture(const Texels& source, typename Texels::Lane& lane, const TextureView& texture,
                                    const float* table, TexturePoint u, TexturePoint v, float footprint, float rgb[3]) {
  for (uint32_t c = 0; c < 3; ++c) rgb[c] = 1.0f;
  if (texture.level_count == 0) return;
  const uint32_t wrapped_u = wrap_point(u, texture.wrap_s);
  const uint32_t wrapped_v = wrap_point(v, texture.wrap_t);
  const SampledLevels levels = sampled_levels(texture, footprint);
  // A loop, so that a kernel contains one sampler: with two it was larger than the GPU's cache of instructions.
#if defined(__CUDA_ARCH__)
#pragma unroll 1
#endif
  for (uint32_t i = 0; i < levels.count(); ++i) {
    LevelPoint at;
    place_level(source, lane, texture, levels.fine + i, wrapped_u, wrapped_v, levels.nearest, at);
    float some[3];
    sample_level(source, lane, texture, LinearCodes{table}, 0, at, some);
    mix_level(i, some, levels.between, rgb);
  }
}

}  // namespace SCREE_ISA
}  // namespace scree::kernels
