// Cameras in the measured scenes.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <random>

#include "lab/setup/views.h"
#include "tools/synth/scenes.h"

namespace scree::tests {

struct ImageSize {
  uint32_t width, height;
};

/// Camera `number`, from somewhere between a scene's first and last view, looking to a point near their targets. Every
/// fifth one is orthographic, and every ninth one has the size `tall`.
inline kernels::View random_view(const synth::Scene& scene, std::mt19937& random, int number, ImageSize wide,
                                 ImageSize tall) {
  std::uniform_real_distribution<double> share(0, 1);
  synth::SceneCamera camera = scene.cameras.front();
  const synth::SceneCamera& other = scene.cameras.back();
  const double t = share(random);
  double distance = 0;
  for (size_t axis = 0; axis < 3; ++axis) {
    camera.eye[axis] += t * (other.eye[axis] - camera.eye[axis]);
    camera.target[axis] += share(random) * (other.target[axis] - camera.target[axis]) +
                           (share(random) - 0.5) * (camera.eye[axis] - camera.target[axis]);
    distance += std::abs(camera.target[axis] - camera.eye[axis]);
  }
  const ImageSize size = number % 9 == 4 ? tall : wide;
  kernels::View view = lab::scene_view(camera, size.width, size.height);
  if (number % 5 != 3) return view;
  view.orthographic = true;
  view.half_height = 0.3 * distance;
  view.half_width = view.half_height * view.width / view.height;
  view.z_far = view.z_near + 4 * distance;
  return view;
}

}  // namespace scree::tests
