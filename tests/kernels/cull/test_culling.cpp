// Culling on the CPU never removes anything visible, and removes most of the hidden part.
#include <algorithm>
#include <cmath>
#include <random>
#include <utility>

#include "kernels/cull/near_bucket.h"
#include "kernels/frame_parts.h"
#include "tests/kernels/cuda/frame/crowd.h"
#include "tests/kernels/draw_counted.h"
#include "tests/sanitized.h"

using namespace scree;
using namespace scree::kernels;
using namespace scree::tests;

namespace {

/// Rounds of few triangles, with a new pyramid before almost every round.
QueueSizes many_rounds() {
  return {.block_triangles = 500, .round_triangles = 64};
}

/// A wall of two triangles at z = 1, up to `half` units from its middle.
Soup wall(double half) {
  Soup soup;
  for (const double y : {-half, half})
    for (const double x : {-half, half}) soup.add(x, y, 1);
  soup.triangle(0, 1, 2);
  soup.triangle(2, 1, 3);
  return soup;
}

/// A hundred spheres in four layers, and a wall in front of them. (A chunk's box is up to twice as large as its
/// content.)
void build_rows(SceneBuilder& builder, Clusters clusters) {
  const Encoding encoding{
      .chunk_triangles = 1500, .material = builder.material(format::kMaterialDoubleSided), .clusters = clusters};
  const uint32_t screen = builder.mesh(wall(1.2), encoding);
  const uint32_t ball = builder.mesh(sphere(40, 0.3), encoding);
  builder.instance(screen, builder.identity());
  for (int row = 0; row < 4; ++row) {
    for (int i = 0; i < 25; ++i) {
      builder.instance(ball, builder.matrix({row == 2 ? -0.35 : 0.35, 0, 0, 0.8 * (i % 5 - 2), 0, 0.35, 0,
                                             0.8 * (i / 5 - 2), 0, 0, 0.35, -1 - 0.9 * row}));
    }
  }
}

}  // namespace

TEST_CASE("culling: pictures of random cameras equal pictures of all triangles, with every kind of culling on and off",
          "[raster][clusters]") {
  for (const Clusters clusters : {Clusters::kClustered, Clusters::kNone}) {
    SceneBuilder builder;
    build_rows(builder, clusters);
    const SceneView scene = builder.view();
    std::mt19937 random(31);
    std::uniform_real_distribution<double> place(-1, 1);
    uint64_t drawn = 0;
    uint64_t within = 0;  // in the picture, hidden or not
    for (int i = 0; i < (kIsSanitized ? 25 : 200); ++i) {
      // Around the scene and inside it, with near planes that cut through spheres, in tall and wide pictures.
      const double far = i % 4 == 0 ? 0.6 : 5;
      View view =
          look_at({far * place(random), far * place(random), far * place(random) + 1}, {0.3 * place(random), 0, 0},
                  33 + static_cast<uint32_t>(random() % 90), 17 + static_cast<uint32_t>(random() % 70), 0.05);
      if (i % 5 == 0) view = orthographic(view, 0.5 + std::abs(place(random)), 0.1, 12);
      const Drawn expected = draw_counted(scene, view, nothing_left_out());
      const QueueSizes bounds_alone{.occlusion = false};
      for (const QueueSizes& sizes : {QueueSizes{}, many_rounds(), bounds_alone}) {
        const Drawn found = draw_counted(scene, view, sizes);
        CHECK(found.samples == expected.samples);
        CHECK(found.stats.triangles == expected.stats.triangles);
      }
      CHECK(draw_with(scene, view, 3, InstructionSet::kBaseline, many_rounds()) == expected.samples);
      drawn += draw_counted(scene, view, many_rounds()).stats.triangles_small;
      within += draw_counted(scene, view, bounds_alone).stats.triangles_small;
    }
    CHECK(drawn < within);
  }
}

