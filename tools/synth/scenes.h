// The four measured scenes as lists of meshes, instances and cameras.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "tools/synth/scene_functions.h"

namespace scree::synth {

/// An instance: scaled, then rotated about z by the angle of (cosine, sine), then translated. `matrix` is the product,
/// column-major, each element rounded once to float; it is the definition.
struct SceneInstance {
  uint32_t mesh = 0;
  double cosine = 1, sine = 0;
  std::array<double, 3> scale{1, 1, 1};
  std::array<double, 3> translation{};
  std::array<float, 16> matrix{};
};

/// A camera. +z is up; the vertical field of view is 60 degrees.
struct SceneCamera {
  std::string name;
  std::array<double, 3> eye{};
  std::array<double, 3> target{};
};

/// The camera's pose in the world as a column-major matrix: x right, y up, looking along -z.
std::array<double, 16> camera_to_world(const SceneCamera& camera);

struct Scene {
  std::string name;
  uint32_t width = 1920;  // width of the measured picture, pixels
  uint32_t height = 1080;
  std::vector<MeshRecipe> meshes;
  std::vector<SceneInstance> instances;
  std::vector<SceneCamera> cameras;

  uint64_t unique_triangles() const;
  uint64_t drawn_triangles() const;
};

/// Scene A, B, C or D. `scale` (0 < scale <= 1) is approximately the share of its triangles that is kept: every mesh's
/// n becomes n * sqrt(scale), rounded to a multiple of 8 (D: to a whole number), at least 8 (D: 1). Everything else
/// stays the same, with one exception: A's tiles, which then cover fewer grid steps, are stretched by 4080 / n in x and
/// y (not in z). So the terrain fills the same 1020 x 765 units, and the pictures stay similar; the close-up camera
/// keeps its height above ground. Scale 1 is the definition. D has row order only.
Scene terrain_scene(MeshOrder order, double scale);
Scene lantern_scene(MeshOrder order, double scale);
Scene zorahlike_scene(MeshOrder order, double scale);
Scene sponzalike_scene(double scale);

}  // namespace scree::synth
