// The filter never drops a triangle that covers a pixel centre, and drops nearly all others of a dense mesh.
#include "kernels/cull/coverage_filter.h"

#include <random>

#include "kernels/raster/clip.h"
#include "tests/kernels/drawn_chunks.h"

using namespace scree;
using namespace scree::kernels;
using namespace scree::tests;

namespace {

struct FilterTally {
  uint64_t triangles = 0;
  uint64_t clipped = 0;   // not outside, with corners that need clipping
  uint64_t covering = 0;  // the exact projection, or a piece of it, has a non-empty pixel box
  uint64_t kept = 0;
  uint64_t wrong = 0;  // covering and not kept
};

/// Whether a piece of the clipped triangle has a non-empty pixel box.
template <bool kOrthographic>
bool piece_covers(ClipVertex polygon[kMaxPolygon], const FrameView& view) {
  const int count = clip_polygon<kOrthographic>(polygon);
  ScreenVertex corner[kMaxPolygon];
  for (int i = 0; i < count; ++i) corner[i] = snap_clipped<kOrthographic>(polygon[i], view);
  for (int i = 2; i < count; ++i) {
    const int32_t x[3] = {corner[0].x, corner[i - 1].x, corner[i].x};
    const int32_t y[3] = {corner[0].y, corner[i - 1].y, corner[i].y};
    if (!pixel_box(x, y, view).empty()) return true;
  }
  return false;
}

template <bool kOrthographic>
void tally_chunk(const FrameView& view, const format::MeshRecord& mesh, const format::ChunkRecord& chunk,
                 const ChunkReader& reader, const Transform& transform, FilterTally& tally) {
  const CoverageFilter filter =
      make_coverage_filter(view, transform, error_of(transform, vertex_box(mesh, chunk, transform)),
                           stored_box(transform, vertex_box(mesh, chunk, transform), mesh, chunk));
  const SampleLimits limits = make_sample_limits(view);
  for (uint32_t t = 0; t < chunk.triangle_count; ++t) {
    uint32_t v[3];
    reader.triangle(t, v);
    FilteredVertex filtered[3];
    ClipVertex polygon[kMaxPolygon];
    int32_t x[3];
    int32_t y[3];
    uint32_t any = 0;
    uint32_t all = ~0u;
    for (int i = 0; i < 3; ++i) {
      float d[3];
      reader.relative(v[i], d);
      const ScreenVertex exact = project<kOrthographic>(transform, view, d[0], d[1], d[2]);
      double unrounded[3];
      reader.exact_relative(v[i], unrounded);
      polygon[i] = clip_vertex(transform, unrounded, exact);
      x[i] = exact.x;
      y[i] = exact.y;
      any |= exact.flags;
      all &= exact.flags;
      float stored[3];
      uint32_t codes[3] = {};
      if (!reader.float32) reader.code(v[i], codes);
      for (int k = 0; k < 3; ++k)
        stored[k] = reader.float32 ? reader.float_position(v[i], k) : static_cast<float>(codes[k]);
      filtered[i] = filter_vertex<kOrthographic>(filter, stored[0], stored[1], stored[2]);
    }
    const bool clipped = (any & kNeedsClip) != 0 && (all & kOutsideMask) == 0;
    const bool covers = (any & kNeedsClip) == 0 ? !pixel_box(x, y, view).empty()
                                                : clipped && piece_covers<kOrthographic>(polygon, view);
    const bool kept = may_cover_sample<kOrthographic>(filter, limits, filtered[0], filtered[1], filtered[2]);
    ++tally.triangles;
    tally.clipped += clipped;
    tally.covering += covers;
    tally.kept += kept;
    tally.wrong += covers && !kept;
  }
}

FilterTally tally(const SceneView& scene, const View& camera) {
  const FrameView view = make_frame_view(camera);
  FilterTally out;
  for_each_drawn_chunk(scene, view, [&](const auto& mesh, const auto& chunk, const Transform& transform) {
    const ChunkReader reader = make_reader(mesh, chunk, scene.pages[chunk.page], transform, 0);
    if (view.orthographic) {
      tally_chunk<true>(view, mesh, chunk, reader, transform, out);
    } else {
      tally_chunk<false>(view, mesh, chunk, reader, transform, out);
    }
  });
  return out;
}

}  // namespace

