// The shadows of a scene's sun, its first directional light: views along its rays, drawn like any other view.
#pragma once

#include <algorithm>
#include <cstdint>
#include <iterator>
#include <limits>
#include <optional>
#include <vector>

#include "format/result.h"
#include "kernels/frame.h"
#include "runtime/draw/device_scene.h"
#include "runtime/scene/camera.h"
#include "runtime/scene/scene.h"
#include "runtime/threads/stopwatch.h"

namespace scree::runtime {

inline constexpr uint32_t kLeastShadowSide = 64;  // samples; the most are kernels::kMaxImageSide
inline constexpr uint32_t kShadowSide = 4096;

/// The scene's first directional light, an index of SceneView::lights in host memory.
std::optional<uint32_t> find_sun(const kernels::SceneView& scene);

/// Whether a picture shows the sun's light, and so its shadows.
inline bool shows_sun(const kernels::SceneView& scene, const kernels::ShadeOptions& options) {
  return kernels::shades_surfaces(scene, options) && kernels::lighting_of(scene, options) == kernels::Lighting::kScene;
}

/// The view along the unit vector `direction` of the part of `box` that is visible to `camera`, with two samples around
/// it, and of the part of the box between that part and the light. Its longer side has `side` samples, which are
/// squares. It has fewer if they would be finer than 2^-18 of the distance of the visible part. Leaves out and clips
/// away what `camera` does. `margin`: the share of the visible part's width and height that is added on each side, as
/// far as the box extends. The depth is then that of the whole box. `farthest`: the visible part ends at this distance
/// from the eye's plane. nullopt if no part of the box is visible to the camera.
std::optional<kernels::View> sun_view(const Vec3& direction, const WorldBox& box, const kernels::View& camera,
                                      uint32_t side, double margin = 0,
                                      double farthest = std::numeric_limits<double>::infinity());

/// The maps of the shadows in a picture of `camera`, without samples yet: one of `side` samples for all that is
/// visible; or, if the farthest visible point may be more than kDeepView times as far away as the nearest one,
/// kMostSunMaps maps of half the side. These divide the range of distances into equal ratios of at most kMostSunRatio,
/// nearest first. `margin`: as for sun_view(). nullopt if no part of `box` is visible. Requires find_sun().
std::optional<kernels::SunShadow> sun_of(const kernels::SceneView& scene, const WorldBox& box,
                                         const kernels::View& camera, uint32_t side, double margin = 0);
inline constexpr double kDeepView = 4;
inline constexpr double kMostSunRatio = 8;

/// The cameras that a shadow map is for.
enum class ShadowFit {
  kExact,   // one alone: sun_view() without a margin, as in the pictures of `scree render`
  kMoving,  // it and the cameras near it, so that a camera that moves needs no map per picture
};

/// Draws where the sun reaches, and keeps these maps until a picture needs others. Blended surfaces cast shadows only
/// where they are opaque. One thread at a time, on a GPU with the scene's device current and free for it.
class ShadowMap {
 public:
  /// `device`: which draws the scene; null: the CPU. Both outlive this. Takes no memory before the first draw().
  ShadowMap(const Scene& scene, DeviceScene* device) : scene_(&scene), device_(device) {}

  /// The shadows in a picture of `camera`, for ShadeOptions::sun until the next call; null if no part of the scene is
  /// visible. The picture itself is drawn after this. `side`: as for sun_of(), kLeastShadowSide to
  /// kernels::kMaxImageSide. A map of the last call is kept if it is the same, or serves a moving camera: it has
  /// everything that it is for, with samples at most kMostCoarser times as large as those of the exact map. `is_over`:
  /// as for DeviceView::draw(); a map that it ends is not kept. Errors kUsage: the scene has no directional light;
  /// kMemory; those of DeviceScene::add_view(), kernels::draw_cpu and DeviceView::draw().
  Result<const kernels::SunShadow*> draw(const kernels::View& camera, uint32_t side, uint32_t threads,
                                         ShadowFit fit = ShadowFit::kExact, const IsOver& is_over = {});

  /// The next draw() keeps no map: the scene has changed, or the bits of View::omitted.
  void forget() { std::fill(std::begin(is_drawn_), std::end(is_drawn_), false); }

  // About the last draw():
  const Duration& draw_time() const { return draw_time_; }  // 0 if all maps were kept
  uint64_t left_bytes() const { return left_bytes_; }       // of chunks that the maps lack

 private:
  static constexpr double kMargin = 0.25;  // of ShadowFit::kMoving
  static constexpr double kMostCoarser = 3;

  Result<void> draw_map(uint32_t number, uint32_t threads, const IsOver& is_over);

  const Scene* scene_;
  DeviceScene* device_;
  bool is_drawn_[kernels::kMostSunMaps] = {};
  uint32_t side_ = 0;  // of the last draw()
  kernels::SunShadow sun_{};
  std::optional<DeviceView> on_device_;
  std::vector<uint64_t> samples_[kernels::kMostSunMaps];  // where the CPU draws
  Duration draw_time_;
  uint64_t left_bytes_ = 0;
};

}  // namespace scree::runtime
