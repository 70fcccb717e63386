// The reference rasteriser compared with counts made by hand.
#include <algorithm>
#include <cmath>
#include <vector>

#include "tests/tools/compare/reference_fixture.h"
#include "tools/compare/reference.h"

using namespace scree;
using namespace scree::tests;
using namespace compare;

namespace {

using Points = std::vector<float>;
using Corners = std::vector<uint32_t>;

std::vector<ReferencePixel> draw(const ReferenceMesh& mesh, const kernels::View& view,
                                 const std::vector<ReferenceInstance>& instances = {identity()}, uint32_t threads = 2) {
  return tests::draw_reference(mesh, view, instances, {}, threads);
}

uint64_t count(const std::vector<ReferencePixel>& pixels, uint64_t triangle) {
  return static_cast<uint64_t>(std::count_if(pixels.begin(), pixels.end(), [&](const ReferencePixel& pixel) {
    return !pixel.is_background() && pixel.triangle == triangle;
  }));
}

const Points kSquare{-4, -4, 0, 4, -4, 0, 4, 4, 0, -4, 4, 0};

}  // namespace

TEST_CASE("a square's pixel centres on its diagonal belong to one triangle, by the top-left rule", "[reference]") {
  for (const bool deep : {false, true}) {
    const kernels::View view = deep ? deep_view(16, 12) : pixel_view(16, 12);
    const auto pixels = draw({kSquare, kSquareCorners, nullptr, false}, view);
    // The eight centres on the diagonal lie on a left edge of the lower triangle, and on a right edge of the upper
    // triangle.
    CHECK(count(pixels, 0) == 36);
    CHECK(count(pixels, 1) == 28);
    for (uint32_t y = 0; y < 12; ++y)
      for (uint32_t x = 0; x < 16; ++x) {
        const ReferencePixel& pixel = pixels[16 * y + x];
        CHECK(pixel.is_background() == !(x >= 4 && x < 12 && y >= 2 && y < 10));
        if (!pixel.is_background()) CHECK(std::abs(pixel.depth - 8) < 1e-14);
      }
  }
}

TEST_CASE("a mask's texels leave out the pixels that they cover", "[reference][mask]") {
  const kernels::View view = pixel_view(16, 12);
  const std::vector<float> uvs{0, 1, 1, 1, 1, 0, 0, 0};
  compare::ReferenceMask mask{.place = {{{1, 0, 0}, {0, 1, 0}}},
                              .wrap = {format::Wrap::kClamp, format::Wrap::kClamp},
                              .width = 2,
                              .height = 2,
                              .levels = {{255, 0, 0, 200}},
                              .cutoff = 127.5,
                              .magnified_nearest = true};
  ReferenceMesh mesh{kSquare, kSquareCorners, nullptr, false, &mask, uvs};
  const auto pixels = draw(mesh, view);
  for (uint32_t y = 0; y < 12; ++y)
    for (uint32_t x = 0; x < 16; ++x) {
      const bool is_square = x >= 4 && x < 12 && y >= 2 && y < 10;
      CHECK(pixels[16 * y + x].is_background() == !(is_square && (x < 8) == (y < 6)));
    }
  // Bilinear: in the middle of a side, each of two texels has half of the weight.
  mask.magnified_nearest = false;
  mask.cutoff = 1;
  CHECK(covered(draw(mesh, view)) > 50);
  mask.cutoff = 201;
  CHECK(covered(draw(mesh, view)) < 16);
  // The alpha of the vertices, 1 on the left and 0 on the right, leaves out the right half.
  mask.levels = {{255, 255, 255, 255}};
  mask.cutoff = 127.5;
  const std::vector<float> alphas{1, 0, 0, 1};
  mesh.alphas = alphas;
  const auto left = draw(mesh, view);
  CHECK(covered(left) == 32);
  CHECK_FALSE(left[16 * 5 + 7].is_background());
  CHECK(left[16 * 5 + 8].is_background());
  mesh.alphas = {};
  // A masked part hides nothing behind it.
  mask.cutoff = 256;
  CHECK(covered(draw(mesh, view)) == 0);
}

TEST_CASE("edges through pixel centres follow the top-left rule", "[reference]") {
  // All four sides go through centres, 8 + 1 in each direction. One row and one column of these are outside the square.
  Points points = kSquare;
  for (size_t i = 0; i < points.size(); i += 3) {
    points[i] += 0.5f;
    points[i + 1] += 0.5f;
  }
  const auto pixels = draw({points, kSquareCorners, nullptr, false}, pixel_view(16, 16));
  CHECK(covered(pixels) == 64);
  CHECK_FALSE(pixels[3 * 16 + 4].is_background());  // top left centre: x = -3.5, y = 4.5
  CHECK(pixels[3 * 16 + 12].is_background());       // right
  CHECK(pixels[11 * 16 + 4].is_background());       // bottom
  CHECK_FALSE(pixels[10 * 16 + 11].is_background());
}

TEST_CASE("back faces are left out unless the mesh is double-sided, and mirroring reverses faces", "[reference]") {
  const kernels::View view = deep_view(16, 16);
  Corners back = kSquareCorners;
  for (size_t t = 0; t < back.size(); t += 3) std::swap(back[t + 1], back[t + 2]);
  ReferenceInstance mirrored = identity();
  mirrored.world[0][0] = -1;
  CHECK(covered(draw({kSquare, kSquareCorners, nullptr, false}, view)) == 64);
  CHECK(covered(draw({kSquare, back, nullptr, false}, view)) == 0);
  CHECK(covered(draw({kSquare, back, nullptr, true}, view)) == 64);
  CHECK(covered(draw({kSquare, kSquareCorners, nullptr, false}, view, {mirrored})) == 64);
  CHECK(covered(draw({kSquare, back, nullptr, false}, view, {mirrored})) == 0);
}

