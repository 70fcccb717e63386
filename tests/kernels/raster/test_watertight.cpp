// Closed meshes, drawn double-sided. A ray in double precision through the pixel's centre, beyond the near plane,
// decides whether it must be covered and at which distance, except within 1/128 pixel of an outline.
#include <random>

#include "tests/kernels/scene_builder.h"

using namespace scree;
using namespace scree::kernels;
using namespace scree::tests;

namespace {

/// The mesh in camera space: homogeneous corners. x and y are in pixels from the image's centre, times w.
struct Projected {
  struct Corner {
    double x, y, w, distance;
  };
  std::vector<std::array<Corner, 3>> triangles;
  double z_near, z_far;
};

Projected project(const Soup& soup, const std::vector<double>& positions, const std::array<double, 12>& world,
                  const View& view) {
  std::vector<Projected::Corner> corners;
  for (size_t v = 0; v < positions.size() / 3; ++v) {
    double p[3];
    for (size_t i = 0; i < 3; ++i) {
      p[i] = world[4 * i] * positions[3 * v] + world[4 * i + 1] * positions[3 * v + 1] +
             world[4 * i + 2] * positions[3 * v + 2] + (world[4 * i + 3] - view.eye[i]);
    }
    const auto along = [&](const double axis[3]) { return axis[0] * p[0] + axis[1] * p[1] + axis[2] * p[2]; };
    const double distance = along(view.forward);
    corners.push_back({along(view.right) * view.width / 2 / view.half_width,
                       -along(view.up) * view.height / 2 / view.half_height, view.orthographic ? 1.0 : distance,
                       distance});
  }
  Projected shown;
  for (size_t i = 0; i < soup.indices.size(); i += 3)
    shown.triangles.push_back({corners[soup.indices[i]], corners[soup.indices[i + 1]], corners[soup.indices[i + 2]]});
  shown.z_near = view.z_near;
  shown.z_far = view.orthographic ? view.z_far : INFINITY;
  return shown;
}

/// Distance of the nearest intersection of the ray through (x, y) between the near and far planes; infinity if there is
/// none.
double cast(const Projected& shown, double x, double y) {
  double nearest = INFINITY;
  for (const auto& t : shown.triangles) {
    double qx[3];
    double qy[3];
    for (size_t i = 0; i < 3; ++i) {
      qx[i] = t[i].x - x * t[i].w;
      qy[i] = t[i].y - y * t[i].w;
    }
    const double e0 = qx[1] * qy[2] - qx[2] * qy[1];
    const double e1 = qx[2] * qy[0] - qx[0] * qy[2];
    const double e2 = qx[0] * qy[1] - qx[1] * qy[0];
    const double sum = e0 + e1 + e2;
    const double slack = 1e-13 * std::fabs(sum);
    const double sign = sum < 0 ? -1.0 : 1.0;
    if (sum == 0 || sign * e0 < -slack || sign * e1 < -slack || sign * e2 < -slack) continue;
    const double distance = (e0 * t[0].distance + e1 * t[1].distance + e2 * t[2].distance) / sum;
    if (distance >= shown.z_near && distance <= shown.z_far) nearest = std::min(nearest, distance);
  }
  return nearest;
}

/// The range of distances that rays within 1/128 pixel find.
std::array<double, 2> cast_around(const Projected& shown, double x, double y) {
  std::array<double, 2> range = {INFINITY, -INFINITY};
  for (int i = 0; i < 17; ++i) {
    const double angle = i * (2 * 3.14159265358979323846 / 16);
    const double radius = i == 16 ? 0.0 : 1.0 / 128;
    const double distance = cast(shown, x + radius * std::cos(angle), y + radius * std::sin(angle));
    range[0] = std::min(range[0], distance);
    range[1] = std::max(range[1], distance);
  }
  return range;
}

/// The positions that a scene with this encoding stores.
std::vector<double> stored_positions(const Soup& soup, const Encoding& encoding) {
  std::vector<double> out;
  for (float p : soup.positions) {
    out.push_back(encoding.float32
                      ? static_cast<double>(p)
                      : static_cast<double>(format::quantize(p, encoding.exponent)) * format::exp2i(encoding.exponent));
  }
  return out;
}

struct EdgeTally {
  uint64_t covered = 0, empty = 0, outline = 0;
};

void check_picture(const Soup& soup, const Encoding& base, const std::array<double, 12>& world, const View& view,
                   EdgeTally& tally) {
  SceneBuilder builder;
  Encoding encoding = base;
  encoding.material = builder.material(format::kMaterialDoubleSided);
  builder.instance(builder.mesh(soup, encoding), builder.matrix(world));
  const std::vector<uint64_t> samples = draw(builder.view(), view);
  const Projected shown = project(soup, stored_positions(soup, encoding), world, view);
  for (uint32_t y = 0; y < view.height; ++y) {
    for (uint32_t x = 0; x < view.width; ++x) {
      const double px = x + 0.5 - 0.5 * view.width, py = y + 0.5 - 0.5 * view.height;
      const uint64_t sample = samples[size_t{y} * view.width + x];
      const double expected = cast(shown, px, py);
      const bool drawn = sample != kBackground;
      (drawn ? tally.covered : tally.empty) += 1;
      if (drawn != std::isfinite(expected)) {
        const std::array<double, 2> range = cast_around(shown, px, py);
        INFO("pixel " << x << ", " << y << " distance " << expected << " around " << range[0] << " to " << range[1]);
        REQUIRE(std::isfinite(range[0]));
        REQUIRE(!std::isfinite(range[1]));
        ++tally.outline;
      } else if (drawn) {
        const double distance = depth_of_code(view, sample_depth_code(sample));
        const double slack = view.orthographic ? 1e-6 * (view.z_far - view.z_near) : 2e-6 * expected;
        if (std::fabs(distance - expected) <= slack) continue;
        const std::array<double, 2> range = cast_around(shown, px, py);
        if (!std::isfinite(range[1])) continue;  // at an outline half of the rays hit nothing
        INFO("pixel " << x << ", " << y << " distance " << distance << " not " << expected << ", around " << range[0]
                      << " to " << range[1]);
        REQUIRE(distance >= range[0] - slack);
        REQUIRE(distance <= range[1] + slack);
      }
    }
  }
}

constexpr std::array<double, 12> kIdentity = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};

}  // namespace

