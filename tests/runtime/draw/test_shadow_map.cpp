// The sun's view, compared with the camera's in double precision, and shadows of boxes, compared with rays.
#include "runtime/draw/shadow_map.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <random>
#include <utility>
#include <vector>

#include "tests/kernels/shade_samples.h"
#include "tests/kernels/square.h"

using namespace scree;
using namespace scree::runtime;
using namespace scree::tests;
using namespace kernels;

namespace {

constexpr uint32_t kSide = 256;

Vec3 unit(Vec3 v) {
  const double length = std::hypot(v[0], v[1], v[2]);
  for (double& c : v) c /= length;
  return v;
}

Vec3 ahead(const Vec3& from, const Vec3& direction, double distance) {
  return {from[0] + distance * direction[0], from[1] + distance * direction[1], from[2] + distance * direction[2]};
}

/// A point in a view's axes: right, up and forward.
Vec3 in_view(const View& view, const Vec3& point) {
  Vec3 out{};
  for (size_t i = 0; i < 3; ++i) {
    const double offset = point[i] - view.eye[i];
    out[0] += offset * view.right[i];
    out[1] += offset * view.up[i];
    out[2] += offset * view.forward[i];
  }
  return out;
}

bool sees(const View& view, const Vec3& point) {
  const Vec3 at = in_view(view, point);
  const double scale = view.orthographic ? 1 : at[2];
  return at[2] >= view.z_near && (!view.orthographic || at[2] <= view.z_far) &&
         std::abs(at[0]) <= scale * view.half_width && std::abs(at[1]) <= scale * view.half_height;
}

Soup box(const Vec3& low, const Vec3& high) {
  Soup soup;
  for (int k = 0; k < 8; ++k) soup.add(k & 1 ? high[0] : low[0], k & 2 ? high[1] : low[1], k & 4 ? high[2] : low[2]);
  for (const auto& [a, b, c, d] : std::initializer_list<std::array<uint32_t, 4>>{
           {0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}}) {
    soup.triangle(a, b, c);
    soup.triangle(a, c, d);
  }
  return soup;
}

/// Whether a ray hits a box that is enlarged by `more` on all sides.
bool hits(const Vec3& from, const Vec3& direction, const WorldBox& box, double more) {
  double first = 0, last = 1e30;
  for (size_t i = 0; i < 3; ++i) {
    const double low = box.min[i] - more - from[i], high = box.max[i] + more - from[i];
    if (std::abs(direction[i]) < 1e-12) {
      if (low > 0 || high < 0) return false;
      continue;
    }
    first = std::max(first, std::min(low / direction[i], high / direction[i]));
    last = std::min(last, std::max(low / direction[i], high / direction[i]));
  }
  return first <= last;
}

/// The surface in a pixel, and its share of the sun's light.
struct LitPoint {
  Vec3 place;
  float share;
};

/// A scene in memory under a sun.
struct Sunny {
  explicit Sunny(const Vec3& direction) {
    kernels::PlacedLight light{};
    for (size_t i = 0; i < 3; ++i) light.direction[i] = static_cast<float>(direction[i]);
    light.kind = format::LightKind::kDirectional;
    std::fill_n(light.color, 3, 2.0f);
    kernels::PlacedLight lamp{};  // a dark lamp, so that the sun is not the first light
    lamp.kind = format::LightKind::kPoint;
    lights = {lamp, light};
    matt.material = builder.material(format::kMaterialDoubleSided);
  }

  void add(const Soup& soup) { builder.instance(builder.mesh(soup, matt), builder.identity()); }
  void add_masked(const Soup& soup, const kernels::MaskView& mask, std::vector<uint8_t> alpha) {
    builder.instance(
        builder.mesh(soup, {.material = builder.masked_material(format::kMaterialDoubleSided, mask, std::move(alpha))}),
        builder.identity());
  }

