// The bounds of cluster_bounds.h for a box hold for every triangle with vertices in it, and are tight enough to be
// useful. A box that the depth pyramid reports as hidden is behind every sample that it touches.
#include "kernels/cull/cluster_bounds.h"

#include <algorithm>
#include <array>
#include <bit>
#include <random>
#include <vector>

#include "kernels/cull/depth_pyramid.h"
#include "kernels/raster/clip.h"
#include "tests/kernels/drawn_chunks.h"

using namespace scree;
using namespace scree::kernels;
using namespace scree::tests;

namespace {

format::ClusterBounds bounds_of_codes(const std::vector<std::array<uint32_t, 3>>& codes) {
  std::array<uint32_t, 3> low = codes[0], high = codes[0];
  uint32_t widest = 0;
  for (size_t axis = 0; axis < 3; ++axis) {
    for (const auto& code : codes) {
      low[axis] = std::min(low[axis], code[axis]);
      high[axis] = std::max(high[axis], code[axis]);
    }
    widest = std::max(widest, high[axis] - low[axis]);
  }
  format::ClusterBounds bounds{.shift = widest < 256 ? 0 : static_cast<uint32_t>(std::bit_width(widest)) - 8};
  for (size_t axis = 0; axis < 3; ++axis)
    bounds.axis[axis] = low[axis] | (high[axis] - low[axis]) >> bounds.shift << 24;
  return bounds;
}

struct BoxTally {
  uint64_t boxes = 0, culled = 0;
  uint64_t empty = 0;  // boxes whose triangles cover no pixel centre
  uint64_t clipped = 0, wrong = 0;
  uint64_t area = 0;        // pixels of the bounds of boxes in front of the camera
  uint64_t least_area = 0;  // pixels of the smallest box around the triangles' own boxes
};

/// The pixels covered by all pieces of a triangle.
struct Covered {
  PixelBox box{INT32_MAX, INT32_MAX, INT32_MIN, INT32_MIN};
  uint32_t nearest_code = UINT32_MAX;
  bool clipped = false;

  template <bool kOrthographic>
  void add(const ScreenVertex& a, const ScreenVertex& b, const ScreenVertex& c, const FrameView& view) {
    const int32_t x[3] = {a.x, b.x, c.x};
    const int32_t y[3] = {a.y, b.y, c.y};
    const PixelBox one = pixel_box(x, y, view);
    if (one.empty()) return;
    box = {std::min(box.x0, one.x0), std::min(box.y0, one.y0), std::max(box.x1, one.x1), std::max(box.y1, one.y1)};
    const float nearest = std::max({a.depth, b.depth, c.depth});
    nearest_code = std::min(nearest_code, depth_code<kOrthographic>(nearest));
  }
};

template <bool kOrthographic>
void add_triangle(const FrameView& view, const Transform& transform, const ChunkReader& reader, uint32_t number,
                  Covered& covered) {
  uint32_t v[3];
  reader.triangle(number, v);
  ScreenVertex corners[3];
  ClipVertex polygon[kMaxPolygon];
  for (int i = 0; i < 3; ++i) {
    float d[3];
    reader.relative(v[i], d);
    corners[i] = project<kOrthographic>(transform, view, d[0], d[1], d[2]);
    double exact[3];
    reader.exact_relative(v[i], exact);
    polygon[i] = clip_vertex(transform, exact, corners[i]);
  }
  if (((corners[0].flags | corners[1].flags | corners[2].flags) & kNeedsClip) == 0) {
    covered.add<kOrthographic>(corners[0], corners[1], corners[2], view);
    return;
  }
  if ((corners[0].flags & corners[1].flags & corners[2].flags & kOutsideMask) != 0) return;
  covered.clipped = true;
  const int count = clip_polygon<kOrthographic>(polygon);
  for (int i = 2; i < count; ++i) {
    covered.add<kOrthographic>(snap_clipped<kOrthographic>(polygon[0], view),
                               snap_clipped<kOrthographic>(polygon[i - 1], view),
                               snap_clipped<kOrthographic>(polygon[i], view), view);
  }
}

/// Uses runs of 1 to 128 triangles of a chunk as clusters.
template <bool kOrthographic>
void tally_chunk(const FrameView& view, const format::MeshRecord& mesh, const format::ChunkRecord& chunk,
                 const ChunkReader& reader, const Transform& transform, std::mt19937& random, BoxTally& tally) {
  const RoundedBox whole = rounded_chunk_box(mesh, chunk, transform);
  const CoverageFilter filter =
      make_coverage_filter(view, transform, error_of(transform, whole), lattice_box(transform, mesh, chunk));
  const CenterRange centers = center_range(view);
  for (uint32_t first = 0; first < chunk.triangle_count;) {
    const uint32_t count = std::min(1 + static_cast<uint32_t>(random() % 128), chunk.triangle_count - first);
    std::vector<std::array<uint32_t, 3>> codes;
    Covered covered;
    for (uint32_t t = first; t < first + count; ++t) {
      uint32_t v[3];
      reader.triangle(t, v);
      for (const uint32_t vertex : v) reader.code(vertex, codes.emplace_back().data());
      add_triangle<kOrthographic>(view, transform, reader, t, covered);
    }
    first += count;
    const bool empty = covered.box.x0 > covered.box.x1;
    ScreenBounds said{};
    const bool shows = bound_on_screen<kOrthographic>(filter, view, centers, centered_box(bounds_of_codes(codes)),
                                                      said) == BoxCoverage::kCenters;
    ++tally.boxes;
    tally.culled += !shows;
    tally.empty += empty;
    tally.clipped += covered.clipped;
    if (empty) continue;
    const bool inside = shows && said.pixels.x0 <= covered.box.x0 && said.pixels.y0 <= covered.box.y0 &&
                        said.pixels.x1 >= covered.box.x1 && said.pixels.y1 >= covered.box.y1 &&
                        said.nearest_code <= covered.nearest_code;
    tally.wrong += !inside;
    if (said.nearest_code != 0) {
      tally.area += static_cast<uint64_t>(said.pixels.pixels());
      tally.least_area += static_cast<uint64_t>(covered.box.pixels());
    }
  }
}

void tally_scene(const SceneView& scene, const View& camera, std::mt19937& random, BoxTally& tally) {
  const FrameView view = make_frame_view(camera);
  for_each_drawn_chunk(scene, view, [&](const auto& mesh, const auto& chunk, const Transform& transform) {
    const ChunkReader reader = make_reader(mesh, chunk, scene.pages[chunk.page], transform, 0);
    if (view.orthographic) {
      tally_chunk<true>(view, mesh, chunk, reader, transform, random, tally);
    } else {
      tally_chunk<false>(view, mesh, chunk, reader, transform, random, tally);
    }
  });
}

}  // namespace

