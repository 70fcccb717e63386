// One test per hard case of rasterisation (hard_cases.h): the number of pixels that differ from the double-precision
// reference, and its bound. A wrong pixel lies on an outline or an edge, which snapping to 1/256 pixel moves. Bounds
// are about twice the measured values.
#include <chrono>
#include <cstdio>

#include "tests/kernels/raster/hard_cases.h"

using namespace scree;
using namespace scree::tests;
using kernels::kBackground;
using kernels::View;

namespace {

Figures judged(const std::string& name, uint64_t most_background, uint64_t most_other, double most_depth_error) {
  HardCase hard = make_hard_case(name);
  const Figures figures = judge(hard);
  note(name, figures.text());
  CHECK(figures.background <= most_background);
  CHECK(figures.other_triangle <= most_other);
  CHECK(figures.depth_error <= most_depth_error);
  return figures;
}

std::string number(uint64_t value) {
  return std::to_string(value);
}

}  // namespace

TEST_CASE("hard: slivers of aspect 1e6", "[hard]") {
  const Figures figures = judged("slivers", 800, 0, 1e-6);
  // It is random which centres a sliver of a ten-thousandth of a pixel covers, but their number is not.
  CHECK(figures.reference > 100);
  CHECK(figures.covered > figures.reference / 2);
  CHECK(figures.covered < 2 * figures.reference);
}

TEST_CASE("hard: slivers of aspect 1e6 side by side cover each pixel once", "[hard]") {
  judged("sliver strip", 10, UINT64_MAX, 1e-5);  // a pixel has thousands of slivers, and one of them is drawn at random
  HardCase hard = make_hard_case("sliver strip");
  for (const View& view : hard.views) {
    const CoverCount count = count_covers(hard.builder, view);
    note("sliver strip, covers", number(count.covered) + " pixels, " + number(count.twice) + " of them twice");
    CHECK(count.covered > 500);
    CHECK(count.twice == 0);
  }
}

TEST_CASE("hard: triangles without area and duplicate triangles", "[hard]") {
  judged("degenerate and duplicate triangles", 10, 40, 2e-3);
  HardCase hard = make_hard_case("degenerate and duplicate triangles");
  const std::vector<uint64_t> samples = draw(hard.builder.view(), hard.views[0]);
  const uint64_t originals = sphere(12, 0.1).indices.size() / 3;
  // Each original is followed by five triangles: three without area, a copy, and a rotated copy, whose depth may be
  // rounded to the previous code.
  uint64_t turned = 0;
  for (const uint64_t sample : samples) {
    if (sample == kBackground || kernels::sample_id(sample) < originals) continue;
    REQUIRE((kernels::sample_id(sample) - originals) % 5 == 4);
    ++turned;
  }
  note("duplicate triangles", "none of the copies shows, " + number(turned) + " pixels of copies turned");
}

TEST_CASE("hard: the smaller id of coincident surfaces is visible", "[hard]") {
  judged("coincident surfaces", 10, 130, 5e-3);
  HardCase hard = make_hard_case("coincident surfaces");
  const uint64_t first = grid(20, 0.2).indices.size() / 3;
  const kernels::SceneView all = hard.builder.view();
  kernels::SceneView alone = all;
  alone.instance_count = 1;
  uint64_t later = 0, turned = 0;
  for (const View& view : hard.views) {
    const std::vector<uint64_t> samples = draw(all, view), expected = draw(alone, view);
    for (size_t i = 0; i < samples.size(); ++i) {
      if (samples[i] == expected[i]) continue;
      // Weights of corners in another order are rounded differently, so the rotated copy may be one code nearer.
      REQUIRE(expected[i] != kBackground);
      REQUIRE(kernels::sample_depth_code(samples[i]) + 1 == kernels::sample_depth_code(expected[i]));
      (kernels::sample_id(samples[i]) >= 3 * first ? turned : later) += 1;
    }
  }
  note("coincident surfaces, later ids",
       number(later) + " pixels of copies, " + number(turned) +
           " of a copy whose triangles start at another corner, one depth code nearer");
  CHECK(later == 0);
}

TEST_CASE("hard: triangles over the whole screen and far beyond", "[hard]") {
  const Figures figures = judged("whole screen", 0, 0, 1e-3);
  CHECK(figures.covered == figures.reference);
  CHECK(figures.covered > 200000);
}

TEST_CASE("hard: a plane seen edge-on", "[hard]") {
  // Surfaces thinner than a 256th of a pixel cover no centre, where the reference still finds centres.
  judged("edge-on", 400, 0, 1e-3);
}

TEST_CASE("hard: triangles across the near plane", "[hard]") {
  CHECK(judged("near plane", 5, 20, 1e-2).covered > 50000);
}

TEST_CASE("hard: everything behind the camera", "[hard]") {
  CHECK(judged("behind the camera", 0, 0, 0).covered == 0);
}

TEST_CASE("hard: a vertex at the eye", "[hard]") {
  judged("vertex at the eye", 5, 10, 1e-3);
}

TEST_CASE("hard: vertices at pixel centres, edges through them", "[hard]") {
  judged("vertices at pixel centres", 0, 0, 1e-7);  // exact in both; ties follow the same rule
  HardCase hard = make_hard_case("vertices at pixel centres");
  for (const View& view : hard.views) {
    const CoverCount count = count_covers(hard.builder, view);
    note("vertices at pixel centres, covers", number(count.covered) + " pixels, " + number(count.twice) + " twice");
    CHECK(count.covered == 112 * 112);
    CHECK(count.twice == 0);
  }
}

