// The shadows of a scene's sun, its first directional light: what the light sees, drawn as any other view.
#pragma once

#include <cstdint>
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

/// The view along the unit vector `direction` of the part of `box` that `camera` sees, with two samples around it, and
/// of all that lies between that part and the light within the box. Its longer side has `side` samples, which are
/// squares; fewer where they would be finer than 2^-18 of the distance of what is seen. Leaves out and clips away what
/// `camera` does. Nothing if the camera sees nothing of the box.
std::optional<kernels::View> sun_view(const Vec3& direction, const WorldBox& box, const kernels::View& camera,
                                      uint32_t side);

/// Draws where the sun reaches, camera by camera. Blended surfaces cast shadows only where they are opaque. One thread
/// at a time, on a GPU with the scene's device free for it.
class ShadowMap {
 public:
  /// `side`: samples, kLeastShadowSide to kernels::kMaxImageSide. `device`: which draws the scene; null: the CPU. Both
  /// outlive this. Errors kUsage: the scene has no directional light; those of DeviceScene::add_view().
  static Result<ShadowMap> create(const Scene& scene, uint32_t side, DeviceScene* device);

  /// The shadows in a picture of `camera`, for ShadeOptions::sun until the next call; null if it shows nothing. The
  /// picture itself is drawn after this. Errors those of kernels::draw_cpu or DeviceView::draw(), kMemory.
  Result<const kernels::SunShadow*> draw(const kernels::View& camera, uint32_t threads);

  const Duration& draw_time() const { return draw_time_; }  // of the last draw()

 private:
  ShadowMap(const Scene& scene, uint32_t side, uint32_t light)
      : scene_(&scene), side_(side), sun_{nullptr, {}, light} {}

  const Scene* scene_;
  uint32_t side_;
  kernels::SunShadow sun_;
  std::optional<DeviceView> device_;
  std::vector<uint64_t> samples_;  // where the CPU draws
  Duration draw_time_;
};

}  // namespace scree::runtime