TEST_CASE("a floor from behind the eye to far away fills the picture below the horizon", "[reference]") {
  // A floor 5 below the eye, from 1000 behind to 10^6 in front: the horizon is the top of the middle row.
  const Points floor{-1e7f, -5, 1e3f, 1e7f, -5, 1e3f, 1e7f, -5, -1e6f, -1e7f, -5, -1e6f};
  const kernels::View view = deep_view(16, 16);
  const auto pixels = draw({floor, kSquareCorners, nullptr, false}, view);
  for (uint32_t y = 0; y < 16; ++y) {
    for (uint32_t x = 0; x < 16; ++x) {
      const ReferencePixel& pixel = pixels[16 * y + x];
      CHECK(pixel.is_background() == (y < 8));
      if (y < 8) continue;
      const double below = (y - 7.5) / 8;  // slope of the ray, at distance 1
      CHECK(std::abs(pixel.depth - 5 / below) <= 1e-12 * pixel.depth);
    }
  }
  kernels::View late = view;
  late.z_near = 5 / ((11.0 - 7.5) / 8) * (1 + 1e-9);  // slightly beyond the floor at row 11
  CHECK(covered(draw({floor, kSquareCorners, nullptr, false}, late)) == 16 * 3);
}

TEST_CASE("the nearest triangle is drawn, the first one at equal depths, for any number of threads", "[reference]") {
  std::vector<ReferenceInstance> instances{identity(), identity(), identity()};
  instances[1].world[2][3] = 2;  // nearer
  instances[2].world[2][3] = 2;
  const ReferenceMesh mesh{kSquare, kSquareCorners, nullptr, false};
  const auto one = draw(mesh, pixel_view(33, 17), instances, 1);
  CHECK(covered(one) > 0);
  for (const ReferencePixel& pixel : one)
    if (!pixel.is_background()) {
      CHECK(pixel.instance == 1);
      CHECK(std::abs(pixel.depth - 6) < 1e-14);
    }
  for (const uint32_t threads : {2u, 5u, 64u}) {
    const auto many = draw(mesh, pixel_view(33, 17), instances, threads);
    REQUIRE(many.size() == one.size());
    for (size_t i = 0; i < one.size(); ++i) {
      CHECK(many[i].instance == one[i].instance);
      CHECK(many[i].triangle == one[i].triangle);
    }
  }
}

TEST_CASE("a fan of thin triangles covers every pixel of its square once", "[reference]") {
  // 4000 triangles around a pixel's centre, with rims on the square's sides, so that shared edges cross every pixel.
  constexpr uint32_t kSpokes = 4000;
  Points points{0.5f, 0.5f, 0};
  Corners corners;
  for (uint32_t i = 0; i < kSpokes; ++i) {
    const double angle = 2 * 3.14159265358979 * i / kSpokes;
    points.push_back(static_cast<float>(0.5 + 40 * std::cos(angle)));
    points.push_back(static_cast<float>(0.5 + 40 * std::sin(angle)));
    points.push_back(0);
    corners.insert(corners.end(), {0, 1 + i, 1 + (i + 1) % kSpokes});
  }
  const kernels::View view = deep_view(24, 24);
  CHECK(covered(draw({points, corners, nullptr, false}, view)) == 24 * 24);
  const ReferenceMesh mesh{points, corners, nullptr, false};
  for (uint32_t y = 0; y < 24; ++y) {
    for (uint32_t x = 0; x < 24; ++x) {
      uint32_t owners = 0;
      for (uint64_t t = 0; t < kSpokes; ++t)
        owners += compare::reference_depth(mesh, identity(), t, view, x, y).has_value() ? 1 : 0;
      CHECK(owners == 1);
    }
  }
}

TEST_CASE("a scene 10^7 units from the origin is drawn as at the origin", "[reference]") {
  kernels::View view = deep_view(16, 16);
  ReferenceInstance instance = identity();
  const ReferenceMesh mesh{kSquare, kSquareCorners, nullptr, false};
  const auto here = draw(mesh, view);
  for (size_t i = 0; i < 3; ++i) {
    instance.world[i][3] = 1e7;
    view.eye[i] += 1e7;
  }
  const auto there = draw(mesh, view, {instance});
  for (size_t i = 0; i < here.size(); ++i) {
    CHECK(here[i].depth == there[i].depth);
    CHECK(here[i].triangle == there[i].triangle);
  }
}

TEST_CASE("triangles that are dropped, missing or without area draw nothing", "[reference]") {
  const kernels::View view = pixel_view(16, 16);
  const std::vector<bool> second{false, true};
  CHECK(covered(draw({kSquare, kSquareCorners, &second, false}, view)) == 28);
  CHECK(covered(draw({{}, {}, nullptr, false}, view)) == 0);
  const Corners flat{0, 1, 1, 2, 2, 2};
  CHECK(covered(draw({kSquare, flat, nullptr, true}, view)) == 0);
  kernels::View wrong = view;
  wrong.width = 0;
  CHECK_FALSE(compare::draw_reference({}, {}, wrong, 1));
}