TEST_CASE("no triangle that covers a pixel centre is filtered out", "[sample_filter]") {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> unit(-1, 1);
  FilterTally sum;
  for (int round = 0; round < 120; ++round) {
    SceneBuilder scene;
    const Soup soup = round % 2 == 0 ? sphere(40, 0.2) : grid(60, 0.3);
    const bool float32 = round % 3 == 0;
    const uint32_t mesh = scene.mesh(soup, {float32, -6 - round % 17, round % 5 == 0 ? 500u : 65536u});
    // From far away to inside the mesh.
    const double distance = std::pow(10.0, 3 * unit(random));
    View camera = place_randomly(scene, mesh, round, distance, distance * 1e-3, 100, [&] { return unit(random); });
    if (round % 8 == 5) camera = orthographic(camera, 0.3 + std::abs(unit(random)), 0.1 * distance, 2 * distance);
    const FilterTally one = tally(scene.view(), camera);
    INFO("round " << round);
    CHECK(one.wrong == 0);
    sum.triangles += one.triangles;
    sum.covering += one.covering;
    sum.kept += one.kept;
  }
  // Both results occurred often enough to be meaningful.
  CHECK(sum.covering > sum.triangles / 20);
  CHECK(sum.kept < sum.triangles - sum.triangles / 20);
}

TEST_CASE("most triangles of a dense mesh are filtered out", "[sample_filter]") {
  for (const bool float32 : {false, true}) {
    SceneBuilder scene(grid(300, 0.05), {float32, -16});
    // 180,000 triangles on about 30,000 pixels: legs of half a pixel.
    const FilterTally seen = tally(scene.view(), look_at({0.4, 2.5, 1.5}, {0, 0, 0}, 200, 160));
    CHECK(seen.wrong == 0);
    CHECK(seen.covering > 1000);
    CHECK(seen.kept < seen.covering + seen.covering / 10);
    CHECK(seen.kept < seen.triangles / 2);
  }
}

TEST_CASE("most triangles that are smaller than a pixel are filtered out at the near plane too", "[sample_filter]") {
  for (const bool float32 : {false, true}) {
    SceneBuilder scene(rough_field(300, 0.01), {float32, -16});
    FilterTally sum;
    // From above, with the surface at the near plane. Then from close, with corners at half of the near distance.
    const FilterTally above = tally(scene.view(), look_at({0, 1.6, 0}, {0, 0, 0}, 200, 160, 1.6));
    CHECK(above.wrong == 0);
    CHECK(above.clipped > 50000);
    CHECK(above.kept < above.triangles / 2);
    CHECK(above.kept < 2 * above.covering);  // the part that is clipped away would have covered some
    for (const double height : {0.4, 0.1, 0.02}) {
      const FilterTally near = tally(scene.view(), look_at({0.1, height, 0.05}, {0, 0, 0}, 200, 160, height));
      INFO("from " << height);
      CHECK(near.wrong == 0);
      CHECK(near.clipped > 5);
    }
  }
}

TEST_CASE("degenerate matrices keep every triangle", "[sample_filter]") {
  SceneBuilder scene;
  scene.instance(scene.mesh(grid(4, 0.1), {}), scene.matrix({1e200, 0, 0, 0, 0, 1e200, 0, 0, 0, 0, 1e200, 0}));
  scene.instance(0, scene.matrix({NAN, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}));
  const FilterTally seen = tally(scene.view(), look_at({0, 2, 2}, {0, 0, 0}, 64, 64));
  CHECK(seen.triangles == 64);
  CHECK(seen.kept == 64);
}
