// Ambient occlusion and eye-dome lighting: the share of its light that each pixel keeps, from the picture's depths
// alone. Source: spec/rasterization.md, occlusion.
#pragma once

#include <cmath>

#include "kernels/raster/depth.h"
#include "kernels/shade/pixels.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

inline constexpr uint32_t kObscuranceSamples = 12;
inline constexpr uint32_t kObscuranceTurns = 7;       // turns of the spiral on which the neighbours lie
inline constexpr uint32_t kObscuranceRotations = 16;  // rotations of the spiral; a hash chooses one per pixel
inline constexpr float kObscuranceBias =
    0.02f;  // share of the radius: the slope allowed to a rough or coarsely coded plane
inline constexpr float kObscuranceStrength = 5.0f;
inline constexpr int32_t kBlurRadius = 2;  // pixels to each side
inline constexpr float kEyeDomeStrength = 120.0f;

/// One depth per pixel, row by row: perspective, distances from the eye's plane in units of the near plane's distance;
/// orthographic, distances from the near plane; infinity on the background. Also the size of a pixel in these units.
struct DepthPicture {
  const float* depth;
  uint32_t width;  // pixels
  uint32_t height;
  float pixel_x;  // the sides of a pixel: at depth 1 (perspective), at any depth (orthographic)
  float pixel_y;
  bool orthographic;

  SCREE_HD float at(uint32_t x, uint32_t y) const { return depth[uint64_t{y} * width + x]; }
  SCREE_HD bool holds(int32_t x, int32_t y) const {
    return x >= 0 && y >= 0 && x < static_cast<int32_t>(width) && y < static_cast<int32_t>(height);
  }
  /// The height of a pixel at a depth.
  SCREE_HD float pixel_side(float z) const { return orthographic ? pixel_y : pixel_y * z; }
};

inline DepthPicture make_depth_picture(const View& view, uint32_t side, const float* depth) {
  const uint32_t width = view.width / side;
  const uint32_t height = view.height / side;
  return {depth,
          width,
          height,
          static_cast<float>(2 * view.half_width / width),
          static_cast<float>(2 * view.half_height / height),
          view.orthographic};
}

/// Finds the depth of every pixel: that of its nearest sample.
struct FindDepths {
  PixelTiles tiles;
  const uint64_t* samples;
  uint32_t side;
  float range;  // orthographic: from the near to the far plane
  bool orthographic;
  float* depth;

  template <class Team>
  SCREE_HD void operator()(uint32_t item, Team team) const {
    tiles.for_each(item, team, [&](uint32_t x, uint32_t y, bool inside) {
      if (!inside) return;
      uint64_t nearest = kBackground;
      for (uint32_t j = 0; j < side; ++j) {
        const uint64_t* row = samples + (uint64_t{y} * side + j) * (uint64_t{tiles.width} * side);
        for (uint32_t i = 0; i < side; ++i) nearest = min_of(nearest, row[uint64_t{x} * side + i]);
      }
      depth[uint64_t{y} * tiles.width + x] =
          nearest == kBackground ? bits_float(0x7f800000u) : depth_of(sample_depth_code(nearest));
    });
  }

  /// The middle of the depths of a code, in single precision.
  SCREE_HD float depth_of(uint32_t code) const {
    if (orthographic)
      return (static_cast<float>(code) + 0.5f) * (range * (1.0f / static_cast<float>(1u << kDepthBits)));
    return 1.0f / bits_float(kFarthestBits + 2 * (kFarthestDepthCode - code) + 1);
  }
};

/// Eye-dome lighting: nearer neighbours darken a pixel. Source: Boucheny 2009 (doctoral thesis), chapter 3. It uses
/// differences of log2 depth, so that it is the same at every scale.
struct EyeDome {
  PixelTiles tiles;
  DepthPicture picture;
  int32_t radius;  // pixels
  float strength;
  float* visibility;

  template <class Team>
  SCREE_HD void operator()(uint32_t item, Team team) const {
    const int32_t across = radius;
    const int32_t aslant = static_cast<int32_t>(static_cast<float>(radius) * 0.70710678f + 0.5f);
    // An orthographic camera takes differences relative to the picture's height. This equals a perspective view from
    // the distance at which the view is that high.
    const float per_height = 1.4426950f / (picture.pixel_y * static_cast<float>(picture.height));
    tiles.for_each(item, team, [&](uint32_t x, uint32_t y, bool inside) {
      if (!inside) return;
      const float z = picture.at(x, y);
      float sum = 0;
      if (z < bits_float(0x7f800000u)) {
        const float own = picture.orthographic ? z * per_height : std::log2(z);
        for (int32_t j = -1; j <= 1; ++j) {
          for (int32_t i = -1; i <= 1; ++i) {
            const int32_t distance = i == 0 || j == 0 ? across : aslant;
            const int32_t there_x = static_cast<int32_t>(x) + i * distance;
            const int32_t there_y = static_cast<int32_t>(y) + j * distance;
            if (!picture.holds(there_x, there_y)) continue;
            const float other = picture.at(static_cast<uint32_t>(there_x), static_cast<uint32_t>(there_y));
            sum += max_of(own - (picture.orthographic ? other * per_height : std::log2(other)), 0.0f);
          }
        }
      }
      visibility[uint64_t{y} * picture.width + x] = std::exp(sum * (-0.125f * kEyeDomeStrength * strength));
    });
  }
};