  /// The pixels that the sun lights where nothing casts a shadow.
  std::vector<LitPoint> look(const View& view) {
    kernels::SceneView scene = builder.view();
    scene.lights = lights.data();
    scene.light_count = 2;
    REQUIRE(runtime::find_sun(scene) == 1u);
    SunShadow sun = must(sun_of(scene, runtime::scene_box(scene), view, kSide));
    std::vector<uint64_t> reached[kernels::kMostSunMaps];
    for (uint32_t i = 0; i < sun.map_count; ++i) {
      reached[i] = scree::tests::draw(scene, sun.maps[i].view);
      sun.maps[i].samples = reached[i].data();
    }
    texels.clear();
    for (uint32_t i = 0; i < sun.map_count; ++i)
      texels.push_back(2 * sun.maps[i].view.half_width / sun.maps[i].view.width);
    texel = texels.back();
    const std::vector<uint64_t> samples = scree::tests::draw(scene, view);
    ShadeOptions options{.lighting = kernels::Lighting::kScene};
    std::vector<float> all(4 * samples.size()), shadowed(all.size());
    scree::tests::shade_samples(scene, view, samples, options, all);
    options.sun = &sun;
    scree::tests::shade_samples(scene, view, samples, options, shadowed);
    std::vector<LitPoint> out;
    for (size_t i = 0; i < samples.size(); ++i) {
      if (samples[i] == kernels::kBackground || all[4 * i] <= 0) continue;
      const double depth = kernels::depth_of_code(view, kernels::sample_depth_code(samples[i]));
      const double scale = view.orthographic ? 1 : depth;
      const double x = (2 * (static_cast<double>(i % view.width) + 0.5) / view.width - 1) * view.half_width * scale;
      const double y = (1 - 2 * (static_cast<double>(i / view.width) + 0.5) / view.height) * view.half_height * scale;
      LitPoint point{};
      for (size_t k = 0; k < 3; ++k)
        point.place[k] = view.eye[k] + x * view.right[k] + y * view.up[k] + depth * view.forward[k];
      point.share = shadowed[4 * i] / all[4 * i];
      out.push_back(point);
    }
    return out;
  }

  SceneBuilder builder;
  Encoding matt;
  std::vector<kernels::PlacedLight> lights;
  std::vector<double> texels;  // of the maps of look(), in world units
  double texel = 0;            // the last one's
};

}  // namespace

