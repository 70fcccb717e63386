// Ambient occlusion and eye-dome lighting compared with their geometric definition.
#include "tests/kernels/scene_builder.h"

using namespace scree;
using namespace scree::kernels;
using namespace scree::tests;

namespace {

/// A rectangle at depth z, facing +z.
void add_rectangle(Soup& soup, double x0, double y0, double x1, double y1, double z) {
  const uint32_t a = soup.add(x0, y0, z);
  soup.add(x1, y0, z);
  soup.add(x1, y1, z);
  soup.add(x0, y1, z);
  soup.triangle(a, a + 1, a + 2);
  soup.triangle(a, a + 2, a + 3);
}

struct Factors {
  uint32_t width;
  std::vector<float> values;
  double at(uint32_t x, uint32_t y) const { return static_cast<double>(values[size_t{y} * width + x]); }
};

Factors factors(const SceneView& scene, View view, const ShadeOptions& options, uint32_t side = 1,
                uint32_t threads = 2) {
  Factors out{view.width, std::vector<float>(size_t{view.width} * view.height)};
  view.width *= side;
  view.height *= side;
  REQUIRE(occlusion_cpu(view, side, draw(scene, view), options, out.values, threads));
  return out;
}

ShadeOptions ssao() {
  return {.ssao = true};
}
ShadeOptions edl() {
  return {.edl = true};
}
ShadeOptions both() {
  ShadeOptions options = ssao();
  options.edl = true;
  return options;
}

/// A camera at (0, 0, 10) looking along -z. Both projections show 10 units of height at z = 0.
View camera(bool orthographic_camera, uint32_t width, uint32_t height) {
  const View view = look_at({0, 0, 10}, {0, 0, 0}, width, height, 0.5, 2 * std::atan(0.5));
  return orthographic_camera ? orthographic(view, 5, 0.5, 30) : view;
}

}  // namespace

TEST_CASE("occlusion: a plane that faces the camera keeps all its light, and so does the background", "[occlusion]") {
  for (const bool flat : {false, true}) {
    Soup soup;
    add_rectangle(soup, -4, -4, 3, 4, 0);
    SceneBuilder builder(soup);
    for (const uint32_t side : {1u, 2u, 4u}) {
      const Factors found = factors(builder.view(), camera(flat, 97, 61), both(), side);
      for (const float value : found.values) REQUIRE(value == 1.0f);
    }
  }
}

TEST_CASE("occlusion: a tilted plane does not occlude itself", "[occlusion]") {
  for (const bool flat : {false, true}) {
    for (const double tilt : {0.3, 1.0, 3.0}) {
      Soup soup;
      const uint32_t a = soup.add(-9, -9, -9 * tilt / 3);
      soup.add(9, -9, 9 * tilt / 3);
      soup.add(9, 9, 9 * tilt / 3);
      soup.add(-9, 9, -9 * tilt / 3);
      soup.triangle(a, a + 1, a + 2);
      soup.triangle(a, a + 2, a + 3);
      SceneBuilder builder;
      builder.instance(builder.mesh(soup, {.material = builder.material(format::kMaterialDoubleSided)}),
                       builder.identity());
      const Factors found = factors(builder.view(), camera(flat, 200, 100), ssao());
      for (const float value : found.values) REQUIRE(value == 1.0f);
    }
  }
}

TEST_CASE("occlusion: a step darkens its far side, not its near one", "[occlusion]") {
  // The far plane lies behind the whole picture. The near one lies in front of its left half, half a radius nearer. 400
  // pixels are 10 units, and the radius is 400 / 40 = 10 pixels.
  for (const bool flat : {false, true}) {
    Soup soup;
    add_rectangle(soup, -40, -40, 40, 40, 0);
    add_rectangle(soup, -40, -40, 0, 40, 0.125);
    SceneBuilder builder(soup);
    const View view = camera(flat, 120, 400);
    const Factors open = factors(builder.view(), view, ssao());
    const Factors lit = factors(builder.view(), view, edl());
    // A pixel beside the edge has three of its eight neighbours in front of it.
    const double step = flat ? 0.125 / 10 / std::log(2.0) : std::log2(10 / 9.875);
    const double expected = std::exp(-120.0 * 3 / 8 * step);
    for (uint32_t y = 20; y < 380; ++y) {
      REQUIRE(lit.at(60, y) == Approx(expected).epsilon(1e-3));
      REQUIRE(lit.at(61, y) == 1);
      REQUIRE(lit.at(59, y) == 1);
      REQUIRE(open.at(60, y) < 0.9);
      REQUIRE(open.at(73, y) == 1);              // beyond the radius and the blur
      REQUIRE(open.at(59, y) > open.at(60, y));  // only the blur reaches the near side
      REQUIRE(open.at(56, y) == 1);
    }
    // The combined factor is the product of both.
    const Factors product = factors(builder.view(), view, both());
    for (size_t i = 0; i < product.values.size(); ++i)
      REQUIRE(static_cast<double>(product.values[i]) ==
              Approx(static_cast<double>(open.values[i]) * static_cast<double>(lit.values[i])).margin(1e-6));
  }
}