TEST_CASE("watertight: outside, inside and across the near plane", "[raster][watertight]") {
  std::mt19937 random(11);
  std::uniform_real_distribution<double> unit(-1, 1);
  EdgeTally tally;
  for (int round = 0; round < 40; ++round) {
    const Soup soup = sphere(6 + static_cast<uint32_t>(round) % 5, round % 2 ? 0.2 : 0.0);
    const Encoding encoding{
        .float32 = round % 4 == 3, .exponent = -10 - round % 4, .chunk_triangles = round % 3 ? 50u : 65536u};
    // The distance from the centre places the camera inside, or the near plane through the surface, or the whole
    // surface in view.
    const double distance = std::array<double, 4>{0.3, 1.05, 1.3, 3.0}[static_cast<size_t>(round % 4)];
    std::array<double, 3> eye = {unit(random), unit(random), unit(random)};
    const double length = std::sqrt(eye[0] * eye[0] + eye[1] * eye[1] + eye[2] * eye[2]) + 1e-3;
    for (double& c : eye) c *= distance / length;
    const double z_near = std::array<double, 3>{0.01, 0.3, 1.0}[static_cast<size_t>(round % 3)];
    View view = look_at(eye, {0.4 * unit(random), 0.4 * unit(random), 0.4 * unit(random)}, 48, 37, z_near,
                        0.6 + 0.15 * (round % 8));
    if (round % 8 == 5) {
      view.orthographic = true;
      view.half_height = 1.2;
      view.half_width = 1.2 * 48 / 37;
      view.z_near = -0.2;
      view.z_far = 1.9;
    }
    std::array<double, 12> world = kIdentity;
    if (round % 5 == 4) world = {-1.3, 0.2, 0, 0.1, 0.1, 0.8, 0.3, 0, 0, -0.4, 1.1, 0.2};
    check_picture(soup, encoding, world, view, tally);
  }
  CHECK(tally.covered > 10000);
  CHECK(tally.empty > 1000);
  CHECK(tally.outline < 200);
}

