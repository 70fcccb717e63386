// The filter of a staged cluster, by a warp: which of its triangles may cover a pixel centre. The cluster's affine
// projection (affine_projection.h) gives the place of each vertex on the screen. If the cluster has none, the filter
// (coverage_filter.h) gives the pixel centres before and after each vertex. A triangle is tested by the results of its
// three corners.
#pragma once

#include "kernels/cuda/raster/cluster_run.cuh"
#include "kernels/cull/affine_projection.h"

namespace scree::kernels {

/// Packs two integers within +-2^15, given as floats, into two 16-bit numbers.
__device__ inline uint32_t pack_centers(float x, float y) {
  constexpr float kMagic = 12582912.0f;  // 1.5 * 2^23: a float of this size has the number in its lowest bits
  return __byte_perm(__float_as_uint(x + kMagic), __float_as_uint(y + kMagic), 0x5410);
}

/// The first and the last pixel centre of the image, packed.
struct PackedRange {
  uint32_t first;
  uint32_t last;
};

/// The filter's result for a vertex, in the form of ClusterShared::centers.
template <bool kOrthographic>
__device__ inline uint2 vertex_centers(const CoverageFilter& filter, const PackedRange& all,
                                       const FilteredVertex& vertex) {
  float slack = filter.slack;
  if (kOrthographic || filter.growth != 0.0f) {
    // The same conditions as in may_cover_sample(). In addition the coordinate, with its error, has to fit 16 bits.
    const float farthest = fast_max(fast_abs(vertex.u), fast_abs(vertex.v));
    slack = fused(farthest, filter.growth, slack);
    bool held = !(farthest < 32700.0f) | !(slack < 16.0f) | !(vertex.w >= filter.w_lowest);
    if constexpr (kOrthographic) held = held | !(vertex.w <= filter.w_end);
    if (held) return {all.first, all.last};
  }
  // Adding 1.5 * 2^23 rounds to nearest. Subtracting or adding a half first makes it round down or up. It is 0.49 here,
  // on the safe side by a hundredth, so that ties do not matter.
  const float half_width = slack - 0.49f;
  return {__vmaxs2(pack_centers(vertex.u - half_width, vertex.v - half_width), all.first),
          __vmins2(pack_centers(vertex.u + half_width, vertex.v + half_width), all.last)};
}

/// Packs the high halves of two words into one word.
__device__ inline uint32_t pack_high(uint32_t a, uint32_t b) {
  return __byte_perm(a, b, 0x7632);
}

/// Computes shared.screen_places by the cluster's affine projection. `kLong`: a vertex takes more than 32 bits.
template <bool kLong>
__device__ inline void project_vertices(const PreparedCluster& cluster, const ClusterStage& stage) {
  ClusterShared& shared = cluster_shared();
  const uint32_t lane = threadIdx.x % kWarpLanes;
  const uint32_t last_vertex = byte_of(cluster.shape, PreparedCluster::kLastVertex);
  const uint32_t bits_x = byte_of(cluster.codes, PreparedCluster::kBitsX);
  const uint32_t bits_xy = byte_of(cluster.codes, PreparedCluster::kBitsXy);
  const uint32_t stride = byte_of(cluster.codes, PreparedCluster::kBitsXyz);
  const uint32_t mask = (2u << ((stride - 1) & 31)) - 1;  // of the highest word that a vertex takes
  const AffineProjection projection = cluster.projection;
  // 32 vertices of b bits take b whole words, so each lane's vertices begin at the same bit of a word.
  const uint32_t bit = lane * stride;
  const uint32_t* from = stage.words() + byte_of(cluster.offsets, PreparedCluster::kPositions) + (bit >> 5);
#pragma unroll 1
  for (uint32_t vertex = lane; vertex <= last_vertex; vertex += kWarpLanes, from += stride) {
    uint32_t codes[3];
    codes[0] = __funnelshift_r(from[0], from[1], bit);
    if constexpr (kLong) {
      const uint32_t high = __funnelshift_r(from[1], from[2], bit) & mask;
      const uint64_t window = uint64_t{high} << 32 | codes[0];
      codes[1] = static_cast<uint32_t>(window >> bits_x);
      codes[2] = static_cast<uint32_t>(window >> bits_xy);
    } else {
      codes[0] &= mask;
      codes[1] = __funnelshift_rc(codes[0], 0, bits_x);
      codes[2] = __funnelshift_rc(codes[0], 0, bits_xy);
    }
    const uint32_t u =
        projection.u[0] * codes[0] + (projection.u[1] * codes[1] + (projection.u[2] * codes[2] + projection.u[3]));
    const uint32_t v =
        projection.v[0] * codes[0] + (projection.v[1] * codes[1] + (projection.v[2] * codes[2] + projection.v[3]));
    shared.screen_places[vertex] = pack_high(u, v);
  }
}

/// Computes shared.centers by the chunk's filter.
template <bool kOrthographic, bool kDropsHidden>
__device__ inline void filter_vertices(const ClusterFrame& frame, const PreparedCluster& cluster,
                                       const ClusterStage& stage) {
  ClusterShared& shared = cluster_shared();
  const uint32_t lane = threadIdx.x % kWarpLanes;
  const uint32_t vertex_count = byte_of(cluster.shape, PreparedCluster::kLastVertex) + 1;
  const CenterRange centers = center_range(frame.small.view);
  const PackedRange all{pack_centers(centers.first[0], centers.first[1]),
                        pack_centers(centers.last[0], centers.last[1])};
  // Keeps every triangle if the filter is off, and for the few clusters that are longer than a ClusterStage.
  if (!frame.small.filters || (cluster.offsets & PreparedCluster::kTruncated) != 0) {
    for (uint32_t vertex = lane; vertex < vertex_count; vertex += kWarpLanes) {
      shared.centers[vertex] = {all.first, all.last};
      if constexpr (kDropsHidden) shared.nearest_w[vertex] = 0;
    }
    return;
  }
  const uint32_t bits_x = byte_of(cluster.codes, PreparedCluster::kBitsX);
  const uint32_t bits_xy = byte_of(cluster.codes, PreparedCluster::kBitsXy);
  const uint32_t stride = byte_of(cluster.codes, PreparedCluster::kBitsXyz);
  const uint32_t mask[3] = {(1u << bits_x) - 1, (1u << (bits_xy - bits_x)) - 1, (1u << (stride - bits_xy)) - 1};
  const uint32_t* const positions = stage.words() + byte_of(cluster.offsets, PreparedCluster::kPositions);
  const uint32_t* const words = stage.words() + byte_of(cluster.offsets, PreparedCluster::kSteps) - 2;
  const ClusterPrediction prediction(cluster.predicted_axis(), words);
  const ClusterItem item = frame.list.items[cluster.item];
  const ClusterDraw& draw = frame.list.draws[item.draw];
  const format::ClusterBounds bounds = load_bounds(draw.cluster_bounds() + item.cluster);
  const CoverageFilter filter = draw.filter;
#pragma unroll 1
  for (uint32_t vertex = lane; vertex < vertex_count; vertex += kWarpLanes) {
    const uint32_t bit = vertex * stride;
    const uint32_t* const from = positions + (bit >> 5);
    const uint32_t low = __funnelshift_r(from[0], from[1], bit);
    const uint64_t window = (uint64_t{__funnelshift_r(from[1], from[2], bit)} << 32) | low;
    uint32_t code[3] = {low & mask[0], static_cast<uint32_t>(window >> bits_x) & mask[1],
                        static_cast<uint32_t>(window >> bits_xy) & mask[2]};
    if (stride > 64) code[2] = unpack_bits(positions, bit + bits_xy, stride - bits_xy);  // past the window
    prediction.apply(code);
    const FilteredVertex filtered =
        filter_vertex<kOrthographic>(filter, static_cast<float>(format::bounds_min(bounds, 0) + code[0]),
                                     static_cast<float>(format::bounds_min(bounds, 1) + code[1]),
                                     static_cast<float>(format::bounds_min(bounds, 2) + code[2]));
    shared.centers[vertex] = vertex_centers<kOrthographic>(filter, all, filtered);
    if constexpr (kDropsHidden) shared.nearest_w[vertex] = filtered.w - w_error<false>(filter);
  }
}

/// The box of a survivor, as far as drop_hidden() tests it: boxes of up to four samples. In the highest 4 bits of
/// SurvivorTriangle::corners.
struct HiddenBox {
  uint32_t right;  // number of samples to the right of the first one
  uint32_t down;   // and below it

