// The fixed-point map of a cluster never drops a triangle that covers a pixel centre, keeps hardly more than the filter
// that it replaces, and exists for most clusters that are small on the screen.
#include "kernels/cull/affine_projection.h"

#include <algorithm>
#include <cmath>
#include <random>

#include "tests/kernels/drawn_chunks.h"

using namespace scree;
using namespace scree::kernels;
using namespace scree::tests;

namespace {

struct Tally {
  uint64_t clusters = 0, linear = 0;
  uint64_t predicted = 0;  // of the clusters with a map
  uint64_t triangles = 0;  // of these clusters
  uint64_t covering = 0, kept = 0, kept_by_filter = 0, wrong = 0;
};

/// A vertex's place on the screen, as the kernel computes it. `words`: the first one contains the vertices' first bit.
uint32_t place_of(const AffineProjection& map, const ClusterCodes& codes, const uint32_t* words, uint32_t vertex) {
  const uint32_t stride = codes.bits[0] + codes.bits[1] + codes.bits[2];
  uint64_t window = 0;
  for (uint32_t i = 0; i < stride; ++i) {
    const uint64_t bit = uint64_t{vertex} * stride + i;
    window |= uint64_t{words[bit / 32] >> (bit % 32) & 1} << i;
  }
  const uint32_t part[3] = {static_cast<uint32_t>(window), static_cast<uint32_t>(window >> codes.bits[0]),
                            static_cast<uint32_t>(window >> codes.bits[0] >> codes.bits[1])};
  const auto sum = [&](const uint32_t* row) { return row[0] * part[0] + row[1] * part[1] + row[2] * part[2] + row[3]; };
  return sum(map.u) >> 16 | (sum(map.v) & 0xffff0000u);
}

/// Makes the map by the steps that a GPU computes in parallel, a lane per axis.
AffineProjection make_affine_projection(const CoverageFilter& filter, const format::ClusterBounds& bounds,
                                        const ClusterCodes& codes) {
  AffineProjection out{};
  const AffineCenter middle = make_affine_center(filter, bounds);
  if (!middle.known || codes.bits[0] + codes.bits[1] + codes.bits[2] > 64) return out;
  const AffineAxis u = make_affine_axis(middle, filter.w, filter.u);
  const AffineAxis v = make_affine_axis(middle, filter.w, filter.v);
  const uint32_t fraction_bits = affine_fraction_bits(fast_max(u.half, v.half));
  uint32_t twice_slack_u, twice_slack_v;
  if (fraction_bits == 0 ||
      !finish_affine_axis(middle, u, filter.w, filter.u, codes, fraction_bits, out.u, twice_slack_u) ||
      !finish_affine_axis(middle, v, filter.w, filter.v, codes, fraction_bits, out.v, twice_slack_v))
    return out;
  out.fraction = ((1u << fraction_bits) - 1) * 0x10001u;
  out.twice_slack = twice_slack_u | twice_slack_v << 16;
  return out;
}

void tally_cluster(const FrameView& view, const CoverageFilter& filter, const ChunkReader& reader,
                   const Transform& transform, const format::ClusterRecord& record, const format::ClusterBounds& bounds,
                   const uint32_t* data, Tally& tally) {
  const format::ClusterLayout at = format::cluster_layout(record);
  ClusterCodes codes{{at.position_bits[0], at.position_bits[1], at.position_bits[2]}, at.predicted_axis, {}, 0};
  if (at.predicted_axis != format::kNotPredicted) {
    const auto slopes = static_cast<int32_t>(data[at.prediction]);
    codes.slope[(at.predicted_axis + 1) % 3] = static_cast<int16_t>(slopes);
    codes.slope[(at.predicted_axis + 2) % 3] = slopes >> 16;
    codes.bias = static_cast<int32_t>(data[at.prediction + 1]);
  }
  const AffineProjection map = make_affine_projection(filter, bounds, codes);
  ++tally.clusters;
  if (map.twice_slack == 0) return;
  ++tally.linear;
  tally.predicted += at.predicted_axis != format::kNotPredicted;
  const SampleLimits limits = make_sample_limits(view);
  for (uint32_t t = record.first_triangle; t < record.first_triangle + at.triangle_count; ++t) {
    uint32_t v[3];
    reader.triangle(t, v);
    int32_t x[3];
    int32_t y[3];
    uint32_t flags = 0;
    FilteredVertex filtered[3];
    uint32_t places[3];
    uint32_t largest[2] = {0, 0};
    uint32_t smallest[2] = {0xffff, 0xffff};
    for (int i = 0; i < 3; ++i) {
      float d[3];
      reader.relative(v[i], d);
      const ScreenVertex exact = project<false>(transform, view, d[0], d[1], d[2]);
      x[i] = exact.x;
      y[i] = exact.y;
      flags |= exact.flags;
      uint32_t code[3];
      reader.code(v[i], code);
      float stored[3];
      for (int k = 0; k < 3; ++k) stored[k] = static_cast<float>(format::bounds_min(bounds, k) + code[k]);
      filtered[i] = filter_vertex<false>(filter, stored[0], stored[1], stored[2]);
      places[i] = place_of(map, codes, data + at.positions, v[i] - record.first_vertex);
      for (uint32_t axis = 0; axis < 2; ++axis) {
        largest[axis] = std::max(largest[axis], places[i] >> (16 * axis) & 0xffff);
        smallest[axis] = std::min(smallest[axis], places[i] >> (16 * axis) & 0xffff);
      }
    }
    const bool covers = !pixel_box(x, y, view).empty();
    const bool kept = AffineProjection::may_cover(largest[0] | largest[1] << 16, smallest[0] | smallest[1] << 16,
                                                  map.twice_slack, map.fraction);
    ++tally.triangles;
    tally.covering += covers;
    tally.kept += kept;
    tally.kept_by_filter += may_cover_sample<false>(filter, limits, filtered[0], filtered[1], filtered[2]);
    tally.wrong += (flags & kNeedsClip) != 0 || (covers && !kept);
  }
}

void tally_scene(const SceneView& scene, const View& camera, Tally& tally) {
  const FrameView view = make_frame_view(camera);
  for_each_drawn_chunk(scene, view, [&](const auto& mesh, const auto& chunk, const Transform& transform) {
    const std::byte* const page = scene.pages[chunk.page] + chunk.offset;
    const format::ChunkStreams streams = format::chunk_streams(mesh, chunk);
    const RoundedBox box = rounded_chunk_box(mesh, chunk, transform);
    const CoverageFilter filter =
        make_coverage_filter(view, transform, error_of(transform, box), lattice_box(transform, mesh, chunk));
    const auto* const bounds = reinterpret_cast<const format::ClusterBounds*>(page + streams.cluster_bounds.offset);
    const auto* const records = reinterpret_cast<const format::ClusterRecord*>(page + streams.clusters.offset);
    const auto* const data = reinterpret_cast<const uint32_t*>(page + streams.cluster_data.offset);
    for (uint32_t i = 0; i < chunk.cluster_count; ++i) {
      const ChunkReader reader =
          make_reader(mesh, chunk, scene.pages[chunk.page], transform, records[i].first_triangle);
      tally_cluster(view, filter, reader, transform, records[i], bounds[i], data, tally);
    }
  });
}

}  // namespace

TEST_CASE("a cluster's affine filter keeps every triangle that covers a pixel centre", "[sample_filter]") {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> unit(-1, 1);
  Tally sum;
  for (int round = 0; round < 120; ++round) {
    SceneBuilder scene;
    const Soup soup = round % 2 == 0 ? sphere(60, 0.2) : grid(90, 0.3);
    const uint32_t mesh =
        scene.mesh(soup, {false, -6 - round % 17, round % 5 == 0 ? 500u : 65536u, format::kNone, Clusters::kClustered});
    const double distance = std::pow(10.0, 1.3 + 1.2 * unit(random));
    const View camera = place_randomly(scene, mesh, round, distance, distance * 1e-3, 60, [&] { return unit(random); });
    tally_scene(scene.view(), camera, sum);
    INFO("round " << round);
    CHECK(sum.wrong == 0);
  }
  CAPTURE(sum.clusters, sum.linear, sum.predicted, sum.triangles, sum.covering, sum.kept, sum.kept_by_filter);
  CHECK(sum.linear > sum.clusters / 3);
  CHECK(sum.predicted > 100);
  CHECK(sum.covering > sum.triangles / 20);
  CHECK(sum.kept < sum.kept_by_filter + sum.kept_by_filter / 10);
}