/// Screen-space ambient occlusion before its blur. Source: McGuire, Mara, Luebke 2012, Scalable Ambient Obscurance,
/// with lengths in units of the radius. The radius is a share of the picture's height at the pixel's depth.
struct Obscurance {
  PixelTiles tiles;
  DepthPicture picture;
  float radius;  // pixels
  float spiral[kObscuranceSamples][2];
  float rotation[kObscuranceRotations][2];  // cosine, sine
  float* open;

  template <class Team>
  SCREE_HD void operator()(uint32_t item, Team team) const {
    tiles.for_each(item, team, [&](uint32_t x, uint32_t y, bool inside) {
      if (inside) open[uint64_t{y} * picture.width + x] = look(x, y);
    });
  }

 private:
  /// The step in view space from pixel (x, y), whose depth is z, to the pixel (i, j) further, whose depth is `there`.
  SCREE_HD void step(uint32_t x, uint32_t y, float z, int32_t i, int32_t j, float there, float out[3]) const {
    out[2] = there - z;
    const float from_x = static_cast<float>(x) + 0.5f - 0.5f * static_cast<float>(picture.width);
    const float from_y = static_cast<float>(y) + 0.5f - 0.5f * static_cast<float>(picture.height);
    const float along_x = static_cast<float>(i);
    const float along_y = static_cast<float>(j);
    out[0] = picture.pixel_x * (picture.orthographic ? along_x : from_x * out[2] + along_x * there);
    out[1] = picture.pixel_y * (picture.orthographic ? along_y : from_y * out[2] + along_y * there);
  }

  /// The step to a neighbour along one axis, on the side with the smaller change of depth, where the surface continues.
  /// False if there is none.
  SCREE_HD bool tangent(uint32_t x, uint32_t y, float z, int32_t i, int32_t j, float out[3]) const {
    float best = bits_float(0x7f800000u);
    for (int32_t sign = -1; sign <= 1; sign += 2) {
      const int32_t there_x = static_cast<int32_t>(x) + sign * i;
      const int32_t there_y = static_cast<int32_t>(y) + sign * j;
      if (!picture.holds(there_x, there_y)) continue;
      const float there = picture.at(static_cast<uint32_t>(there_x), static_cast<uint32_t>(there_y));
      if (!(abs_of(there - z) < best)) continue;
      best = abs_of(there - z);
      step(x, y, z, sign * i, sign * j, there, out);
      for (int c = 0; c < 3; ++c) out[c] = out[c] * static_cast<float>(sign);
    }
    return best < bits_float(0x7f800000u);
  }

  SCREE_HD float look(uint32_t x, uint32_t y) const {
    const float z = picture.at(x, y);
    if (!(z < bits_float(0x7f800000u))) return 1.0f;
    float right[3];
    float down[3];
    if (!tangent(x, y, z, 1, 0, right) || !tangent(x, y, z, 0, 1, down)) return 1.0f;
    // Unit length and towards the eye, in units of one over the radius.
    const float size = 1.0f / (radius * picture.pixel_side(z));
    float normal[3] = {down[1] * right[2] - down[2] * right[1], down[2] * right[0] - down[0] * right[2],
                       down[0] * right[1] - down[1] * right[0]};
    const float largest = max_of(abs_of(normal[0]), max_of(abs_of(normal[1]), abs_of(normal[2])));
    for (int c = 0; c < 3; ++c) normal[c] = normal[c] / largest;
    const float length = std::sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]);
    const float scale = size / length;

    const uint32_t turn = static_cast<uint32_t>(mix_bits(uint64_t{y} << 32 | x)) % kObscuranceRotations;
    const float cosine = rotation[turn][0];
    const float sine = rotation[turn][1];
    float sum = 0;
    for (uint32_t s = 0; s < kObscuranceSamples; ++s) {
      const float a = spiral[s][0];
      const float b = spiral[s][1];
      const auto i = static_cast<int32_t>(round_even(cosine * a - sine * b));
      const auto j = static_cast<int32_t>(round_even(sine * a + cosine * b));
      const int32_t there_x = static_cast<int32_t>(x) + i;
      const int32_t there_y = static_cast<int32_t>(y) + j;
      if (!picture.holds(there_x, there_y)) continue;
      const float there = picture.at(static_cast<uint32_t>(there_x), static_cast<uint32_t>(there_y));
      float v[3];
      step(x, y, z, i, j, there, v);
      const float rise = (v[0] * normal[0] + v[1] * normal[1] + v[2] * normal[2]) * scale;
      const float squared = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]) * (size * size);
      const float within = 1.0f - squared;
      // Written so that infinite steps, to the background, contribute 0.
      if (!(within > 0.0f) || !(rise > kObscuranceBias)) continue;
      sum += within * within * within * (rise - kObscuranceBias) / (squared + 0.01f);
    }
    return max_of(1.0f - sum * (kObscuranceStrength / static_cast<float>(kObscuranceSamples)), 0.0f);
  }
};

