// The layers of a picture beside its colours: depth, triangle, instance, normal and texture coordinates of every pixel,
// each from the pixel's nearest sample.
#pragma once

#include "kernels/frame.h"
#include "kernels/raster/depth.h"
#include "kernels/shade/pixels.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

/// The distance of the centre of a depth code from the plane through the eye that is perpendicular to the view
/// direction, in world units; infinity for the background.
SCREE_HD inline double distance_of_code(uint32_t code, bool orthographic, double z_near, double z_far) {
  if (code >= kFarthestDepthCode) return static_cast<double>(bits_float(0x7f800000u));
  const double value = depth_value_of_code(code, orthographic);
  return orthographic ? z_far - value * (z_far - z_near) : z_near / value;
}

/// The samples of a picture, pixel by pixel.
struct PixelSamples {
  const uint64_t* samples;
  uint32_t width;  // pixels
  uint32_t side;   // samples per pixel and axis

  /// The smallest and therefore nearest of a pixel's samples, and its position; of equal samples the first.
  SCREE_HD uint64_t nearest(uint32_t x, uint32_t y, uint32_t& sample_x, uint32_t& sample_y) const {
    const uint64_t row = uint64_t{width} * side;
    uint64_t found = kBackground;
    sample_x = x * side;
    sample_y = y * side;
    for (uint32_t j = 0; j < side; ++j) {
      for (uint32_t i = 0; i < side; ++i) {
        const uint64_t sample = samples[(uint64_t{y} * side + j) * row + uint64_t{x} * side + i];
        if (sample >= found) continue;
        found = sample;
        sample_x = x * side + i;
        sample_y = y * side + j;
      }
    }
    return found;
  }
};

/// Makes depths and ids. An item is kPixels consecutive pixels of the picture, in row order.
struct MakeLayers {
  static constexpr uint32_t kPixels = 128;

  const uint64_t* instance_base;  // SceneView::instance_base
  uint64_t instance_count;
  PixelSamples pixels;
  uint32_t height;  // pixels
  bool orthographic;
  double z_near;
  double z_far;
  LayerTargets out;

  uint32_t items() const { return static_cast<uint32_t>((uint64_t{pixels.width} * height + kPixels - 1) / kPixels); }

  template <class Team>
  SCREE_HD void operator()(uint32_t item, Team team) const {
    static_assert(uint64_t{kMaxImageSide} * kMaxImageSide < 1u << 31);
    const uint32_t first = item * kPixels;
    const uint32_t end = min_of(first + kPixels, pixels.width * height);
    for (uint32_t i = first + team.rank(); i < end; i += team.size()) set(i);
  }

  SCREE_HD void set(uint32_t pixel) const {
    uint32_t x;
    uint32_t y;
    const uint64_t nearest = pixels.nearest(pixel % pixels.width, pixel / pixels.width, x, y);
    const bool is_background = nearest == kBackground;
    const uint64_t id = sample_id(nearest);
    if (out.depth != nullptr)
      out.depth[pixel] = static_cast<float>(distance_of_code(
          is_background ? kFarthestDepthCode : sample_depth_code(nearest), orthographic, z_near, z_far));
    if (out.triangle != nullptr) out.triangle[pixel] = is_background ? -1 : static_cast<int64_t>(id);
    if (out.instance != nullptr)
      out.instance[pixel] =
          is_background ? -1 : static_cast<int32_t>(last_not_above(instance_count, id, InstanceBases{instance_base}));
  }
};

/// Takes a Shader's place: the surface that a sample shows, in double precision and without the GPU's approximate
/// operations.
template <bool kOrthographic, bool kNormal>
struct Surface {
  using Texels = SceneTexels;  // never read
  static constexpr uint32_t kChannels = kNormal ? 3 : 2;

  ShadeInputs in;

