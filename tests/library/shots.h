// Cameras and options for tests that draw many frames.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <random>
#include <vector>

#include "tests/library/handles.h"

namespace scree::tests {

inline scree_camera look_at(double x, double y, double z) {
  auto camera = sized<scree_camera>();
  camera.kind = SCREE_CAMERA_LOOK_AT;
  camera.eye[0] = x;
  camera.eye[1] = y;
  camera.eye[2] = z;
  camera.look_at_box = 1;
  return camera;
}

/// The number of colours that differ by more than one level.
inline size_t differing(const std::string& a, const std::string& b) {
  REQUIRE(a.size() == b.size());
  size_t count = 0;
  for (size_t i = 0; i < a.size(); ++i)
    count += std::abs(static_cast<uint8_t>(a[i]) - static_cast<uint8_t>(b[i])) > 1 ? 1 : 0;
  return count;
}

struct Shot {
  scree_camera camera;
  scree_draw_options options;
};

/// Random shots, the same for the same seed.
inline std::vector<Shot> random_shots(size_t count, uint32_t seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> angle(0, 6.28), distance(1.5, 5);
  std::vector<Shot> shots;
  for (size_t i = 0; i < count; ++i) {
    const double a = angle(random), d = distance(random);
    const auto below = [&](uint32_t end) { return static_cast<uint32_t>(random() % end); };
    Shot shot{look_at(d * std::cos(a), 0.4 * d, d * std::sin(a)), draw_options(8 + below(60), 8)};
    shot.options.height += below(60);
    shot.options.samples = 1u << below(2);
    shot.options.show = static_cast<scree_show>(below(9));
    shot.options.flags = below(8);
    shot.options.background[3] = i % 2 == 0 ? 1.0f : 0.0f;
    shots.push_back(shot);
  }
  return shots;
}

/// The cameras of these shots.
inline std::vector<scree_camera> random_cameras(size_t count, uint32_t seed) {
  std::vector<scree_camera> cameras;
  for (const Shot& shot : random_shots(count, seed)) cameras.push_back(shot.camera);
  return cameras;
}

}  // namespace scree::tests