/// Removes the hash's noise from `open`: averages the pixels around, with smaller weights for other depths.
struct BlurObscurance {
  PixelTiles tiles;
  DepthPicture picture;
  float radius;  // pixels; the obscurance's
  const float* open;
  bool multiply;  // multiplies `visibility` instead of replacing it
  float* visibility;

  template <class Team>
  SCREE_HD void operator()(uint32_t item, Team team) const {
    tiles.for_each(item, team, [&](uint32_t x, uint32_t y, bool inside) {
      if (!inside) return;
      const float z = picture.at(x, y);
      float sum = 1;
      float weights = 1;
      if (z < bits_float(0x7f800000u)) {
        const float scale = 1.0f / (radius * picture.pixel_side(z));
        sum = weights = 0;
        for (int32_t j = -kBlurRadius; j <= kBlurRadius; ++j) {
          for (int32_t i = -kBlurRadius; i <= kBlurRadius; ++i) {
            const int32_t there_x = static_cast<int32_t>(x) + i;
            const int32_t there_y = static_cast<int32_t>(y) + j;
            if (!picture.holds(there_x, there_y)) continue;
            const uint64_t there = static_cast<uint64_t>(there_y) * picture.width + static_cast<uint64_t>(there_x);
            const float weight = max_of(1.0f - abs_of(picture.depth[there] - z) * scale, 0.0f);
            sum += weight * open[there];
            weights += weight;
          }
        }
      }
      float* out = visibility + uint64_t{y} * picture.width + x;
      *out = (multiply ? *out : 1.0f) * (sum / weights);
    });
  }
};

/// Runs the passes for `options`. Afterwards visibility is one factor per pixel. `depth` and `open`: room for as many
/// floats; `open` only for ssao. `run(pass, tiles)` starts a pass.
template <class Run>
inline void run_occlusion(const View& view, uint32_t side, const uint64_t* samples, const ShadeOptions& options,
                          float* depth, float* open, float* visibility, const Run& run) {
  const PixelTiles tiles{view.width / side, 0, view.height / side};
  const auto range = static_cast<float>(view.orthographic ? view.z_far - view.z_near : 0.0);
  const DepthPicture picture = make_depth_picture(view, side, depth);
  run(FindDepths{tiles, samples, side, range, view.orthographic, depth}, tiles.count());
  if (options.edl) {
    const auto radius = static_cast<int32_t>(options.edl_radius);
    run(EyeDome{tiles, picture, radius, options.edl_strength, visibility}, tiles.count());
  }
  if (!options.ssao) return;
  const float radius = max_of(options.ssao_radius * static_cast<float>(picture.height), 2.0f);
  Obscurance pass{tiles, picture, radius, {}, {}, open};
  constexpr double kTurn = 6.283185307179586;
  for (uint32_t i = 0; i < kObscuranceSamples; ++i) {
    const double place = (i + 0.5) / kObscuranceSamples;
    pass.spiral[i][0] =
        static_cast<float>(place * static_cast<double>(radius) * std::cos(place * kObscuranceTurns * kTurn));
    pass.spiral[i][1] =
        static_cast<float>(place * static_cast<double>(radius) * std::sin(place * kObscuranceTurns * kTurn));
  }
  for (uint32_t i = 0; i < kObscuranceRotations; ++i) {
    pass.rotation[i][0] = static_cast<float>(std::cos(kTurn * i / kObscuranceRotations));
    pass.rotation[i][1] = static_cast<float>(std::sin(kTurn * i / kObscuranceRotations));
  }
  run(pass, tiles.count());
  run(BlurObscurance{tiles, picture, radius, open, options.edl, visibility}, tiles.count());
}

}  // namespace SCREE_ISA
}  // namespace scree::kernels