TEST_CASE("the sun's view contains all visible points and everything that may shade them", "[shadow]") {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> any(-1, 1);
  const auto direction = [&](int i) -> Vec3 {
    Vec3 axis{};
    axis[static_cast<size_t>(i) % 3] = i % 2 == 0 ? 1 : -1;
    return i % 20 < 6 ? axis : unit({any(random), any(random), any(random)});
  };
  int seen = 0, unseen = 0, inside = 0;
  for (int i = 0; i < 2000; ++i) {
    CAPTURE(i);
    WorldBox box;
    const double far = i % 5 == 0 ? 1e6 : 0;
    for (int k = 0; k < 2; ++k) box.add({far + 4 * any(random), 3 * any(random), (i % 7 == 0 ? 0.0 : 5 * any(random))});
    const Vec3 eye{far + 8 * any(random), 6 * any(random), 8 * any(random)};
    View camera = look_at(eye, {far + any(random), any(random), any(random)}, 160, 90, 0.01 + std::abs(any(random)),
                          0.1 + std::abs(any(random)));
    if (i % 3 == 0)
      camera = orthographic(camera, 0.1 + 2 * std::abs(any(random)), any(random), 2 + 9 * std::abs(any(random)));
    const auto side = static_cast<uint32_t>(64 + 1000 * std::abs(any(random)));
    const Vec3 sun = direction(i);
    const std::optional<View> map = sun_view(sun, box, camera, side);
    std::vector<Vec3> points;
    for (int p = 0; p < 200; ++p) {
      Vec3 point;
      for (size_t k = 0; k < 3; ++k) {
        const double share = p < 8 ? p >> k & 1 : 0.5 + 0.5 * any(random);
        point[k] = box.min[k] + share * (box.max[k] - box.min[k]);
      }
      points.push_back(point);
    }
    bool sees_any = false;
    for (const Vec3& point : points) {
      if (map) REQUIRE(in_view(*map, point)[2] >= map->z_near);
      if (!sees(camera, point)) continue;
      sees_any = true;
      REQUIRE(map);
      const Vec3 at = in_view(*map, point);
      REQUIRE(std::abs(at[0]) <= map->half_width * (1 - 3.0 / map->width));
      REQUIRE(std::abs(at[1]) <= map->half_height * (1 - 3.0 / map->height));
      REQUIRE(at[2] <= map->z_far);
    }
    if (sees(camera, eye)) ++inside;
    sees_any ? ++seen : ++unseen;
    if (!map) continue;
    REQUIRE(kernels::check_frame(*map, 0));
    REQUIRE(std::max(map->width, map->height) <= side);
    double reach = 0;
    for (const Vec3& point : points)
      reach = std::max(reach, std::hypot(point[0] - eye[0], point[1] - eye[1], point[2] - eye[2]));
    const bool is_fine = 2 * map->half_width / map->width <= reach * 0x1p-18;
    REQUIRE((is_fine || std::max(map->width, map->height) + 1 >= side));
    REQUIRE(map->half_width / map->width == Approx(map->half_height / map->height));
    const double* const axes[3] = {map->right, map->up, map->forward};
    for (int a = 0; a < 3; ++a)
      for (int b = 0; b < 3; ++b)
        REQUIRE(std::abs(axes[a][0] * axes[b][0] + axes[a][1] * axes[b][1] + axes[a][2] * axes[b][2] - (a == b)) <
                1e-12);
    REQUIRE(map->right[0] * map->up[1] - map->right[1] * map->up[0] == Approx(-map->forward[2]).margin(1e-12));
    for (size_t k = 0; k < 3; ++k) REQUIRE(map->forward[k] == Approx(sun[k]).margin(1e-12));
  }
  CHECK(seen > 500);
  CHECK(unseen > 100);
}

TEST_CASE("the sun's view is no larger than the visible part of the scene", "[shadow]") {
  WorldBox box;
  box.add({-100, 0, -100});
  box.add({100, 10, 100});
  // The camera looks straight down from 2 above the ground: it sees 2 tan(0.25) to each side, and the box above that.
  const View camera = look_at({3, 2, 4}, {3, 0, 4}, 100, 100, 0.1, 0.5);
  const View map = must(sun_view({0, -1, 0}, box, camera, 1024));
  CHECK(map.half_width == Approx(2 * std::tan(0.25)).epsilon(0.01));
  CHECK(map.half_height == Approx(2 * std::tan(0.25)).epsilon(0.01));
  CHECK(map.z_far == Approx(10).epsilon(0.01));
  CHECK(!sun_view({0, -1, 0}, WorldBox{}, camera, 1024));
  CHECK(!sun_view({0, -1, 0}, box, look_at({0, 20, 0}, {0, 30, 0}, 100, 100), 1024));

  // The scene ends at a clipping box, in the map too.
  View clipped = camera;
  clipped.clips = true;
  for (int i = 0; i < 3; ++i) clipped.clip_min[i] = -(clipped.clip_max[i] = 1 + i);
  CHECK(!sun_view({0, -1, 0}, box, clipped, 1024));
  clipped.clip_max[0] = 3;
  clipped.clip_max[2] = 4;
  const View cut = must(sun_view({0, -1, 0}, box, clipped, 1024));
  CHECK(cut.clips);
  CHECK(cut.clip_max[1] == 2);
  CHECK(cut.z_far == Approx(2).epsilon(0.01));

  // A single point, which gives a sample no size.
  WorldBox point;
  point.add({3, 1, 4});
  CHECK(kernels::check_frame(must(sun_view({0, -1, 0}, point, camera, 64)), 0));
}

