// The clipping box: pictures compared with a simple ray caster in double precision; the specification's worked example;
// culling by the box removes nothing visible.
#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <vector>

#include "tests/kernels/draw_counted.h"
#include "tests/kernels/raster/blend_cases.h"
#include "tests/kernels/raster/clip_cases.h"
#include "tests/sanitized.h"

using namespace scree;
using namespace scree::tests;
using kernels::View;

namespace {

using Point = std::array<double, 3>;

double dot(const Point& a, const double b[3]) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/// A scene that keeps its triangles in world space, in addition to the builder's records.
struct CastScene {
  SceneBuilder builder;
  std::vector<std::array<Point, 3>> triangles;  // by global id

  /// Places `soup`, whose positions are multiples of 2^-12.
  void add(const Soup& soup, const Encoding& encoding, const std::array<double, 12>& rows) {
    REQUIRE(encoding.clusters == Clusters::kNone);  // clusters would change the order of triangles
    builder.instance(builder.mesh(soup, encoding), builder.matrix(rows));
    for (size_t i = 0; i < soup.indices.size(); i += 3) {
      std::array<Point, 3> corners;
      for (size_t n = 0; n < 3; ++n) {
        const float* const p = soup.positions.data() + 3 * size_t{soup.indices[i + n]};
        for (size_t r = 0; r < 3; ++r)
          corners[n][r] = rows[4 * r] * p[0] + rows[4 * r + 1] * p[1] + rows[4 * r + 2] * p[2] + rows[4 * r + 3];
      }
      triangles.push_back(corners);
    }
  }
};

Soup on_lattice(Soup soup) {
  for (float& c : soup.positions) c = std::round(c * 4096) / 4096;
  return soup;
}

enum class Cast { kSure, kUnsure };

/// The triangle at a sample, or kBackground. Also finds the samples that rounding decides: near an edge, a plane of the
/// box, or another triangle.
Cast cast(const CastScene& scene, const View& view, uint32_t x, uint32_t y, uint64_t& id) {
  const double across = (2 * (x + 0.5) / view.width - 1) * view.half_width;
  const double down = (2 * (y + 0.5) / view.height - 1) * view.half_height;
  Point origin, ray;
  for (size_t k = 0; k < 3; ++k) {
    const double off = view.right[k] * across - view.up[k] * down;
    origin[k] = view.eye[k] + (view.orthographic ? off : 0);
    ray[k] = view.forward[k] + (view.orthographic ? 0 : off);
  }
  constexpr double kNear = 1e-3;  // limit of "near": a share of a triangle or of the distance
  double nearest = INFINITY, second = INFINITY;
  id = kernels::kBackground;
  for (size_t t = 0; t < scene.triangles.size(); ++t) {
    const auto& [a, b, c] = scene.triangles[t];
    Point ab, ac, from;
    for (size_t k = 0; k < 3; ++k) ab[k] = b[k] - a[k], ac[k] = c[k] - a[k], from[k] = origin[k] - a[k];
    const auto cross = [](const Point& u, const Point& v) {
      return Point{u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]};
    };
    const Point p = cross(ray, ac);
    const double determinant = dot(ab, p.data());
    if (!(determinant > 0)) continue;  // seen from behind
    const double u = dot(from, p.data()) / determinant;
    const Point q = cross(from, ab);
    const double v = dot(ray, q.data()) / determinant, distance = dot(ac, q.data()) / determinant;
    const double inside = std::min({u, v, 1 - u - v});
    const double first = view.z_near, last = view.orthographic ? view.z_far : INFINITY;
    if (inside < -10 * kNear || distance < first * (1 - kNear) || distance > last * (1 + kNear)) continue;
    double in_box = INFINITY;
    for (size_t k = 0; k < 3; ++k) {
      const double at = origin[k] + distance * ray[k];
      in_box = std::min({in_box, at - view.clip_min[k], view.clip_max[k] - at});
    }
    if (in_box < -kNear * distance) continue;
    // An undecided triangle matters only if it would be visible.
    const bool perhaps = inside < 10 * kNear || in_box < kNear * distance || distance < first * (1 + kNear) ||
                         distance > last * (1 - kNear);
    if (perhaps) {
      second = std::min(second, distance);
    } else if (distance < nearest) {
      second = std::min(second, nearest);
      nearest = distance;
      id = t;
    } else {
      second = std::min(second, distance);
    }
  }
  const bool is_sure = nearest == INFINITY ? second == INFINITY : second > nearest * (1 + kNear);
  return is_sure ? Cast::kSure : Cast::kUnsure;
}

}  // namespace

