// From the visibility buffer to finished pixels: every sample of a pixel is shaded, averaged in linear light and coded
// as 8-bit sRGB. Source: spec/rasterization.md, pixels.
#pragma once

#include "kernels/shade/surface.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

// A warp shades a tile of pixels, so that its lanes read the same few meshes, chunks and texels.
inline constexpr uint32_t kPixelTileWidth = 8;
inline constexpr uint32_t kPixelTileHeight = 4;
inline constexpr uint32_t kPixelTileSize = kPixelTileWidth * kPixelTileHeight;

/// A picture, or whole rows of one, cut into tiles, one per item.
struct PixelTiles {
  uint32_t width;  // pixels
  uint32_t first_row;
  uint32_t row_count;

  SCREE_HD uint32_t across() const { return (width + kPixelTileWidth - 1) / kPixelTileWidth; }
  SCREE_HD uint32_t down() const { return (row_count + kPixelTileHeight - 1) / kPixelTileHeight; }
  SCREE_HD uint32_t count() const { return across() * down(); }

  /// The number of a pixel, counted from the first.
  SCREE_HD uint64_t offset_of(uint32_t x, uint32_t y) const { return uint64_t{y - first_row} * width + x; }

  /// Calls body(x, y, inside) for every pixel of a tile, also for those outside the picture, so that all lanes of a
  /// team call it.
  template <class Team, class Body>
  SCREE_HD void for_each(uint32_t item, Team team, const Body& body) const {
    const uint32_t row = item / across();
    for_each_at(item - row * across(), row, team, body);
  }
  /// The same for a tile by its place, in tiles: a GPU has no instruction for the division.
  template <class Team, class Body>
  SCREE_HD void for_each_at(uint32_t column, uint32_t row, Team team, const Body& body) const {
    const uint32_t x0 = column * kPixelTileWidth;
    const uint32_t y0 = row * kPixelTileHeight;
    for (uint32_t i = team.rank(); i < kPixelTileSize; i += team.size()) {
      const uint32_t x = x0 + i % kPixelTileWidth;
      const uint32_t y = y0 + i / kPixelTileWidth;
      body(x, first_row + y, x < width && y < row_count);
    }
  }
};

/// Widens `range` by the depth codes of one row of samples per item.
struct FindDepthRange {
  const uint64_t* samples;
  uint32_t width;
  DepthRange* range;

  template <class Team>
  SCREE_HD void operator()(uint32_t item, Team team) const {
    const uint64_t* row = samples + uint64_t{item} * width;
    DepthRange own;
    for (uint32_t x = team.rank(); x < width; x += team.size()) {
      if (row[x] == kBackground) continue;
      own.nearest = min_of(own.nearest, sample_depth_code(row[x]));
      own.farthest = max_of(own.farthest, sample_depth_code(row[x]));
    }
    if (own.nearest > own.farthest) return;
    team.atomic_min(&range->nearest, own.nearest);
    team.atomic_max(&range->farthest, own.farthest);
  }
};

/// Whether a Shader has layers of blended surfaces over its colours: BlendTargets::over of a sample.
template <class Shader>
concept HasLayers = requires(const Shader& shader) {
  shader.over_at(0u, 0u);
};

/// Codes a pixel from the sums over its samples: `light` of the surfaces, `layers` over them, and the shares of
/// background and of surfaces. `side`: samples per pixel and axis.
template <bool kHasLayers>
SCREE_HD inline uint32_t pixel_code(const ShadeInputs& in, uint32_t side, const float light[3],
                                    [[maybe_unused]] const float layers[3], float background, float surface) {
  const float behind = background * in.options.background[3];
  const float alpha = surface + behind;
  const float scale = alpha > 0 ? 1.0f / alpha : 0.0f;
  uint32_t code = 0;
  for (int c = 0; c < 3; ++c) {
    float sum = light[c] + behind * in.options.background[c];
    if constexpr (kHasLayers) sum += layers[c];
    code |= srgb_code(*in.srgb, sum * scale) << 8 * c;
  }
  const float share = alpha / static_cast<float>(side * side);
  return code | static_cast<uint32_t>(round_even(min_of(max_of(share, 0.0f), 1.0f) * 255.0f)) << 24;
}

/// The pixel_code() of one sample, which shows a surface of this light.
SCREE_HD inline uint32_t surface_code(const ShadeInputs& in, const float light[3]) {
  uint32_t code = 0xff000000u;
  for (int c = 0; c < 3; ++c) code |= srgb_code(*in.srgb, light[c]) << 8 * c;
  return code;
}

/// The code of a pixel that shows no surface. `in.srgb`: in memory of the caller.
SCREE_HD inline uint32_t background_code(const ShadeInputs& in, uint32_t side) {
  constexpr float kNone[3] = {0, 0, 0};
  return pixel_code<false>(in, side, kNone, kNone, static_cast<float>(side * side), 0);
}

/// Stores a pixel. On a GPU there are four channels.
SCREE_HD inline void store_pixel(uint8_t* out, [[maybe_unused]] uint32_t channels, uint32_t code) {
#if defined(__CUDA_ARCH__)
  *reinterpret_cast<uint32_t*>(out) = code;
#else
  for (uint32_t c = 0; c < channels; ++c) out[c] = static_cast<uint8_t>(code >> 8 * c);
#endif
}