TEST_CASE("culling: the bands of the depth pyramid equal a simple implementation's", "[raster][clusters]") {
  std::mt19937_64 random(3);
  for (const auto& [width, height] : {std::pair{1, 1},
                                      {3, 5},
                                      {255, 63},
                                      {256, 64},
                                      {257, 65},
                                      {258, 3},
                                      {513, 129},
                                      {4097, 66},
                                      {16384, 1},
                                      {1, 16384}}) {
    std::vector<uint64_t> samples(static_cast<size_t>(width) * static_cast<size_t>(height));
    for (uint64_t& sample : samples) sample = random() % 50 == 0 ? kBackground : random();
    DepthPyramid plain{};
    std::vector<uint32_t> plain_codes(lay_out(plain, width, height));
    plain.codes = plain_codes.data();
    build_pyramid(plain, samples.data());
    DepthPyramid banded{};
    std::vector<uint32_t> codes(lay_out(banded, width, height, kPyramidFirstLevel), 77);
    banded.codes = codes.data();
    const PyramidBand band{banded, samples.data()};
    for (int32_t item = 0; item < banded.down(PyramidBand::kBandLevels); ++item) band(static_cast<uint32_t>(item), 0);
    for (uint32_t level = PyramidBand::kBandLevels + 1; level <= kPyramidLevels; ++level)
      fill_level(banded, level, 0, 1);
    for (uint32_t level = kPyramidFirstLevel; level <= kPyramidLevels; ++level) {
      INFO(width << " x " << height << ", level " << level);
      const size_t count = static_cast<size_t>(plain.across(level)) * static_cast<size_t>(plain.down(level));
      CHECK(std::equal(plain.row(level, 0), plain.row(level, 0) + count, banded.row(level, 0)));
    }
  }
}

TEST_CASE("culling: a picture of many tiles equals that of all triangles", "[raster][clusters]") {
  SceneBuilder builder;
  build_rows(builder, Clusters::kClustered);
  const SceneView scene = builder.view();
  const View view = look_at({1.7, 0.9, 1.1}, {0, 0, -2}, 1402, 611);
  const Drawn all = draw_counted(scene, view, nothing_left_out());
  const Drawn found = draw_counted(scene, view, {.round_triangles = 20000}, 2);
  CHECK(found.samples == all.samples);
  CHECK(found.stats.clusters_drawn < all.stats.clusters_drawn);
}

TEST_CASE("culling: triangles behind a wall are not drawn", "[raster][clusters]") {
  for (const Clusters clusters : {Clusters::kClustered, Clusters::kNone}) {
    SceneBuilder builder;
    build_rows(builder, clusters);
    const SceneView scene = builder.view();
    // The wall fills the picture, in front of 100 spheres.
    const View view = look_at({0, 0, 2}, {0, 0, 0}, 64, 40);
    const Drawn all = draw_counted(scene, view, nothing_left_out());
    const Drawn found = draw_counted(scene, view, {.round_triangles = 1});
    CHECK(found.samples == all.samples);
    REQUIRE(all.stats.triangles_small > 2000);
    CHECK(found.stats.triangles_small == 0);
    CHECK(found.stats.triangles_medium + found.stats.triangles_large == 2);
    if (clusters != Clusters::kClustered) continue;
    CHECK(all.stats.clusters_drawn > 1000);
    CHECK(all.stats.clusters_tested == 0);
    CHECK(found.stats.clusters_drawn == 1);
    CHECK(found.stats.groups_tested > 25);
  }
}

TEST_CASE("culling: clusters of one object hide clusters behind them without a pyramid", "[raster][clusters]") {
  SceneBuilder builder(sphere(150, 1), {.clusters = Clusters::kClustered});
  const SceneView scene = builder.view();
  const View view = look_at({0, 0, 9}, {0, 0, 0}, 64, 64);
  const Drawn all = draw_counted(scene, view, nothing_left_out());
  const Drawn found = draw_counted(scene, view, QueueSizes{});
  CHECK(found.samples == all.samples);
  CHECK(found.stats.clusters_drawn < all.stats.clusters_drawn);
}

TEST_CASE("culling: the visible ones of a hundred thousand instances are drawn", "[raster][clusters]") {
  SceneBuilder builder;
  build_crowd(builder);
  const SceneView scene = builder.view();
  REQUIRE(scene.instance_count > 100000);
  for (const View& view :
       {look_at({0, -2.4, 1.5}, {0, 0, 0}, 160, 90), look_at({0.2, 0.1, 0.3}, {0.1, 0.6, 0}, 160, 90),
        orthographic(look_at({0, 0, 2}, {0, 0, 0}, 90, 90), 1.1, 0.1, 5)}) {
    const Drawn all = draw_counted(scene, view, nothing_left_out(), 2);
    const Drawn found = draw_counted(scene, view, QueueSizes{}, 2);
    CHECK(found.samples == all.samples);
    CHECK(found.stats.instances_drawn == all.stats.instances_drawn);
    CHECK(found.stats.clusters_drawn < all.stats.clusters_drawn);
    CHECK(covered(found.samples) > 500);
  }
}