  static constexpr uint32_t kShift = 28;
  static constexpr uint32_t kUntested = 15;

  /// `extent`: last pixel centre minus first one, packed; not negative.
  __device__ static uint32_t pack(uint32_t extent) {
    const uint32_t right = extent & 0xffffu;
    const uint32_t down = extent >> 16;
    const bool tested = (right | down) < 4 && (right == 0 || down == 0 || extent == 0x10001u);
    return (tested ? right | down << 2 : kUntested) << kShift;
  }
  __device__ explicit HiddenBox(uint32_t corners) : right(corners >> kShift & 3), down(corners >> kShift >> 2) {}

  __device__ bool is_tested() const { return (right & down) != 3; }
  /// The farthest sample of the box, whose first one is `first`. `row`: samples per row.
  __device__ uint64_t farthest(const uint64_t* first, uint32_t row) const {
    const bool square = right != 0 && down != 0;
    const uint32_t last = right + down;
    const uint32_t step = right != 0 ? 1 : row;
    const uint64_t a = WarpTeam::load_relaxed(first);
    const uint64_t b = last > 0 ? WarpTeam::load_relaxed(first + step) : 0;
    const uint64_t c = last > 1 ? WarpTeam::load_relaxed(first + (square ? row : 2 * step)) : 0;
    const uint64_t d = last > 2 || square ? WarpTeam::load_relaxed(first + (square ? row + 1 : 3 * step)) : 0;
    return max_of(max_of(a, b), max_of(c, d));
  }
};

/// Appends to the survivors the triangles of a staged cluster that may cover a pixel centre. Returns the number of
/// survivors. `kAffine`: tests by shared.screen_places, otherwise by shared.centers. Without kAffine it takes only part
/// `part` of `parts`: every parts-th row of 32 triangles. `kBytes`: the cluster's steps have one bit and its distances
/// 4 bits, so the two distances of a triangle are one byte. `kDropsHidden`: stores the data that drop_hidden() needs.
/// The loop is not unrolled: the code that runs nearly fills a multiprocessor's instruction cache.
template <bool kAffine, bool kBytes, bool kDropsHidden>
__device__ inline uint32_t filter_triangles(const PreparedCluster& cluster, const ClusterStage& stage,
                                            uint32_t survivor_count, uint32_t part, uint32_t parts) {
  ClusterShared& shared = cluster_shared();
  const uint32_t lane = threadIdx.x % kWarpLanes;
  const uint32_t before_lane = (1u << lane) - 1;
  const uint32_t up_to_lane = 2 * before_lane + 1;
  const uint32_t last_triangle = byte_of(cluster.shape, PreparedCluster::kLastTriangle);
  const uint32_t distance_bits = kBytes ? 4 : byte_of(cluster.shape, PreparedCluster::kDistanceBits);
  const uint32_t mask = (1u << distance_bits) - 1;
  const uint32_t rounds = last_triangle / kWarpLanes + 1;
  const bool wide_steps = !kBytes && (cluster.offsets & PreparedCluster::kWideSteps) != 0;
  const uint32_t item = cluster.item;
  const uint32_t twice_slack = cluster.projection.twice_slack;
  const uint32_t fraction = cluster.projection.fraction;
  const uint32_t* steps = stage.words() + byte_of(cluster.offsets, PreparedCluster::kSteps);
  const uint32_t* distances = stage.words() + byte_of(cluster.offsets, PreparedCluster::kDistances);
  const auto* const bytes = reinterpret_cast<const uint8_t*>(distances);
  // As with vertices, each lane's distances begin at the same bit of a word.
  const uint32_t bit = lane * 2 * distance_bits;
  distances += bit >> 5;
  [[maybe_unused]] const uint32_t first_survivor = survivor_count;
  uint32_t largest = 2;  // vertex of the triangles before
#pragma unroll 1
  for (uint32_t triangle = lane; triangle < rounds * kWarpLanes;
       triangle += kWarpLanes, ++steps, distances += 2 * distance_bits) {
    const uint32_t low = steps[0];
    uint32_t a = largest + static_cast<uint32_t>(__popc(low & up_to_lane));
    largest += static_cast<uint32_t>(__popc(low));
    if (wide_steps) {
      const uint32_t high = steps[rounds];
      a += 2 * static_cast<uint32_t>(__popc(high & up_to_lane));
      largest += 2 * static_cast<uint32_t>(__popc(high));
    }
    if (!kAffine && parts != 1 && triangle / kWarpLanes % parts != part) continue;
    // Lanes past the last triangle read the words that follow it. With code 0 all their corners are the last vertex.
    uint32_t code = kBytes ? bytes[triangle] : __funnelshift_r(distances[0], distances[1], bit);
    bool survives = triangle <= last_triangle;
    [[maybe_unused]] uint32_t first_center = 0;
    [[maybe_unused]] uint32_t shape = 0;
    if (!survives) code = 0;
    const uint32_t b = a - (code & mask);
    const uint32_t c = a - (code >> distance_bits & mask);
    if constexpr (kAffine) {
      const uint32_t largest_place =
          __vimax3_u16x2(shared.screen_places[a], shared.screen_places[b], shared.screen_places[c]);
      const uint32_t smallest_place =
          __vimin3_u16x2(shared.screen_places[a], shared.screen_places[b], shared.screen_places[c]);
      survives = survives & AffineProjection::may_cover(largest_place, smallest_place, twice_slack, fraction);
    } else {
      const uint2 first = shared.centers[a];
      const uint2 second = shared.centers[b];
      const uint2 third = shared.centers[c];
      const uint32_t from = __vimin3_s16x2(first.x, second.x, third.x);
      const uint32_t to = __vimax3_s16x2(first.y, second.y, third.y);
      survives = survives & (__vmaxs2(from, to) == to);
      if constexpr (kDropsHidden) {
        first_center = from;
        shape = HiddenBox::pack(__vsub2(to, from));
      }
    }
    const uint32_t lanes = __ballot_sync(~0u, survives);
    if (lanes == 0) continue;
    if (survives) {
      const uint32_t at = survivor_count + static_cast<uint32_t>(__popc(lanes & before_lane));
      shared.survivors[at] = {item, triangle | a << 7 | b << 14 | c << 21 | shape};
      if constexpr (kDropsHidden) {
        shared.first_center[at - first_survivor] = first_center;
        shared.triangle_w[at - first_survivor] =
            fast_min(fast_min(shared.nearest_w[a], shared.nearest_w[b]), shared.nearest_w[c]);
      }
    }
    survivor_count += static_cast<uint32_t>(__popc(lanes));
  }
  return survivor_count;
}

/// Drops the survivors [first, end), all of one cluster, that are behind the picture as it is now. Returns the new end.
/// Boxes and depths are bounds, so this does not change the picture.
__device__ inline uint32_t drop_hidden(const SmallFrame& frame, uint32_t first, uint32_t end) {
  ClusterShared& shared = cluster_shared();
  const uint32_t lane = threadIdx.x % kWarpLanes;
  uint32_t kept = first;
#pragma unroll 1
  for (uint32_t i = first + lane; i - lane < end; i += kWarpLanes) {
    bool shows = i < end;
    SurvivorTriangle survivor{};
    if (shows) {
      survivor = shared.survivors[i];
      const HiddenBox box(survivor.corners);
      const float w = shared.triangle_w[i - first];
      if (box.is_tested() && w > 1.0f) {
        const uint32_t place = shared.first_center[i - first];
        const int32_t x = frame.view.width / 2 + static_cast<int16_t>(place);
        const int32_t y = frame.view.height / 2 + (static_cast<int32_t>(place) >> 16);
        const uint64_t farthest = box.farthest(frame.target.row(y) + x, static_cast<uint32_t>(frame.target.width));
        shows = nearest_code<false>(filter_reciprocal(w)) <= sample_depth_code(farthest);
      }
    }
    const uint32_t lanes = __ballot_sync(~0u, shows);
    if (shows) shared.survivors[kept + rank_among(lanes)] = survivor;
    kept += static_cast<uint32_t>(__popc(lanes));
    __syncwarp();
  }
  return kept;
}

}  // namespace scree::kernels