TEST_CASE("pictures with a clipping box equal a ray caster's", "[raster][clip]") {
  CastScene scene;
  const Encoding lattice{.chunk_triangles = 100};
  scene.add(on_lattice(sphere(9, 0)), lattice, {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0});
  scene.add(on_lattice(sphere(5, 0.2)), float32(), {0.5, 0, 0.1, 0.2, 0, 0.6, 0, 0.1, -0.1, 0, 0.5, -0.1});
  scene.add(on_lattice(grid(4, 0.2)), lattice, {2, 0, 0, 0, 0, 1, 0, -0.4, 0, 0, 2, 0});
  scene.add(on_lattice(grid(1, 0)), lattice, {3, 0, 0, 0, 0, 1, 0, -0.9, 0, 0, 3, 0});
  const kernels::SceneView drawn = scene.builder.view();
  const View far = look_at({2.5, 2, 3}, {0, 0, 0}, 90, 61);
  const View near = look_at({0.4, 0.25, 1.5}, {0, 0.1, 0}, 53, 75, 0.3);
  std::mt19937 random(7);
  uint32_t sure = 0, all = 0, shown = 0, changed = 0;
  for (int round = 0; round < 24; ++round) {
    const View whole = round % 4 == 0   ? far
                       : round % 4 == 1 ? near
                       : round % 4 == 2 ? orthographic(far, 1.6, 0.1, 20)
                                        : orthographic(near, 0.9, 0.01, 9);
    const View view = clipping(whole, random_box(random, 1.3));
    const std::vector<uint64_t> samples = draw(drawn, view, 2), uncut = draw(drawn, whole, 2);
    for (size_t i = 0; i < samples.size(); ++i) {
      ++all;
      uint64_t id;
      const auto x = static_cast<uint32_t>(i % view.width), y = static_cast<uint32_t>(i / view.width);
      if (cast(scene, view, x, y, id) == Cast::kUnsure) continue;
      ++sure;
      shown += id != kernels::kBackground ? 1 : 0;
      changed += samples[i] != uncut[i] ? 1 : 0;
      const uint64_t found = samples[i] == kernels::kBackground ? samples[i] : kernels::sample_id(samples[i]);
      if (found == id) continue;
      INFO("round " << round << ", sample " << x << ", " << y);
      CHECK(found == id);
    }
  }
  CHECK(sure > all / 10 * 8);
  CHECK(shown > all / 20);
  CHECK(changed > all / 5);
}

TEST_CASE("a clipping box cuts by the rule of the specification", "[raster][clip]") {
  // The example of spec/rasterization.md 14.
  View view = look_at({1, 2, 5}, {1, 2, 0}, 4, 2, 0.5);
  view.half_width = 2;
  view.half_height = 1;
  view = clipping(view, {{0, 0, 0}, {3, 2.75, 1}});
  const kernels::ClipBox box = kernels::make_clip_box(view);
  CHECK(box.axis[0].x == 0.25);
  CHECK(box.axis[0].y == 0);
  CHECK(box.axis[0].low_m == 1);
  CHECK(box.axis[0].low_one == 0);
  CHECK(box.axis[0].high_m == -2);
  CHECK(box.axis[0].high_one == 0);
  CHECK(box.axis[1].x == 0);
  CHECK(box.axis[1].y == -0.25);
  CHECK(box.axis[1].low_m == 2);
  CHECK(box.axis[1].high_m == -0.75);
  CHECK(box.axis[2].low_m == 5);
  CHECK(box.axis[2].low_one == -0.5);
  CHECK(box.axis[2].high_m == 4);
  // At distance 4.1, m = 0.122. On the ray of sample (2, 0) the point is (3.05, 4.05, 0.9), and on the ray of (2, 1) it
  // is (3.05, -0.05, 0.9).
  const auto inside = [&](int32_t x, int32_t y, double distance) {
    const uint32_t code = kernels::perspective_depth_code(static_cast<float>(0.5 / distance));
    return kernels::is_in_clip_box(box, 4, 2, false, x, y, code);
  };
  CHECK_FALSE(inside(2, 0, 4.1));
  View wide = view;
  wide.clip_max[0] = 3.06;
  wide.clip_max[1] = 4.06;
  const kernels::ClipBox larger = kernels::make_clip_box(wide);
  const uint32_t code = kernels::perspective_depth_code(static_cast<float>(0.5 / 4.1));
  CHECK(kernels::is_in_clip_box(larger, 4, 2, false, 2, 0, code));
  CHECK_FALSE(kernels::is_in_clip_box(larger, 4, 2, false, 2, 1, code));
  // Every face is closed: a depth exactly on it stays.
  View axis = orthographic(look_at({0, 0, 4}, {0, 0, 0}, 2, 2), 1, 0, 8);
  const uint32_t middle = kernels::orthographic_depth_code(0.5f);
  const double at = 4 - 8 * (1 - kernels::depth_value_of_code(middle, true));
  const auto shows = [&](double low, double high) {
    return kernels::is_in_clip_box(kernels::make_clip_box(clipping(axis, {{-1, -1, low}, {1, 1, high}})), 2, 2, true, 0,
                                   0, middle);
  };
  CHECK(shows(at, at));
  CHECK_FALSE(shows(at + 1e-12, 1));
  CHECK_FALSE(shows(-1, at - 1e-12));
}

