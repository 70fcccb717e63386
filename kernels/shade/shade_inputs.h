// The input of shading a picture: scene, view, options, light and the sun's shadow maps.
#pragma once

#include "kernels/raster/transform.h"
#include "kernels/scene_view.h"
#include "kernels/shade/srgb.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

inline constexpr float kAmbient = 0.2f;  // the share of the camera's light on a surface that is seen edge-on

/// The nearest and the farthest depth code of a picture. Show::kDepth spreads its greys over this range.
struct DepthRange {
  uint32_t nearest = kFarthestDepthCode;
  uint32_t farthest = 0;
};

/// Converts view space to world space, for light.
struct LightFrame {
  float axes[3][3];  // world directions of view space: x right, y down, z away
  float unit;        // view space's units (ShadeInputs) per world unit
  float far_plane;   // orthographic: its distance in view space's units
  Lighting lighting;
};

/// A SunShadow::Map as shading reads it.
struct SunMap {
  const uint64_t* samples = nullptr;
  int32_t width = 0;
  int32_t height = 0;
  // From view space to samples from the map's top left corner, and to levels: 2^28 on the map's near plane, 0 on its
  // far one.
  float rows[3][4] = {};
  float half_sample = 0;  // half the side of a sample, in levels
  // Levels per sample by which a plane rises along a row whose product with its normal equals that of the third row.
  float steepness = 0;
};

/// A SunShadow as shading reads it.
struct SunMaps {
  uint32_t light = ~0u;
  uint32_t count = 0;  // 0: no light casts shadows
  SunMap maps[kMostSunMaps];
};

/// The input of all shading of one picture, for every Show.
struct ShadeInputs {
  SceneView scene;
  FrameView view;
  ShadeOptions options;
  const Transform* transforms;  // by instance; null if the team makes its own (Team::kMakesTransforms)
  const SrgbTables* srgb;
  const DepthRange* depth_range;  // for Show::kDepth only
  // Scales view space to sub-pixels on all axes: x is unchanged, y times `aspect`, the depth row times `focal`.
  float aspect;
  float focal;
  LightFrame light;  // for Show::kSurface only
  SunMaps sun;       // likewise
};

/// `unit`: LightFrame::unit of the picture's view.
inline SunMap make_sun_map(const SunShadow::Map& sun, const View& view, double unit) {
  const FrameView map = make_frame_view(sun.view);
  constexpr double kLevels = 1u << kDepthBits;
  SunMap out;
  out.samples = sun.samples;
  out.width = map.width;
  out.height = map.height;
  const double* const world[3] = {map.row_x, map.row_y, map.row_w};
  const double scale[3] = {1.0 / kSubpixels, 1.0 / kSubpixels, kLevels};
  const double start[3] = {0.5 * map.width, 0.5 * map.height, kLevels * map.offset_w};
  for (int r = 0; r < 3; ++r) {
    double eye = start[r];
    for (int i = 0; i < 3; ++i) eye += scale[r] * world[r][i] * (view.eye[i] - map.eye[i]);
    const double* const axes[3] = {view.right, view.up, view.forward};
    for (int a = 0; a < 3; ++a) {
      const double along = world[r][0] * axes[a][0] + world[r][1] * axes[a][1] + world[r][2] * axes[a][2];
      out.rows[r][a] = static_cast<float>((a == 1 ? -1.0 : 1.0) * scale[r] * along / unit);  // view space's y is down
    }
    out.rows[r][3] = static_cast<float>(eye);
  }
  const double sample = 2.0 * sun.view.half_width / sun.view.width;  // world units
  const double levels = kLevels / (sun.view.z_far - sun.view.z_near) * sample;
  out.half_sample = static_cast<float>(0.5 * levels);
  out.steepness = static_cast<float>(levels * levels);
  return out;
}

inline ShadeInputs make_shade_inputs(const SceneView& scene, const View& view, const ShadeOptions& options,
                                     const Transform* transforms, const SrgbTables* srgb,
                                     const DepthRange* depth_range) {
  ShadeInputs out{scene, make_frame_view(view), options, transforms, srgb, depth_range, 1.0f, 1.0f, {}, {}};
  const double per_x = static_cast<double>(out.view.half_width) / view.half_width;
  const double per_y = static_cast<double>(out.view.half_height) / view.half_height;
  out.aspect = static_cast<float>(per_x / per_y);
  out.focal = static_cast<float>(view.orthographic ? per_x * (view.z_far - view.z_near) : per_x);
  for (int i = 0; i < 3; ++i) {
    out.light.axes[0][i] = static_cast<float>(view.right[i]);
    out.light.axes[1][i] = static_cast<float>(-view.up[i]);
    out.light.axes[2][i] = static_cast<float>(view.forward[i]);
  }
  const double unit = view.orthographic ? per_x : per_x / view.z_near;
  out.light.unit = static_cast<float>(unit);
  out.light.far_plane = static_cast<float>(per_x * view.z_far);
  out.light.lighting = lighting_of(scene, options);
  if (options.sun == nullptr) return out;
  out.sun.light = options.sun->light;
  out.sun.count = options.sun->map_count;
  for (uint32_t i = 0; i < out.sun.count; ++i) out.sun.maps[i] = make_sun_map(options.sun->maps[i], view, unit);
  return out;
}

}  // namespace SCREE_ISA
}  // namespace scree::kernels