TEST_CASE("a deep view has finer maps for what is near", "[shadow]") {
  std::mt19937 random(11);
  std::uniform_real_distribution<double> any(-1, 1);
  Sunny scene(unit({0.4, -1, 0.2}));
  size_t points_by_map[kernels::kMostSunMaps] = {};
  for (int i = 0; i < 400; ++i) {
    CAPTURE(i);
    WorldBox box;
    for (int k = 0; k < 2; ++k) box.add({400 * any(random), 30 * any(random), 400 * any(random)});
    const Vec3 eye{500 * any(random), 40 * any(random), 500 * any(random)};
    View camera = look_at(eye, {100 * any(random), 0, 100 * any(random)}, 160, 90, 0.5, 0.9);
    if (i % 8 == 0) camera = orthographic(camera, 50, -400, 800);
    kernels::SceneView lit{};
    lit.lights = scene.lights.data();
    lit.light_count = 2;
    const std::optional<SunShadow> sun = sun_of(lit, box, camera, kSide);
    double nearest = 1e30, farthest = 0;
    std::vector<Vec3> seen;
    for (int p = 0; p < 2000; ++p) {
      Vec3 point;
      const double around = 200 * std::pow(0.001, std::abs(any(random)));
      bool is_inside = true;
      for (size_t k = 0; k < 3; ++k) {
        point[k] = p % 2 == 0 ? box.min[k] + (0.5 + 0.5 * any(random)) * (box.max[k] - box.min[k])
                              : eye[k] + around * any(random);
        is_inside = is_inside && point[k] >= box.min[k] && point[k] <= box.max[k];
      }
      if (!is_inside || !sees(camera, point)) continue;
      seen.push_back(point);
      nearest = std::min(nearest, in_view(camera, point)[2]);
      farthest = std::max(farthest, in_view(camera, point)[2]);
    }
    if (seen.empty()) continue;
    REQUIRE(sun);
    REQUIRE(sun->light == 1);
    REQUIRE(sun->map_count <= kernels::kMostSunMaps);
    if (camera.orthographic) REQUIRE(sun->map_count == 1);
    if (!camera.orthographic && farthest > kDeepView * nearest) REQUIRE(sun->map_count > 1);
    for (uint32_t m = 0; m < sun->map_count; ++m) {
      const View& map = sun->maps[m].view;
      REQUIRE(std::max(map.width, map.height) <= (sun->map_count == 1 ? kSide : kSide / 2));
      if (m != 0) REQUIRE(map.half_width / map.width >= sun->maps[m - 1].view.half_width / sun->maps[m - 1].view.width);
      const double reach = farthest / std::pow(kMostSunRatio, sun->map_count - 1 - m);
      for (const Vec3& point : seen) {
        if (in_view(camera, point)[2] > reach) continue;
        const Vec3 at = in_view(map, point);
        REQUIRE(std::abs(at[0]) <= map.half_width * (1 - 3.0 / map.width));
        REQUIRE(std::abs(at[1]) <= map.half_height * (1 - 3.0 / map.height));
        REQUIRE(at[2] >= 0);
        REQUIRE(at[2] <= map.z_far);
        ++points_by_map[m];
      }
    }
  }
  for (const size_t points : points_by_map) CHECK(points > 100);
}