/// Finishes tiles of background. They need none of the values that a GPU computes, and moves to memory, before it
/// shades a tile.
struct BackgroundTiles {
  PixelTiles tiles;
  const uint64_t* samples;  // the whole picture's
  uint32_t side;            // samples per pixel and axis
  uint32_t code;            // background_code()
  uint8_t* pixels;          // as in Resolve, with 4 channels

  /// Finishes a tile of background; otherwise returns false. `column`, `row`: of the tile. The team has a lane per
  /// pixel.
  template <class Team>
  SCREE_HD bool finish(uint32_t column, uint32_t row, Team team) const {
    static_assert(Team::size() == kPixelTileSize);
    const uint64_t row_samples = uint64_t{tiles.width} * side;
    bool is_background = false;
    tiles.for_each_at(column, row, team, [&](uint32_t x, uint32_t y, bool inside) {
      bool shows = false;
      for (uint32_t j = 0; inside && j < side; ++j)
        for (uint32_t i = 0; i < side; ++i)
          shows = shows || samples[(uint64_t{y} * side + j) * row_samples + uint64_t{x} * side + i] != kBackground;
      is_background = team.ballot(shows) == 0;
      if (is_background && inside) store_pixel(pixels + 4 * tiles.offset_of(x, y), 4, code);
    });
    return is_background;
  }
};

/// Finished pixels, one tile per item. A pixel's light is the mean of its samples weighted by their alpha, so that a
/// transparent background does not bleed into an edge. `kSide`: samples per pixel and axis, or 0 if `side` is not known
/// when the pass is compiled. A GPU keeps sums over samples in memory while it shades one, but not with one sample.
template <class ShaderOfPixels, uint32_t kSide = 0>
struct Resolve {
  using Shader = ShaderOfPixels;

  Shader shader;
  PixelTiles tiles;
  const uint64_t* samples;  // the whole picture's
  uint32_t side;            // samples per pixel and axis
  const float* visibility;  // one factor per pixel of the whole picture for the light of its surfaces, or null
  uint32_t channels;        // 3 or 4
  uint8_t* pixels;          // begins at row tiles.first_row; 4-byte aligned with 4 channels

  template <class Team>
  SCREE_HD void operator()(uint32_t item, Team team) const {
    ShadeState<Team, Shader> state;
    tiles.for_each(item, team, [&](uint32_t x, uint32_t y, bool inside) { finish(team, x, y, inside, state); });
  }

  /// Finishes one pixel. All lanes of a team must call it. `inside`: whether the lane has a pixel. If texels were
  /// missing, state.texels.missed is set and no pixel is written.
  template <class Team>
  SCREE_HD void finish(Team team, uint32_t x, uint32_t y, bool inside, ShadeState<Team, Shader>& state) const {
    const uint64_t row_samples = static_cast<uint64_t>(shader.in.view.width);
    const uint32_t per_axis = kSide != 0 ? kSide : side;
    float light[3] = {0, 0, 0};
    float layers[3] = {0, 0, 0};  // their light
    float background = 0;         // number of background samples
    float surface = 0;
    for (uint32_t j = 0; j < per_axis; ++j) {
      for (uint32_t i = 0; i < per_axis; ++i) {
        const uint32_t sample_x = x * per_axis + i;
        const uint32_t sample_y = y * per_axis + j;
        const uint64_t sample = inside ? samples[sample_y * row_samples + sample_x] : kBackground;
        const bool covered = sample != kBackground;
        float color[3];
        shader(team, covered, sample, static_cast<int32_t>(sample_x), static_cast<int32_t>(sample_y), state, color);
        if constexpr (HasLayers<Shader>) {
          if (!inside) continue;
          const float* const over = shader.over_at(sample_x, sample_y);
          for (int c = 0; c < 3; ++c) {
            layers[c] += over[c];
            if (covered) light[c] += over[3] * color[c];
          }
          surface += covered ? 1.0f : 1.0f - over[3];
          background += covered ? 0.0f : over[3];
        } else if (covered) {
          surface += 1.0f;
          for (int c = 0; c < 3; ++c) light[c] += color[c];
        } else {
          background += 1.0f;
        }
      }
    }
    if (!inside) return;
    if constexpr (Shader::Texels::kMayMiss)
      if (state.texels.missed) return;
    write(x, y, light, layers, background, surface);
  }

 private:
  SCREE_HD void write(uint32_t x, uint32_t y, const float light[3], const float layers[3], float background_share,
                      float surface) const {
    const float factor = visibility != nullptr ? visibility[uint64_t{y} * tiles.width + x] : 1.0f;
    float sums[3];
    for (int c = 0; c < 3; ++c) sums[c] = light[c] * factor;
    if constexpr (kSide == 1 && !HasLayers<Shader>) {
      if (surface > 0) [[likely]]
        return store_pixel(pixels + tiles.offset_of(x, y) * channels, channels, surface_code(shader.in, sums));
    }
    const uint32_t per_axis = kSide != 0 ? kSide : side;
    const uint32_t code = pixel_code<HasLayers<Shader>>(shader.in, per_axis, sums, layers, background_share, surface);
    store_pixel(pixels + tiles.offset_of(x, y) * channels, channels, code);
  }
};

}  // namespace SCREE_ISA
}  // namespace scree::kernels
