#include "lab/setup/views.h"

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <numbers>

#include "runtime/scene/camera.h"

namespace scree::lab {

kernels::View scene_view(const synth::SceneCamera& camera, uint32_t width, uint32_t height) {
  const std::array<double, 16> world = synth::camera_to_world(camera);
  kernels::View view{};
  for (size_t i = 0; i < 3; ++i) {
    view.right[i] = world[i];
    view.up[i] = world[4 + i];
    view.forward[i] = -world[8 + i];
    view.eye[i] = world[12 + i];
  }
  view.half_height = std::tan(std::numbers::pi / 6);
  view.half_width = view.half_height * static_cast<double>(width) / height;
  view.z_near = 0.1;
  view.width = width;
  view.height = height;
  return view;
}

NamedView with_near(NamedView view, const kernels::SceneView& scene, double share) {
  const runtime::WorldBox box = runtime::scene_box(scene);
  const double size = std::hypot(box.max[0] - box.min[0], box.max[1] - box.min[1], box.max[2] - box.min[2]);
  for (kernels::View& frame : view.frames) frame.z_near = share * size;
  char name[32];
  std::snprintf(name, sizeof name, " near %g", share);
  view.name += name;
  return view;
}

std::vector<kernels::View> path_views(std::span<const synth::SceneCamera> cameras, uint32_t width, uint32_t height,
                                      uint32_t frames) {
  const synth::SceneCamera& from = cameras[0];
  const synth::SceneCamera& to = cameras[1];
  std::vector<kernels::View> views;
  for (uint32_t frame = 0; frame < frames; ++frame) {
    const double t = static_cast<double>(frame) / (frames - 1);
    synth::SceneCamera camera;
    for (size_t i = 0; i < 3; ++i) {
      camera.eye[i] = from.eye[i] + (to.eye[i] - from.eye[i]) * t;
      camera.target[i] = from.target[i] + (to.target[i] - from.target[i]) * t;
    }
    views.push_back(scene_view(camera, width, height));
  }
  return views;
}

}  // namespace scree::lab