TEST_CASE("near shadows are sharp however far the camera looks", "[shadow]") {
  const Vec3 sun = unit({1, -0.5, 0.1});
  Sunny scene(sun);
  scene.add(box({-2, -1, -900}, {100, 0, 2}));
  WorldBox post;
  post.add({-0.2, 0, -3.2});
  post.add({0.2, 1.5, -2.8});
  scene.add(box(post.min, post.max));
  const View camera = look_at({0.5, 1.6, 0}, {0.5, 0.8, -4}, 200, 200, 0.1, 0.9);
  size_t dark = 0, lit = 0;
  for (const LitPoint& point : scene.look(camera)) {
    // The second map is for at least these points.
    if (std::abs(point.place[1]) > 1e-3 || point.place[2] < -6) continue;
    const Vec3 back{-sun[0], -sun[1], -sun[2]};
    if (hits(point.place, back, post, -0.5 * scene.texels[1])) {
      CHECK(point.share < 0.75f);
      ++dark;
    } else if (!hits(point.place, back, post, 2 * scene.texels[1])) {
      CHECK(point.share == 1.0f);
      ++lit;
    }
  }
  CHECK(scene.texel > 1);  // one map would show nothing of the post
  CHECK(scene.texels[1] < 0.2);
  CHECK(dark > 20);
  CHECK(lit > 1000);
}

TEST_CASE("a box casts the shadow that ray casting finds, within two samples of its border", "[shadow]") {
  const std::vector<Vec3> directions{{1, 0, 0},  {-1, 0, 0},     {0, 1, 0},         {0, -1, 0}, {0, 0, 1},
                                     {0, 0, -1}, {0.3, -1, 0.2}, {-0.5, 0.4, -0.7}, {1, 1, -1}, {0.02, 0.01, 1}};
  for (const Vec3& wanted : directions) {
    const Vec3 sun = unit(wanted);
    CAPTURE(sun[0], sun[1], sun[2]);
    Sunny scene(sun);
    WorldBox caster;
    caster.add({-0.5, -0.4, -0.3});
    caster.add({0.3, 0.4, 0.5});
    scene.add(box(caster.min, caster.max));
    // A room around the box. It has no wall on the sun's side, so that each other wall is lit.
    const double half = 3;
    for (size_t axis = 0; axis < 3; ++axis) {
      for (const double side : {-1.0, 1.0}) {
        if (side * sun[axis] <= 0) continue;
        Vec3 low{-half, -half, -half}, high{half, half, half};
        low[axis] = side * half;
        high[axis] = side * (half + 0.25);
        if (low[axis] > high[axis]) std::swap(low[axis], high[axis]);
        scene.add(box(low, high));
      }
    }
    const Vec3 aside = unit({sun[1] + 0.2, sun[2] - 0.1, sun[0] + 0.3});
    const Vec3 eye = ahead(ahead({0, 0, 0}, sun, -1.5), aside, 2);
    std::vector<View> cameras{look_at(eye, ahead({0, 0, 0}, sun, 2), 200, 200, 0.05, 1.6)};
    cameras.push_back(orthographic(cameras[0], 2.5, 0.05, 12));
    for (const View& camera : cameras) {
      const std::vector<LitPoint> points = scene.look(camera);
      const double border = 2 * scene.texel;
      size_t dark = 0, lit = 0;
      for (const LitPoint& point : points) {
        const Vec3 start = ahead(point.place, sun, -0.05);
        const Vec3 back{-sun[0], -sun[1], -sun[2]};
        const bool is_on_caster = hits(point.place, sun, caster, 1e-3) && !hits(start, back, caster, 0);
        if (is_on_caster || hits(point.place, back, caster, -border)) {
          REQUIRE(point.share == Approx(is_on_caster ? 1 : 0).margin(1e-6));
          ++(is_on_caster ? lit : dark);
        } else if (!hits(point.place, back, caster, border)) {
          // Near a corner, one wall may cast a shadow on the other.
          const bool is_corner = std::count_if(point.place.begin(), point.place.end(),
                                               [&](double c) { return std::abs(std::abs(c) - half) < 0.3; }) > 1;
          if (!is_corner) REQUIRE(point.share == 1.0f);
          ++lit;
        } else {
          REQUIRE(point.share >= -1e-6f);
          REQUIRE(point.share <= 1.0f);
        }
      }
      CHECK(dark > 50);
      CHECK(lit > 1000);
    }
  }
}