TEST_CASE("occlusion: eye-dome lighting follows its strength and radius", "[occlusion]") {
  Soup soup;
  add_rectangle(soup, -40, -40, 40, 40, 0);
  add_rectangle(soup, -40, -40, 0, 40, 0.125);
  SceneBuilder builder(soup);
  const View view = camera(false, 120, 100);
  ShadeOptions options = edl();
  options.edl_strength = 0.5f;
  const double step = std::log2(10 / 9.875);
  CHECK(factors(builder.view(), view, options).at(60, 50) == Approx(std::exp(-60.0 * 3 / 8 * step)).epsilon(1e-3));
  options.edl_radius = 4;  // diagonal neighbours are 3 pixels away
  CHECK(factors(builder.view(), view, options).at(62, 50) == Approx(std::exp(-60.0 * 3 / 8 * step)).epsilon(1e-3));
  CHECK(factors(builder.view(), view, options).at(63, 50) == Approx(std::exp(-60.0 * 1 / 8 * step)).epsilon(1e-3));
  CHECK(factors(builder.view(), view, options).at(64, 50) == 1);
  options.edl_strength = 0;
  CHECK(factors(builder.view(), view, options).at(62, 50) == 1);
}

TEST_CASE("occlusion: a corner is darkest in its crease, at any scale", "[occlusion]") {
  for (const bool flat : {false, true}) {
    std::vector<Factors> found;
    for (const double scale : {1.0, 1024.0}) {
      // Two walls at a right angle. Their crease is upright in the middle of the picture and points away from the
      // camera.
      Soup soup;
      for (const double turn : {-1.0, 1.0}) {
        const uint32_t a = soup.add(0, -20 * scale, 0);
        soup.add(0, 20 * scale, 0);
        soup.add(8 * turn * scale, 20 * scale, 8 * scale);
        soup.add(8 * turn * scale, -20 * scale, 8 * scale);
        soup.triangle(a, a + 1, a + 2);
        soup.triangle(a, a + 2, a + 3);
      }
      SceneBuilder builder;
      builder.instance(builder.mesh(soup, {.exponent = scale > 1 ? -2 : -12,
                                           .material = builder.material(format::kMaterialDoubleSided)}),
                       builder.identity());
      View view = look_at({0, 0, 10 * scale}, {0, 0, 0}, 401, 401, 0.5 * scale, 2 * std::atan(0.5));
      if (flat) view = orthographic(view, 5 * scale, 0.5 * scale, 30 * scale);
      found.push_back(factors(builder.view(), view, ssao()));
    }
    const Factors& open = found[0];
    for (uint32_t y = 100; y < 300; ++y) {
      REQUIRE(open.at(200, y) < 0.7);
      REQUIRE(open.at(200, y) < open.at(206, y));
      REQUIRE(open.at(206, y) < 1);
      REQUIRE(open.at(230, y) == 1);
      REQUIRE(open.at(170, y) == 1);
    }
    CHECK(found[0].values == found[1].values);
  }
}

TEST_CASE("occlusion: equal for any number of threads; wrong sizes are refused", "[occlusion]") {
  SceneBuilder builder(grid(30, 0.3));
  const View view = look_at({0.3, 1, 2}, {0, 0, 0}, 202, 102);
  const Factors one = factors(builder.view(), view, both(), 2, 1);
  CHECK(one.values == factors(builder.view(), view, both(), 2, 3).values);
  CHECK(std::count_if(one.values.begin(), one.values.end(), [](float v) { return v < 0.9f; }) > 100);
  const std::vector<uint64_t> samples = draw(builder.view(), view);
  std::vector<float> values(101 * 51);
  CHECK(occlusion_cpu(view, 2, samples, both(), values, 1));
  CHECK_FALSE(occlusion_cpu(view, 4, samples, both(), values, 1));
  CHECK_FALSE(occlusion_cpu(view, 3, samples, both(), values, 1));
  values.pop_back();
  CHECK_FALSE(occlusion_cpu(view, 2, samples, both(), values, 1));
}