TEST_CASE("a clipping box keeps exactly the samples inside", "[raster][clip]") {
  const bool is_blended = GENERATE(false, true), is_clustered = GENERATE(false, true);
  SceneBuilder builder;
  if (is_blended) {
    add_blended_meshes(builder, is_clustered);
  } else {
    add_masked_meshes(builder, is_clustered);
  }
  const kernels::SceneView scene = builder.view(1000);
  std::mt19937 random(3);
  std::vector<View> views = masked_views();
  views.push_back(look_at({30, 25, 40}, {0, 0, 0}, 64, 64, 0.01, 0.05));
  views.push_back(look_at({0.01, -0.69, 0.02}, {3, -0.9, 1}, 90, 64, 1e-5));
  for (const View& whole : views) {
    const std::vector<uint64_t> uncut = draw(scene, whole, 2);
    CHECK((draw(scene, clipping(whole, {{-100, -100, -100}, {100, 100, 100}}), 2) == uncut));
    for (int round = 0; round < (kIsSanitized ? 4 : 12); ++round) {
      const View view = clipping(whole, random_box(random, 1.2));
      const std::vector<uint64_t> found = draw(scene, view, 1 + round % 2);
      size_t wrong = 0;
      for (size_t i = 0; i < found.size(); ++i) {
        const bool is_inside = uncut[i] != kernels::kBackground && shows_inside(view, uncut, i);
        // A sample inside the box is kept. Any other sample has the background, or a surface behind it that is inside.
        const bool is_right =
            is_inside ? found[i] == uncut[i]
                      : found[i] == kernels::kBackground || (found[i] > uncut[i] && shows_inside(view, found, i));
        wrong += is_right ? 0 : 1;
      }
      CHECK(wrong == 0);
      // Culling of clusters, and the other instruction set, change nothing.
      CHECK((draw_counted(scene, view, nothing_left_out(), 2).samples == found));
      CHECK((draw_with(scene, view, 2, kernels::InstructionSet::kBaseline, {}) == found));
    }
  }
}

TEST_CASE("smaller nested clipping boxes keep fewer samples", "[raster][clip]") {
  SceneBuilder builder;
  add_masked_meshes(builder, false);
  const kernels::SceneView scene = builder.view();
  std::mt19937 random(11);
  for (const View& whole : masked_views()) {
    CutBox box = random_box(random, 1.3);
    std::vector<uint64_t> before = draw(scene, clipping(whole, box), 2);
    for (int step = 0; step < 4; ++step) {
      for (size_t k = 0; k < 3; ++k) {
        const double side = box.max[k] - box.min[k];
        box.min[k] += 0.07 * side;
        box.max[k] -= 0.11 * side;
      }
      const View view = clipping(whole, box);
      const std::vector<uint64_t> found = draw(scene, view, 2);
      size_t wrong = 0;
      for (size_t i = 0; i < found.size(); ++i) {
        const bool stays = before[i] != kernels::kBackground && shows_inside(view, before, i);
        wrong += (stays ? found[i] == before[i] : found[i] >= before[i]) ? 0 : 1;
      }
      CHECK(wrong == 0);
      before = found;
    }
  }
}