TEST_CASE("bounds of clusters contain every pixel and depth code of their triangles", "[cluster_bounds]") {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> unit(-1, 1);
  BoxTally sum;
  for (int round = 0; round < 160; ++round) {
    SceneBuilder scene;
    const Soup soup = round % 2 == 0 ? sphere(40, 0.2) : grid(60, 0.3);
    const uint32_t mesh = scene.mesh(soup, {false, -6 - round % 17, round % 5 == 0 ? 500u : 65536u});
    // From far away to inside the mesh.
    const double distance = std::pow(10.0, 2.5 * unit(random));
    const double z_near = distance * (round % 3 == 0 ? 1e-3 : std::abs(unit(random)));
    View camera = place_randomly(scene, mesh, round, distance, z_near, 60, [&] { return unit(random); });
    if (round % 8 == 5) camera = orthographic(camera, 0.3 + std::abs(unit(random)), 0.5 * distance, 2 * distance);
    tally_scene(scene.view(), camera, random, sum);
    INFO("round " << round);
    CHECK(sum.wrong == 0);
  }
  CAPTURE(sum.boxes, sum.culled, sum.empty, sum.clipped, sum.area, sum.least_area);
  // Both results occurred, most invisible boxes were found, and the bounds are not much larger than needed.
  CHECK(sum.culled > sum.boxes / 10);
  CHECK(sum.culled > sum.empty / 2);
  CHECK(sum.clipped > 500);
  CHECK(sum.area < 4 * sum.least_area);
}

TEST_CASE("a box is hidden only if it is behind every sample that it touches", "[cluster_bounds]") {
  std::mt19937 random(2);
  uint64_t hidden = 0, behind = 0, wrong = 0;
  for (const auto& [width, height] : {std::pair{1, 1}, {2, 3}, {64, 64}, {65, 130}, {257, 63}, {1000, 7}}) {
    std::vector<uint64_t> samples(static_cast<size_t>(width) * static_cast<size_t>(height));
    for (int32_t y = 0; y < height; ++y) {
      for (int32_t x = 0; x < width; ++x) {
        const bool hole = random() % 97 == 0;
        const auto code = 1000 + static_cast<uint32_t>(x + y) + static_cast<uint32_t>(random() % 5);
        samples[static_cast<size_t>(y) * static_cast<size_t>(width) + static_cast<size_t>(x)] =
            hole ? kBackground : pack_sample(code, random() % 1000);
      }
    }
    DepthPyramid pyramid;
    std::vector<uint32_t> codes(lay_out(pyramid, width, height));
    pyramid.codes = codes.data();
    build_pyramid(pyramid, samples.data());
    for (int i = 0; i < 4000; ++i) {
      PixelBox box{.x0 = static_cast<int32_t>(random() % static_cast<uint32_t>(width))};
      box.y0 = static_cast<int32_t>(random() % static_cast<uint32_t>(height));
      const int32_t reach = 1 << random() % 6;
      box.x1 = std::min(width - 1, box.x0 + static_cast<int32_t>(random() % static_cast<uint32_t>(reach)));
      box.y1 = std::min(height - 1, box.y0 + static_cast<int32_t>(random() % static_cast<uint32_t>(reach)));
      const auto code = 1000 + static_cast<uint32_t>(random() % static_cast<uint32_t>(2 * (width + height)));
      bool is_behind = true;
      for (int32_t y = box.y0; y <= box.y1; ++y) {
        for (int32_t x = box.x0; x <= box.x1; ++x) {
          const uint64_t sample = samples[static_cast<size_t>(y) * static_cast<size_t>(width) + static_cast<size_t>(x)];
          is_behind = is_behind && code > sample_depth_code(sample);
        }
      }
      const bool said = is_occluded(pyramid, samples.data(), box, code);
      hidden += said;
      behind += is_behind;
      wrong += said && !is_behind;
    }
  }
  CHECK(wrong == 0);
  CHECK(hidden > behind / 2);
}