TEST_CASE("hard: fans of 10,000 triangles round a pixel", "[hard]") {
  judged("fans", 30, UINT64_MAX, 1e-6);  // one of a pixel's triangles is drawn at random
  HardCase hard = make_hard_case("fans");
  const CoverCount count = count_covers(hard.builder, hard.views[0]);
  note("fans, covers", number(count.covered) + " pixels, " + number(count.twice) + " twice");
  CHECK(count.covered > 5000);
  CHECK(count.twice == 0);
  const auto is_covered = [&](size_t x, size_t y) { return count.is_covered[y * 200 + x]; };
  CHECK(is_covered(100, 49));  // both have their hub at a pixel centre
  CHECK(is_covered(40, 19));
  for (const size_t y : {79, 80})
    for (const size_t x : {159, 160}) CHECK_FALSE(is_covered(x, y));  // around a corner: no centre inside
}

TEST_CASE("hard: a closed mesh of sub-pixel triangles has no leak and no double cover", "[hard]") {
  judged("sub-pixel sphere", 10, 200, 1e-3);
  check_closed("closed mesh, covers", sphere(150, 0), sphere_view(160), 80 / 1.1);
}

TEST_CASE("hard: a closed mesh of 10 M sub-pixel triangles", "[.hard-long]") {
  check_closed("closed mesh of 10 M triangles, covers", sphere(1582, 0), sphere_view(1024), 512 / 1.1);
}

TEST_CASE("hard: a mesh of millimetre detail 1e7 m from the origin", "[hard]") {
  judged("georeferenced by translation", 5, 30, 3e-3);
  judged("georeferenced float32", 5, 30, 1e-3);
}

TEST_CASE("hard: scales of 1e-6 and 1e6", "[hard]") {
  const Figures small = judged("scale 1e-6", 5, 40, 1e-3), large = judged("scale 1e6", 5, 40, 1e-3);
  CHECK(small.covered > 10000);
  CHECK(large.covered > 10000);
}

TEST_CASE("hard: flat and single-point meshes", "[hard]") {
  judged("flat and single-point meshes", 5, 30, 3e-4);
}

TEST_CASE("hard: depths from 1e-3 to 1e7", "[hard]") {
  judged("depth range", 10, 5, 5e-6);
  HardCase hard = make_hard_case("depth range");
  double nearest = INFINITY, farthest = 0;
  for (const uint64_t sample : draw(hard.builder.view(), hard.views[0])) {
    if (sample == kBackground) continue;
    const double depth = kernels::depth_of_code(hard.views[0], kernels::sample_depth_code(sample));
    nearest = std::min(nearest, depth);
    farthest = std::max(farthest, depth);
  }
  CHECK(nearest < 1.01e-3);
  CHECK(farthest > 1e7);
}

TEST_CASE("hard: mirrored, sheared and degenerate transforms", "[hard]") {
  judged("transforms", 10, 100, 1e-2);
}

TEST_CASE("hard: pictures of 1 x 1, 1 x 8192, 8192 x 1 and odd sizes", "[hard]") {
  CHECK(judged("odd sizes", 5, 900, 1e-2).pixels == 1 + 8192 + 8192 + 6 + 129 * 127);
}

TEST_CASE("hard: every case is equal in clusters and in indexed chunks of the same order", "[hard][clusters]") {
  for (const NamedCase& named : hard_cases()) {
    INFO(named.name);
    const HardCase hard = named.make();
    HardCase clustered = in_clusters(hard, Clusters::kClustered), undone = in_clusters(hard, Clusters::kUndone);
    const kernels::SceneView scene = clustered.builder.view(), other = undone.builder.view();
    REQUIRE(scene.chunk_kinds == kernels::ChunkKinds::kClustered);
    REQUIRE(other.chunk_kinds != kernels::ChunkKinds::kClustered);
    for (size_t i = 0; i < hard.views.size(); ++i) {
      INFO("view " << i);
      const View& view = hard.views[i];
      const std::vector<uint64_t> expected = draw(other, view);
      CHECK((draw(scene, view) == expected));  // a picture may be too large to be printed
      CHECK((draw_with(scene, view, 2, kernels::InstructionSet::kBaseline, {1, 1, 1}) == expected));
    }
  }
}

TEST_CASE("hard: a picture of 16384 x 16384", "[.hard-long]") {
  SceneBuilder builder;
  Soup soup;
  for (const auto& [x, y] : {std::array<int, 2>{-1, -1}, {1, -1}, {1, 1}, {-1, 1}}) soup.add(x, y, 0);
  soup.triangle(0, 1, 2);
  soup.triangle(0, 2, 3);
  builder.instance(builder.mesh(soup, Encoding{}), builder.identity());
  builder.instance(builder.mesh(sphere(200, 0.1), Encoding{}), builder.matrix({1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, -2}));
  const View view = orthographic(look_at({0, 0, 1}, {0, 0, 0}, 16384, 16384), 2, 0, 8);
  const auto start = std::chrono::steady_clock::now();
  const std::vector<uint64_t> samples = draw(builder.view(), view, 2);
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  const uint64_t of_square = static_cast<uint64_t>(std::count_if(
      samples.begin(), samples.end(), [](uint64_t s) { return s != kBackground && kernels::sample_id(s) < 2; }));
  char took[32];
  std::snprintf(took, sizeof took, "%.1f s", seconds);
  note("16384 x 16384", number(of_square) + " pixels of the square, 8192 x 8192 expected; " + number(covered(samples)) +
                            " covered in all; " + took);
  CHECK(of_square == uint64_t{8192} * 8192);
  CHECK(covered(samples) > of_square);
}