TEST_CASE("watertight: an eye on a vertex, on an edge and on a face", "[raster][watertight]") {
  EdgeTally tally;
  const Soup soup = sphere(8, 0.1);
  const Encoding encoding{.exponent = -12};
  const std::vector<double> stored = stored_positions(soup, encoding);
  const auto corner = [&](size_t triangle, size_t k) {
    const size_t v = soup.indices[3 * triangle + k];
    return std::array<double, 3>{stored[3 * v], stored[3 * v + 1], stored[3 * v + 2]};
  };
  for (size_t triangle : {size_t{0}, size_t{50}, size_t{101}}) {
    const auto a = corner(triangle, 0);
    const auto b = corner(triangle, 1);
    const auto c = corner(triangle, 2);
    std::array<double, 3> edge, face;
    for (size_t i = 0; i < 3; ++i) {
      edge[i] = 0.5 * (a[i] + b[i]);
      face[i] = 0.25 * a[i] + 0.25 * b[i] + 0.5 * c[i];
    }
    for (const auto& eye : {a, edge, face}) {
      check_picture(soup, encoding, kIdentity, look_at(eye, {0.1, 0.05, -0.1}, 40, 30, 0.001, 1.4), tally);
      check_picture(soup, encoding, kIdentity,
                    look_at(eye, {3 * eye[0], 3 * eye[1], 3 * eye[2] + 1}, 40, 30, 0.001, 1.4), tally);
    }
  }
  CHECK(tally.covered > 5000);
}

TEST_CASE("watertight: huge triangles, far beyond the guard band and behind the eye", "[raster][watertight]") {
  EdgeTally tally;
  Soup soup;  // a box with sides of 2e4; its 12 triangles are seen from inside, near a corner and near the middle
  for (int i = 0; i < 8; ++i) soup.add(i & 1 ? 1e4 : -1e4, i & 2 ? 1e4 : -1e4, i & 4 ? 1e4 : -1e4);
  const uint32_t faces[6][4] = {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}};
  for (const auto& f : faces) {
    soup.triangle(f[0], f[1], f[2]);
    soup.triangle(f[0], f[2], f[3]);
  }
  std::mt19937 random(5);
  std::uniform_real_distribution<double> unit(-1, 1);
  for (int round = 0; round < 24; ++round) {
    const Encoding encoding{.float32 = round % 2 == 1, .exponent = 2};
    const double reach = round % 3 == 0 ? 9999.5 : 3000.0;
    const std::array<double, 3> eye = {reach, reach * unit(random), reach * unit(random)};
    const View view =
        look_at(eye, {eye[0] + unit(random), eye[1] + unit(random), eye[2] + 1.1 * unit(random)}, 61, 47, 0.05, 1.3);
    check_picture(soup, encoding, kIdentity, view, tally);
  }
  CHECK(tally.empty < 30);  // the outside is visible only at an outline of the clipped surface
}

TEST_CASE("watertight: triangles along the planes of the view, from far ahead to far behind", "[raster][watertight]") {
  // The picture near the eye depends on corners that are a hundred thousand units away and a few ulps inside.
  std::mt19937 random(17);
  std::uniform_real_distribution<double> unit(-1, 1);
  EdgeTally tally;
  for (int round = 0; round < 200; ++round) {
    const View view = look_at({0, 0, 0}, {unit(random), unit(random), unit(random)}, 24, 18, 0.01, 1.0);
    Soup soup;
    for (int corner = 0; corner < 3; ++corner) {
      // Two corners slightly inside of the left or top plane, one in front, one behind; the third outside of it.
      const double depth = (corner == 1 ? -1 : 1) * 1e5 * (0.5 + std::fabs(unit(random)));
      const double inside = corner == 2 ? -1e4 : 0.03 * std::fabs(unit(random));
      const double along = corner == 2 ? 1e5 * unit(random) : 0.01 * unit(random);
      double x = -view.half_width * depth + inside;
      double y = along;
      if (round % 2 == 1) {
        x = along;
        y = view.half_height * depth - inside;
      }
      double p[3];
      for (int i = 0; i < 3; ++i) p[i] = view.right[i] * x + view.up[i] * y + view.forward[i] * depth;
      soup.add(p[0], p[1], p[2]);
    }
    soup.triangle(0, 1, 2);
    const Encoding encoding{.float32 = true};
    INFO("round " << round);
    check_picture(soup, encoding, kIdentity, view, tally);
  }
  CHECK(tally.covered > 1000);
}
