// Clipping at the near plane alone gives the same result as clipping at all planes.
#include "kernels/raster/clip.h"

#include <cmath>
#include <limits>
#include <random>

#include "tests/catch.h"

using namespace scree::kernels;

namespace {

bool is_same(const ScreenVertex& a, const ScreenVertex& b) {
  return a.x == b.x && a.y == b.y && a.depth == b.depth && a.flags == b.flags;
}

/// Clips at all planes: returns the number of corners, and the corners as drawn.
int cut_at_all(const ClipVertex v[3], const FrameView& view, ScreenVertex out[kMaxPolygon]) {
  ClipVertex polygon[kMaxPolygon] = {v[0], v[1], v[2]};
  const int count = clip_polygon<false>(polygon);
  for (int i = 0; i < count; ++i) out[i] = snap_clipped<false>(polygon[i], view);
  return count;
}

struct Tally {
  uint64_t by_count[5] = {};  // triangles clipped at the near plane alone, by number of corners
  uint64_t left = 0;          // triangles for the general clipper
  uint64_t wrong = 0;
};

void tally(const ClipVertex v[3], const FrameView& view, Tally& sums) {
  NearPolygon near;
  if (!clip_near(v, view, near)) {
    ++sums.left;
    return;
  }
  ScreenVertex expected[kMaxPolygon];
  const int count = cut_at_all(v, view, expected);
  ++sums.by_count[near.count];
  bool same = near.count == count;
  for (int i = 0; same && i < count; ++i) same = is_same(near.corner[i], expected[i]);
  sums.wrong += same ? 0 : 1;
}

FrameView small_view() {
  return {.width = 640, .height = 360};
}

}  // namespace

TEST_CASE("clip: clipping at the near plane alone gives the corners of clipping at all planes", "[raster]") {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> unit(-1, 1);
  const FrameView view = small_view();
  Tally sums;
  for (int round = 0; round < 400000; ++round) {
    ClipVertex v[3];
    // Much smaller than the near distance, about as large, and much larger; some leave the guard band.
    const double across = std::pow(10.0, 3 * unit(random)), wide = std::pow(10.0, 4 + 4 * unit(random));
    const double middle = 1 + across * unit(random);
    for (ClipVertex& corner : v) {
      corner.w = round % 16 == 0 && unit(random) > 0 ? 1.0 : middle + across * unit(random);
      corner.x = wide * unit(random);
      corner.y = wide * unit(random);
      const bool inside =
          corner.w >= 1 && std::abs(corner.x) <= kGuardBand * corner.w && std::abs(corner.y) <= kGuardBand * corner.w;
      // Single precision may put a corner near the plane on its other side.
      corner.snapped = round % 32 == 0 ? unit(random) > 0 : inside;
      corner.drawn = {round, -round, 0.25f, 0};
    }
    tally(v, view, sums);
  }
  CHECK(sums.wrong == 0);
  CHECK(sums.by_count[0] > 10000);
  CHECK(sums.by_count[3] > 10000);
  CHECK(sums.by_count[4] > 10000);
  CHECK(sums.left > 10000);
  CHECK(sums.by_count[1] + sums.by_count[2] == 0);
}

TEST_CASE("clip: clip_near() refuses coordinates that are not finite or too large", "[raster]") {
  const FrameView view = small_view();
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(), -1e300}) {
    for (int axis = 0; axis < 3; ++axis) {
      ClipVertex v[3] = {{0, 0, 2, {}, true}, {10, 0, 0.5, {}, false}, {0, 10, 3, {}, true}};
      (axis == 0 ? v[1].x : axis == 1 ? v[1].y : v[1].w) = bad;
      NearPolygon near;
      CHECK_FALSE(clip_near(v, view, near));
    }
  }
}