  /// All lanes of a team must call it. `wanted`: whether the lane has a sample that is not background.
  template <class Team>
  SCREE_HD void operator()(Team team, bool wanted, uint64_t sample, uint32_t x, uint32_t y,
                           ShadeState<Team, Surface>& state, float values[kChannels]) const {
    const uint64_t id = sample_id(sample);
    locate(team, in.scene, id, wanted, state.at);
    if (!wanted) return;
    const uint32_t triangle = static_cast<uint32_t>(id - state.at.first_id);
    const PlacedChunk at =
        place_chunk<ChunkKinds::kMixed>(in.scene, state.at.chunk, triangle, state.source.get(in, state.at.instance));
    if (!kNormal && (at.mesh.attributes & format::kHasUv) == 0) {
      values[0] = values[1] = 0;
      return;
    }
    uint32_t vertex[3];
    fetch_triangle(at.reader, triangle, vertex);
    const Corners<double> corners = fetch_corners<double>(at.reader, vertex);
    double weights[3];
    hit_weights(intersect_plane_at<kOrthographic>(in.view, at.transform, corners, static_cast<int32_t>(x),
                                                  static_cast<int32_t>(y)),
                weights);
    if constexpr (kNormal) {
      double normal[3];
      world_normal(at, in.scene.matrices[in.scene.instances[state.at.instance].matrix], vertex, corners, weights,
                   normal);
      for (int i = 0; i < 3; ++i) values[i] = static_cast<float>(normal[i]);
    } else {
      const TextureCorners<double> uv = texture_corners<double>(at, vertex, nullptr, false);
      for (int c = 0; c < 2; ++c)
        values[c] = static_cast<float>(static_cast<double>(uv.stored[c]) * format::exp2i(uv.exponent) +
                                       (weights[1] * uv.edge[0][c] + weights[2] * uv.edge[1][c]));
    }
  }
};

/// Makes the floats of every pixel's nearest sample, one tile per item; 0 on the background.
template <class SurfaceOfPixels>
struct MakeSurfaces {
  SurfaceOfPixels surface;
  PixelTiles tiles;
  PixelSamples pixels;
  float* out;  // SurfaceOfPixels::kChannels per pixel

  template <class Team>
  SCREE_HD void operator()(uint32_t item, Team team) const {
    constexpr uint32_t kChannels = SurfaceOfPixels::kChannels;
    ShadeState<Team, SurfaceOfPixels> state;
    tiles.for_each(item, team, [&](uint32_t x, uint32_t y, bool inside) {
      uint32_t sample_x = 0;
      uint32_t sample_y = 0;
      const uint64_t sample = inside ? pixels.nearest(x, y, sample_x, sample_y) : kBackground;
      float values[kChannels] = {};
      surface(team, sample != kBackground, sample, sample_x, sample_y, state, values);
      float* const place = out + (uint64_t{y} * tiles.width + x) * kChannels;
      for (uint32_t i = 0; inside && i < kChannels; ++i) place[i] = values[i];
    });
  }
};

/// Calls run(pass, items) with the passes that make the layers of a picture. `view` and `samples`: the whole picture's,
/// in samples. `transforms`: as for ShadeInputs.
template <class Run>
inline void run_layers(const SceneView& scene, const View& view, uint32_t samples_per_side, const uint64_t* samples,
                       const Transform* transforms, const LayerTargets& out, const Run& run) {
  const uint32_t width = view.width / samples_per_side;
  const uint32_t height = view.height / samples_per_side;
  const PixelSamples pixels{samples, width, samples_per_side};
  if (out.depth != nullptr || out.triangle != nullptr || out.instance != nullptr) {
    const MakeLayers pass{scene.instance_base, scene.instance_count, pixels,     height,
                          view.orthographic,   view.z_near,          view.z_far, out};
    run(pass, pass.items());
  }
  if (out.normal == nullptr && out.uv == nullptr) return;
  const PixelTiles tiles{width, 0, height};
  const ShadeInputs in = make_shade_inputs(scene, view, ShadeOptions{}, transforms, nullptr, nullptr);
  const auto with_camera = [&]<bool kOrthographic>() {
    using Normal = Surface<kOrthographic, true>;
    using Uv = Surface<kOrthographic, false>;
    if (out.normal != nullptr) run(MakeSurfaces<Normal>{{in}, tiles, pixels, out.normal}, tiles.count());
    if (out.uv != nullptr) run(MakeSurfaces<Uv>{{in}, tiles, pixels, out.uv}, tiles.count());
  };
  view.orthographic ? with_camera.template operator()<true>() : with_camera.template operator()<false>();
}

}  // namespace SCREE_ISA
}  // namespace scree::kernels