TEST_CASE("layers of blended surfaces end at a clipping box", "[raster][clip][blend]") {
  SceneBuilder builder;
  add_blended_meshes(builder, false);
  const kernels::SceneView scene = builder.view();
  const View whole = masked_views()[0];
  const View view = clipping(whole, {{-9, -9, -0.2}, {0.4, 9, 9}});
  const DrawnLayers layers = draw_layers(scene, view);
  CHECK(layers.counts.layers > 1);
  CHECK_FALSE((layers == draw_layers(scene, whole)));
  for (const std::vector<uint64_t>& layer : layers.samples) {
    size_t outside = 0;
    for (size_t i = 0; i < layer.size(); ++i)
      outside += layer[i] != kernels::kBackground && !shows_inside(view, layer, i) ? 1 : 0;
    CHECK(outside == 0);
  }
  CHECK((draw_layers(scene, clipping(whole, {{-99, -99, -99}, {99, 99, 99}})) == draw_layers(scene, whole)));
}

TEST_CASE("triangles outside a clipping box are culled", "[raster][clip]") {
  SceneBuilder builder;
  const uint32_t mesh = builder.mesh(sphere(60, 0.05), {.clusters = Clusters::kClustered});
  const uint32_t indexed = builder.mesh(grid(60, 0.1), {});
  for (int i = 0; i < 8; ++i) builder.instance(mesh, builder.matrix({1, 0, 0, 3.0 * i, 0, 1, 0, 0, 0, 0, 1, 0}));
  for (int i = 0; i < 8; ++i) builder.instance(indexed, builder.matrix({1, 0, 0, 3.0 * i, 0, 1, 0, -2, 0, 0, 1, 0}));
  const kernels::SceneView scene = builder.view();
  for (const bool is_orthographic : {false, true}) {
    View whole = look_at({10.5, 8, 30}, {10.5, 0, 0}, 400, 200, 0.1);
    if (is_orthographic) whole = orthographic(whole, 9, 0.1, 60);
    const auto stats = [&](const CutBox& box) { return draw_counted(scene, clipping(whole, box), {}).stats; };
    const kernels::FrameStats all = draw_counted(scene, whole, {}).stats;
    CHECK(all.instances_drawn == 16);
    CHECK(stats({{-9, -9, -9}, {99, 9, 9}}).instances_drawn == 16);
    // A box around the second sphere alone.
    const kernels::FrameStats one = stats({{1.9, -1.1, -1.1}, {4.1, 1.1, 1.1}});
    CHECK(one.instances_drawn == 1);
    CHECK(one.draws == 1);
    // A slab through all spheres: a part of each is kept, and most of their clusters are culled.
    const kernels::FrameStats slab = stats({{-9, 0.2, -9}, {99, 0.25, 9}});
    CHECK(slab.instances_drawn == 8);
    CHECK(slab.clusters_drawn > 0);
    CHECK(slab.clusters_drawn < all.clusters_drawn / 2);
    CHECK(stats({{-9, 50, -9}, {99, 51, 9}}).instances_drawn == 0);
  }
}

TEST_CASE("invalid clipping boxes are refused", "[raster][clip]") {
  SceneBuilder builder(grid(2, 0));
  const kernels::SceneView scene = builder.view();
  const View whole = masked_views()[0];
  std::vector<uint64_t> samples(size_t{whole.width} * whole.height);
  const auto message = [&](const CutBox& box) {
    const auto drawn = kernels::draw_cpu(scene, clipping(whole, box), samples, 1);
    return drawn ? std::string() : drawn.error().message;
  };
  const std::string expected = "clipping box that is infinite or whose corners are in the wrong order";
  CHECK(message({{0, 0, 0}, {1, 1, 1}}).empty());
  CHECK(message({{0, 0, 0}, {0, 1, 1}}).empty());
  CHECK(message({{0, 2, 0}, {1, 1, 1}}) == expected);
  CHECK(message({{0, 0, NAN}, {1, 1, 1}}) == expected);
  CHECK(message({{0, 0, 0}, {1, INFINITY, 1}}) == expected);
}