TEST_CASE("culling: parts of a picture hide triangles of later parts", "[raster][clusters]") {
  SceneBuilder builder;
  build_rows(builder, Clusters::kClustered);
  SceneView scene = builder.view();
  const View view = look_at({0.3, 0.2, 4}, {0, 0, 0}, 200, 120);
  const std::vector<uint64_t> expected = draw(scene, view);
  std::vector<const std::byte*> pages(scene.pages, scene.pages + builder.pages.size());
  scene.pages = pages.data();
  std::vector<uint64_t> samples(expected.size(), kBackground);
  // One page after another, from the last to the first.
  for (size_t page = pages.size(); page-- > 0;) {
    std::vector<const std::byte*> one(pages.size(), nullptr);
    one[page] = pages[page];
    scene.pages = one.data();
    REQUIRE(draw_part_cpu(scene, view, samples, 2));
  }
  CHECK(samples == expected);
}

TEST_CASE("culling: chunks are ordered from near to far for any near plane", "[raster]") {
  for (const float near : {1e-1f, 1e-3f, 1e-6f, 1e-12f}) {  // the near plane, as a share of the scene's size
    const float farthest = 1 / near;                        // depths count from the near plane
    CHECK(near_bucket(farthest, false, farthest) == kNearBuckets - 1);
    const float nearest = std::max(1.0f, farthest / 65000);
    for (float depth = nearest; depth * 1.04f < farthest; depth *= 1.04f)
      REQUIRE(near_bucket(depth, false, farthest) < near_bucket(depth * 1.04f, false, farthest));
    CHECK(near_bucket(0, false, farthest) <= near_bucket(nearest, false, farthest));
    CHECK(near_bucket(std::nanf(""), false, farthest) < kNearBuckets);
  }
  CHECK(near_bucket(-0.1f, true, 1) == 0);
  CHECK(near_bucket(0.3f, true, 1) < near_bucket(0.31f, true, 1));
  CHECK(near_bucket(1.1f, true, 1) == kNearBuckets - 1);
}

TEST_CASE("culling: single precision keeps every box that double precision keeps, and few more", "[raster]") {
  std::mt19937_64 random(17);
  std::uniform_real_distribution<double> unit(-1, 1);
  uint64_t kept = 0, kept_rounded = 0, in_part = 0;
  for (int i = 0; i < 200000; ++i) {
    const double distance = std::pow(10.0, 3 * unit(random));
    View camera = look_at({unit(random), unit(random), unit(random)}, {2 * unit(random), unit(random), 0.1},
                          1 + static_cast<uint32_t>(random() % 4000), 1 + static_cast<uint32_t>(random() % 4000),
                          std::pow(10.0, -3 + 2 * unit(random)) * distance);
    if (i % 4 == 0) camera = orthographic(camera, distance * std::abs(unit(random)), 0.1 * distance, 2 * distance);
    const FrameView view = make_frame_view(camera);
    format::MeshRecord mesh{.lattice_exponent = -static_cast<int32_t>(random() % 24)};
    format::ChunkRecord chunk{};
    format::MatrixRecord matrix{};
    for (int row = 0; row < 3; ++row) {
      for (int column = 0; column < 3; ++column) matrix.rows[row][column] = unit(random);
      matrix.rows[row][3] = distance * unit(random);
      // Boxes of all sizes, on both sides of the origin.
      const double steps = std::min(std::ldexp(distance, -mesh.lattice_exponent), 1e9);
      mesh.lattice_min[row] = static_cast<int64_t>(steps * unit(random));
      chunk.position_min[row] = static_cast<uint32_t>(random() % 65536);
      chunk.position_bits[row] = static_cast<uint8_t>(random() % 25);
    }
    const Transform transform = make_transform(view, matrix, mesh.lattice_exponent, false);
    const bool keeps = may_be_seen(transform, view, chunk_box(mesh, chunk, transform));
    const bool keeps_rounded = may_be_seen(transform, view, rounded_chunk_box(mesh, chunk, transform));
    if (keeps && !keeps_rounded) FAIL("box " << i);
    kept += keeps;
    kept_rounded += keeps_rounded;
    if (!keeps) continue;
    // A box that the picture keeps is also kept for all of its rows, and for at least one of three ranges of rows.
    FrameView part = view;
    part.first_row = static_cast<int32_t>(random() % static_cast<uint64_t>(view.height));
    part.end_row =
        part.first_row + 1 + static_cast<int32_t>(random() % static_cast<uint64_t>(view.height - part.first_row));
    FrameView above = view, below = view;
    above.end_row = part.first_row;
    below.first_row = part.end_row;
    const auto in_rows = [&](const FrameView& rows) {
      const bool exact = may_be_seen(transform, rows, chunk_box(mesh, chunk, transform), drawn_rows(rows));
      const bool rounded = may_be_seen(transform, rows, rounded_chunk_box(mesh, chunk, transform), drawn_rows(rows));
      if (exact && !rounded) FAIL("rows of box " << i);
      return exact;
    };
    CHECK(in_rows(view));
    const bool is_in_part = in_rows(part);
    in_part += is_in_part;
    if (!is_in_part && !in_rows(above) && !in_rows(below)) FAIL("box " << i << " is in no row");
  }
  CAPTURE(kept, kept_rounded, in_part);
  CHECK(kept > 20000);
  CHECK(kept < 180000);
  CHECK(kept_rounded - kept < kept / 1000);
  CHECK(in_part > kept / 10);
  CHECK(in_part < kept - kept / 10);
}

