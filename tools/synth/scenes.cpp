#include "tools/synth/scenes.h"

#include <algorithm>
#include <cmath>

namespace scree::synth {
namespace {

SceneInstance make_instance(uint32_t mesh, double c, double s, std::array<double, 3> scale, std::array<double, 3> at) {
  SceneInstance instance{mesh, c, s, scale, at, {}};
  const double matrix[16] = {c * scale[0], s * scale[0], 0,     0, -s * scale[1], c * scale[1], 0, 0, 0, 0, scale[2], 0,
                             at[0],        at[1],        at[2], 1};
  for (size_t i = 0; i < 16; ++i) instance.matrix[i] = static_cast<float>(matrix[i] + 0.0);  // no -0
  return instance;
}

SceneInstance place(uint32_t mesh, std::array<double, 3> scale, std::array<double, 3> at) {
  return make_instance(mesh, 1, 0, scale, at);
}

/// n * sqrt(scale) as a multiple of `step`, at least `step`.
uint32_t scaled(uint32_t n, double scale, uint32_t step) {
  const double exact = static_cast<double>(n) * std::sqrt(scale) / step;
  return step * std::max(1u, static_cast<uint32_t>(std::lround(exact)));
}

MeshRecipe blob(uint32_t n, MeshOrder order, uint32_t seed, uint32_t round8, double amplitude, double frequency,
                uint32_t octaves) {
  return MeshRecipe{.kind = MeshKind::kBlob,
                    .n = n,
                    .order = order,
                    .seed = seed,
                    .round8 = round8,
                    .octaves = octaves,
                    .amplitude = amplitude,
                    .frequency = frequency};
}

/// n of the 100 classes of scene C; each class has 20 meshes.
constexpr uint32_t kZorahQuads[100] = {
    40,  40,  40,  40,  40,  40,  48,  48,  48,  56,  56,  56,  64,  64,  64,  64,  72,  72,  72,  72,
    80,  80,  80,  80,  88,  88,  88,  88,  96,  96,  96,  96,  104, 104, 104, 112, 112, 112, 112, 120,
    120, 120, 128, 128, 128, 128, 136, 136, 136, 144, 144, 144, 152, 152, 152, 160, 160, 168, 168, 168,
    176, 176, 184, 184, 192, 192, 200, 200, 208, 208, 216, 216, 224, 232, 232, 240, 248, 256, 256, 264,
    272, 280, 288, 296, 304, 320, 328, 336, 352, 368, 384, 400, 424, 448, 472, 512, 560, 624, 728, 992};
constexpr uint32_t kZorahMeshes = 2000;
constexpr uint32_t kZorahLargest = 1980;  // the mesh with n = 1288

/// Number of instances of the j-th mesh of a class: 260 in all.
uint32_t zorah_instances(uint32_t j) {
  return j < 14 ? 2 : (j < 18 ? 8 : (j == 18 ? 50 : 150));
}

}  // namespace

std::array<double, 16> camera_to_world(const SceneCamera& camera) {
  double f[3], r[2], u[3];
  for (size_t i = 0; i < 3; ++i) f[i] = camera.target[i] - camera.eye[i];
  double length = std::sqrt((f[0] * f[0] + f[1] * f[1]) + f[2] * f[2]);
  for (double& part : f) part = part / length;
  r[0] = f[1];  // f x (0, 0, 1)
  r[1] = -f[0];
  length = std::sqrt(r[0] * r[0] + r[1] * r[1]);
  r[0] = r[0] / length;
  r[1] = r[1] / length;
  u[0] = r[1] * f[2];  // r x f
  u[1] = -(r[0] * f[2]);
  u[2] = r[0] * f[1] - r[1] * f[0];
  return {r[0],  r[1],  0,     0, u[0],          u[1],          u[2],          0,
          -f[0], -f[1], -f[2], 0, camera.eye[0], camera.eye[1], camera.eye[2], 1};
}

uint64_t Scene::unique_triangles() const {
  uint64_t sum = 0;
  for (const MeshRecipe& mesh : meshes) sum += triangle_count(mesh);
  return sum;
}

uint64_t Scene::drawn_triangles() const {
  uint64_t sum = 0;
  for (const SceneInstance& instance : instances) sum += triangle_count(meshes[instance.mesh]);
  return sum;
}

Scene terrain_scene(MeshOrder order, double scale) {
  Scene scene{.name = "terrain400"};
  const uint32_t n = scaled(kTerrainQuads, scale, 8);
  const double stretch = static_cast<double>(kTerrainQuads) / n;
  for (uint32_t ty = 0; ty < kTerrainTilesY; ++ty)
    for (uint32_t tx = 0; tx < kTerrainTilesX; ++tx) {
      const MeshRecipe mesh{.kind = MeshKind::kTerrain, .n = n, .order = order, .tile_x = tx, .tile_y = ty};
      scene.instances.push_back(place(static_cast<uint32_t>(scene.meshes.size()), {stretch, stretch, 1}, {}));
      scene.meshes.push_back(mesh);
    }
  scene.cameras.push_back({"overview", {510, 20, 640}, {510, 340, 0}});
  // The ground under the close-up eye (x = 300, y = 200).
  const double ground =
      terrain_position(static_cast<int>(std::lround(4800 / stretch)), static_cast<int>(std::lround(3200 / stretch))).z;
  scene.cameras.push_back({"closeup", {300, 200, ground + 14.0}, {340, 232, ground - 6.0}});
  return scene;
}

Scene lantern_scene(MeshOrder order, double scale) {
  Scene scene{.name = "lantern3000"};
  scene.meshes.push_back(blob(scaled(288, scale, 8), order, 4242u, 8, 0.10, 2.0, 6));
  for (int ix = 0; ix < 50; ++ix)
    for (int iy = 0; iy < 60; ++iy) scene.instances.push_back(place(0, {10, 10, 10}, {30.0 * ix, 30.0 * iy, 0}));
  scene.cameras.push_back({"overview", {-18, -68, 75}, {200, 150, -60}});
  scene.cameras.push_back({"closeup", {6, -20, 7}, {40, 16, -1}});
  return scene;
}

Scene zorahlike_scene(MeshOrder order, double scale) {
  Scene scene{.name = "zorahlike", .width = 3840, .height = 2160};
  const double eye_x = -50, eye_y = -10;  // of the close-up camera; props have a distance of at least 4 units from it
  uint32_t q = 0;                         // number of the instance
  for (uint32_t m = 0; m < kZorahMeshes; ++m) {
    const uint32_t n = m == kZorahLargest ? 1288 : kZorahQuads[m / 20];
    const uint32_t hm = hash2(9001u, m, 0);
    const uint32_t category = hm & 7u;  // 0 floor tile, 1 wall panel, 2 column piece, 3 to 7 prop
    const uint32_t round8 = category <= 1 ? (hm >> 3) & 1u : (category == 2 ? 4 + (hm >> 3) % 5u : 2 + (hm >> 3) % 7u);
    const double amplitude = category <= 1 ? 0.04 : (category == 2 ? 0.06 : 0.08 + 0.12 * unit24(hash2(9002u, m, 0)));
    const double frequency = 2.0 + static_cast<double>((hm >> 8) % 4u);
    scene.meshes.push_back(blob(scaled(n, scale, 8), order, 50000u + 131u * m, round8, amplitude, frequency, 5));
    for (uint32_t i = 0; i < zorah_instances(m % 20); ++i, ++q) {
      const double u0 = unit24(hash2(7001u, q, 0)), u1 = unit24(hash2(7001u, q, 1));
      const double u2 = unit24(hash2(7001u, q, 2)), u3 = unit24(hash2(7001u, q, 3));
      const uint32_t hq = hash2(7002u, q, 0);
      // Yaw: t = tan(angle / 2) in [0, 1), then 0 to 3 quarter turns.
      const double t = unit24(hash2(7001u, q, 4));
      const double co = (1.0 - t * t) / (1.0 + t * t), si = 2.0 * t / (1.0 + t * t);
      const double quarter_cos[4] = {1, 0, -1, 0}, quarter_sin[4] = {0, 1, 0, -1};
      const double c4 = quarter_cos[hq & 3u], s4 = quarter_sin[hq & 3u];
      const double c = co * c4 - si * s4, s = co * s4 + si * c4;
      if (category == 0) {
        const int cell = static_cast<int>(u0 * 1350.0), level = cell / 450, r = cell % 450;
        scene.instances.push_back(
            make_instance(m, c4, s4, {2.1, 2.1, 0.3},
                          {-58.0 + 4.0 * (r % 30), -28.0 + 4.0 * (r / 30), 8.0 * level + (u1 - 0.5) * 0.2}));
      } else if (category == 1) {
        const int cell = static_cast<int>(u0 * 540.0), level = cell / 90, r = cell % 90;
        const double z = 2.0 + 4.0 * level, o = (u1 - 0.5) * 0.3;
        if (r < 30)
          scene.instances.push_back(place(m, {2.1, 0.35, 2.1}, {-58.0 + 4.0 * r, -30.0 + o, z}));
        else if (r < 60)
          scene.instances.push_back(place(m, {2.1, 0.35, 2.1}, {-58.0 + 4.0 * (r - 30), 30.0 + o, z}));
        else if (r < 75)
          scene.instances.push_back(place(m, {0.35, 2.1, 2.1}, {-60.0 + o, -28.0 + 4.0 * (r - 60), z}));
        else
          scene.instances.push_back(place(m, {0.35, 2.1, 2.1}, {60.0 + o, -28.0 + 4.0 * (r - 75), z}));
      } else if (category == 2) {
        const int cell = static_cast<int>(u0 * 360.0), level = cell / 72, r = cell % 72;
        scene.instances.push_back(make_instance(m, c, s, {0.9, 0.9, 2.5},
                                                {-55.0 + 10.0 * (r % 12), -25.0 + 10.0 * (r / 12), 2.4 + 4.8 * level}));
      } else {
        const double size = 0.12 + 1.1 * (u2 * u2 * u2);
        const int levels[4] = {0, 0, 1, 2}, level = levels[(hq >> 2) & 3u];
        double x = (u0 - 0.5) * 116.0;
        const double y = (u1 - 0.5) * 56.0, z = 8.0 * level + 0.3 + size * 0.8 + u3 * 0.5;
        const double dx = x - eye_x, dy = y - eye_y;
        if (level == 0 && dx * dx + dy * dy < 16.0) x = x + 8.0;
        const bool mirrored = ((hq >> 4) & 15u) == 0;  // 1 in 16 props: negative determinant
        scene.instances.push_back(make_instance(m, c, s, {mirrored ? -size : size, size, size}, {x, y, z}));
      }
    }
  }
  scene.cameras.push_back({"overview", {0, -84, 62}, {0, 0, 3}});
  scene.cameras.push_back({"closeup", {eye_x, eye_y, 2.6}, {0, 3, 4.5}});
  return scene;
}

Scene sponzalike_scene(double scale) {
  Scene scene{.name = "sponzalike"};
  uint32_t seed = 600000u;
  const auto add = [&](uint32_t n, uint32_t round8, double amplitude, uint32_t octaves, std::array<double, 3> size,
                       std::array<double, 3> at) {
    scene.instances.push_back(place(static_cast<uint32_t>(scene.meshes.size()), size, at));
    scene.meshes.push_back(blob(scaled(n, scale, 1), MeshOrder::kRow, seed, round8, amplitude, 3.0, octaves));
    seed += 977u;
  };
  // The room: 6 slabs.
  add(4, 0, 0, 0, {18.5, 8.5, 0.25}, {0, 0, -0.25});
  add(4, 0, 0, 0, {18.5, 8.5, 0.25}, {0, 0, 14.25});
  add(4, 0, 0, 0, {0.25, 8.5, 7.5}, {-18.25, 0, 7});
  add(4, 0, 0, 0, {0.25, 8.5, 7.5}, {18.25, 0, 7});
  add(4, 0, 0, 0, {18.5, 0.25, 7.5}, {0, -8.25, 7});
  add(4, 0, 0, 0, {18.5, 0.25, 7.5}, {0, 8.25, 7});
  // 4 galleries.
  for (int level = 0; level < 2; ++level)
    for (int side = -1; side <= 1; side += 2) add(6, 0, 0, 0, {18, 1.8, 0.2}, {0, 6.2 * side, 5.5 + 4.7 * level});
  // 28 columns and their bases.
  for (int level = 0; level < 2; ++level)
    for (int side = -1; side <= 1; side += 2)
      for (int i = 0; i < 7; ++i) {
        const double x = -15.0 + 5.0 * i, y = 4.6 * side, radius = level != 0 ? 0.35 : 0.45;
        add(24, 6, 0.03, 4, {radius, radius, level != 0 ? 2.2 : 2.7}, {x, y, level != 0 ? 7.9 : 2.65});
        add(6, 0, 0, 0, {0.65, 0.65, 0.15}, {x, y, level != 0 ? 5.85 : 0.15});
      }
  // 20 drapes.
  for (int side = -1; side <= 1; side += 2)
    for (int i = 0; i < 10; ++i) add(12, 1, 0.10, 4, {1.1, 0.06, 1.5}, {-13.5 + 3.0 * i, 4.6 * side + 0.9 * side, 8.2});
  // 8 vases.
  for (int side = -1; side <= 1; side += 2)
    for (int i = 0; i < 4; ++i) add(14, 8, 0.10, 5, {0.5, 0.5, 0.7}, {-10.0 + 6.0 * i, 2.6 * side, 0.75});
  // 6 blocks.
  for (int i = 0; i < 6; ++i) add(2, 0, 0, 0, {0.6, 0.6, 0.4}, {-9.0 + 4.0 * i, -0.9 + 0.2 * i, 0.4});
  scene.cameras.push_back({"inside", {-14.5, 1.3, 1.9}, {10, -0.8, 3.6}});
  scene.cameras.push_back({"corner", {-17, -7.2, 12.6}, {6, 3, 2}});
  return scene;
}

}  // namespace scree::synth