TEST_CASE("triangles outside the camera's view cast shadows into its picture", "[shadow]") {
  Sunny scene(unit({0.1, -1, 0.05}));
  scene.add(box({-50, -1, -50}, {50, 0, 50}));
  scene.add(box({-2, 8, -2}, {2, 9, 2}));  // above and behind a camera that looks down
  const View camera = look_at({0, 3, 0}, {0, 0, 0}, 60, 60);
  const std::vector<LitPoint> points = scene.look(camera);
  CHECK(points.size() == 3600);
  CHECK(scene.texel < 0.04);
  for (const LitPoint& point : points)
    if (std::abs(point.place[0] - 0.8) < 1.9 && std::abs(point.place[2] - 0.4) < 1.9)
      CHECK(point.share == Approx(0).margin(1e-6));
}

TEST_CASE("no lit surface shades itself", "[shadow]") {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> any(-1, 1);
  size_t points = 0;
  for (int i = 0; i < 60; ++i) {
    CAPTURE(i);
    const Vec3 sun = unit({any(random), any(random), any(random)});
    Sunny scene(sun);
    const bool is_ball = i % 3 == 0;
    if (is_ball) {
      scene.add(sphere(24, 0));
    } else {
      // A plane at any angle to the light and to the map's rows.
      const Vec3 u = unit({any(random), any(random), any(random)}), v = unit({any(random), any(random), any(random)});
      Soup soup;
      for (const auto& [a, b] : {std::pair(-1, -1), std::pair(1, -1), std::pair(1, 1), std::pair(-1, 1)})
        soup.add(a * u[0] + b * v[0], a * u[1] + b * v[1], a * u[2] + b * v[2]);
      soup.triangle(0, 1, 2);
      soup.triangle(0, 2, 3);
      scene.add(soup);
    }
    const Vec3 aside = unit({any(random), any(random), any(random)});
    // From near, and from so far away that floats are spaced wider than samples.
    const double far = i % 5 == 0 ? 1e5 : 1;
    const View camera =
        look_at(ahead(ahead({0, 0, 0}, sun, -3 * far), aside, 2 * far), {0, 0, 0}, 150, 150, 0.1 * far, 1 / far);
    for (const LitPoint& point : scene.look(i % 2 == 0 ? camera : orthographic(camera, 1.5, 0.1 * far, 6 * far))) {
      REQUIRE(point.share == 1.0f);
      ++points;
    }
  }
  CHECK(points > 100000);
}

TEST_CASE("an alpha mask cuts the shadow of its surface", "[shadow]") {
  Sunny scene({0, 0, -1});
  scene.add(box({-2, -2, -2}, {2, 2, -1.5}));
  kernels::MaskView mask{};
  mask.width = 2;
  mask.height = mask.level_count = 1;
  mask.threshold = 128 << 16;
  mask.place[0][0] = mask.place[1][1] = 1;
  mask.wrap_s = mask.wrap_t = format::Wrap::kClamp;
  mask.magnified_nearest = true;
  mask.needs = format::kHasUv;
  scene.add_masked(square(0, 0, 1, 1), mask, {0, 255});  // its left half is masked
  size_t dark = 0, lit = 0;
  for (const LitPoint& point : scene.look(look_at({4, 0, 1}, {0, 0, -1.5}, 120, 120))) {
    const double x = point.place[0], y = point.place[1], border = 2 * scene.texel;
    if (point.place[2] > -1) continue;  // the square itself
    if (x > border && x < 1 - border && std::abs(y) < 1 - border) {
      REQUIRE(point.share == Approx(0).margin(1e-6));
      ++dark;
    } else if (x < -border || x > 1 + border || std::abs(y) > 1 + border) {
      REQUIRE(point.share == 1.0f);
      ++lit;
    }
  }
  CHECK(dark > 100);
  CHECK(lit > 500);
}