TEST_CASE("culling: a box with a point in a row of the picture is kept for it", "[raster]") {
  std::mt19937_64 random(23);
  std::uniform_real_distribution<double> unit(-1, 1);
  uint64_t seen = 0;
  for (int i = 0; i < 50000; ++i) {
    View camera = look_at({unit(random), unit(random), unit(random)}, {2 * unit(random), unit(random), 0.1}, 97,
                          1 + static_cast<uint32_t>(random() % 400), 0.01);
    if (i % 4 == 0) camera = orthographic(camera, 0.1 + std::abs(unit(random)), 0.1, 3);
    FrameView view = make_frame_view(camera);
    format::MeshRecord mesh{.lattice_exponent = -12};
    format::ChunkRecord chunk{};
    format::MatrixRecord matrix{};
    for (int row = 0; row < 3; ++row) {
      for (int column = 0; column < 3; ++column) matrix.rows[row][column] = unit(random);
      matrix.rows[row][3] = unit(random);
      mesh.lattice_min[row] = static_cast<int64_t>(4096 * unit(random));
      chunk.position_bits[row] = static_cast<uint8_t>(random() % 13);
    }
    const Transform transform = make_transform(view, matrix, mesh.lattice_exponent, false);
    const RelativeBox box = chunk_box(mesh, chunk, transform);
    double at[3];  // a point of the box, then its place on the screen
    for (int k = 0; k < 3; ++k) at[k] = box.center[k] + unit(random) * box.extent[k];
    const auto value = [&](const double row[4]) { return row[0] * at[0] + row[1] * at[1] + row[2] * at[2] + row[3]; };
    const double w = view.orthographic ? 1 : value(transform.exact_w);
    const double row = (value(transform.exact_y) / w + static_cast<double>(view.half_height)) / kSubpixels;
    const double column = (value(transform.exact_x) / w + static_cast<double>(view.half_width)) / kSubpixels;
    const double depth = value(transform.exact_w);
    if (view.orthographic ? !(depth >= 0 && depth <= 1) : depth < 1) continue;
    if (!(row >= 0 && row < view.height && column >= 0 && column < view.width)) continue;
    ++seen;
    view.first_row = static_cast<int32_t>(row);
    view.end_row = view.first_row + 1;
    CHECK(may_be_seen(transform, view, box, drawn_rows(view)));
    CHECK(may_be_seen(transform, view, rounded_chunk_box(mesh, chunk, transform), drawn_rows(view)));
  }
  CHECK(seen > 5000);
}
