// Stage 1 of clusters on a GPU: one warp per cluster. The cluster's affine projection (affine_projection.h) gives the
// place of each vertex on the screen. If the cluster has none, the filter (coverage_filter.h) gives the pixel centres
// before and after each vertex. A triangle is tested by the results of its three corners. The few triangles that may
// cover a centre wait, whatever their cluster, until there are 32. They are then projected and drawn exactly, like the
// triangles of indexed chunks.
//
// Up to 16 clusters are prepared at once. The next cluster's data are copied to shared memory while one is filtered.
// Triangles that need clipping go to a queue of their own: a call for them inside the loop would force the loop's
// values into memory.
#pragma once

#include <cuda_pipeline_primitives.h>

#include "kernels/cuda/cluster_run.cuh"
#include "kernels/cuda/small.cuh"
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
__device__ inline uint2 vertex_centers(const CoverageFilter& filter, const PackedRange& all, float x, float y,
                                       float z) {
  const FilteredVertex vertex = filter_vertex<kOrthographic>(filter, x, y, z);
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
template <bool kOrthographic>
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
    shared.centers[vertex] =
        vertex_centers<kOrthographic>(filter, all, static_cast<float>(format::bounds_min(bounds, 0) + code[0]),
                                      static_cast<float>(format::bounds_min(bounds, 1) + code[1]),
                                      static_cast<float>(format::bounds_min(bounds, 2) + code[2]));
  }
}

/// Appends to the survivors the triangles of a staged cluster that may cover a pixel centre. Returns the number of
/// survivors. `kAffine`: tests by shared.screen_places, otherwise by shared.centers. Without kAffine it takes only part
/// `part` of `parts`: every parts-th row of 32 triangles. `kBytes`: the cluster's steps have one bit and its distances
/// 4 bits, so the two distances of a triangle are one byte. The loop is not unrolled: the code that runs nearly fills a
/// multiprocessor's instruction cache.
template <bool kAffine, bool kBytes>
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
    }
    const uint32_t lanes = __ballot_sync(~0u, survives);
    if (lanes == 0) continue;
    if (survives) {
      shared.survivors[survivor_count + static_cast<uint32_t>(__popc(lanes & before_lane))] = {
          item, triangle | a << 7 | b << 14 | c << 21};
    }
    survivor_count += static_cast<uint32_t>(__popc(lanes));
  }
  return survivor_count;
}

/// A survivor that is about to be drawn: its cluster, and the data by which its corners are read.
struct SurvivorReader {
  const ClusterDraw& draw;
  uint32_t number;        // of the triangle in its chunk
  uint32_t first_vertex;  // of the cluster in its chunk
  uint32_t corners;
  format::ClusterLayout at;
  format::ClusterBounds bounds;
  const uint32_t* data;
  ClusterPrediction prediction;

  __device__ SurvivorReader(const ClusterFrame& frame, const SurvivorTriangle& survivor)
      : SurvivorReader(frame, survivor, frame.list.items[survivor.item]) {}

  /// The vertex number, in the cluster, of corner 0 to 2.
  __device__ uint32_t corner(uint32_t number_of_corner) const { return corners >> (7 * (number_of_corner + 1)) & 127; }

  /// Lattice coordinates of corner 0 to 2 minus the transform's reference. Requires a draw without
  /// ClusterDraw::kFarAway.
  __device__ void relative(uint32_t number_of_corner, int32_t out[3]) const {
    const uint32_t stride = at.position_bits[0] + at.position_bits[1] + at.position_bits[2];
    uint64_t bit = uint64_t{corner(number_of_corner)} * stride;
    uint32_t code[3];
    for (int k = 0; k < 3; ++k) {
      code[k] = unpack_bits(data + at.positions, bit, at.position_bits[k]);
      bit += at.position_bits[k];
    }
    prediction.apply(code);
    for (int k = 0; k < 3; ++k) out[k] = draw.base[k] + static_cast<int32_t>(format::bounds_min(bounds, k) + code[k]);
  }

  template <bool kOrthographic>
  __device__ ProjectedPoint project(const int32_t position[3]) const {
    return project_point<kOrthographic>(draw.x, draw.y, draw.w, static_cast<float>(position[0]),
                                        static_cast<float>(position[1]), static_cast<float>(position[2]));
  }

  /// kernels::set_up() of the triangle with these corners.
  __device__ bool set_up(const FrameView& view, const ScreenVertex& a, const ScreenVertex& b, const ScreenVertex& c,
                         Triangle& triangle, PixelBox& box, int64_t& area) const {
    return kernels::set_up(view, a, b, c, draw.first_id + number, (draw.flags & ClusterDraw::kMirrored) != 0,
                           (draw.flags & ClusterDraw::kDoubleSided) != 0, triangle, box, area);
  }

 private:
  __device__ SurvivorReader(const ClusterFrame& frame, const SurvivorTriangle& survivor, const ClusterItem& item)
      : SurvivorReader(frame.list.draws[item.draw], survivor, item.cluster,
                       __ldg(reinterpret_cast<const uint4*>(frame.list.draws[item.draw].clusters() + item.cluster))) {}
  __device__ SurvivorReader(const ClusterDraw& of, const SurvivorTriangle& survivor, uint32_t cluster,
                            const uint4& record)
      : draw(of),
        number(record.y + (survivor.corners & 127)),
        first_vertex(record.z),
        corners(survivor.corners),
        at(format::cluster_layout({record.x, record.y, record.z, record.w})),
        bounds(load_bounds(of.cluster_bounds() + cluster)),
        data(of.data()),
        prediction(at.predicted_axis, data + at.prediction) {}
};

/// Makes the planes of survivors.
struct ClusterPlanes {
  using Key = SurvivorTriangle;
  const ClusterFrame* frame;

  __device__ const FrameView& frame_view() const { return frame->small.view; }

  template <bool kOrthographic>
  __device__ void make(const SurvivorTriangle& survivor, MaskPlane& out) const {
    const SceneView& scene = frame->small.scene;
    const SurvivorReader reader(*frame, survivor);
    const format::ChunkRecord& chunk = scene.chunks[reader.draw.chunk];
    const format::MeshRecord& mesh = scene.meshes[chunk.mesh];
    const MaskView* const mask = mask_of(scene, mesh);
    if (mask == nullptr) return;
    // The streams follow each other as in format::chunk_streams().
    const std::byte* const uvs =
        reinterpret_cast<const std::byte*>(reader.data) + format::packed_bytes(chunk.cluster_words, 32);
    const std::byte* colors = nullptr;
    if (masks_by_colors(scene, mesh))
      colors = uvs + format::packed_bytes(chunk.vertex_count, uint32_t{chunk.uv_bits[0]} + chunk.uv_bits[1]);
    MaskCorner<int32_t> corners[3];
    for (uint32_t n = 0; n < 3; ++n) {
      corners[n].vertex = reader.first_vertex + reader.corner(n);
      reader.relative(n, corners[n].relative);
    }
    make_mask_plane<kOrthographic>(mask, frame->small.view, frame->small.list.transforms[reader.draw.instance],
                                   MaskVertices(chunk, uvs, colors), corners, out);
  }
};

using ClusterWaiting = WaitingSamples<SurvivorTriangle>;

/// This warp's memory for masks, in kernels that draw masked triangles. It lies behind the ClusterShared of all warps.
__device__ inline ClusterWaiting& cluster_masks() {
  extern __shared__ uint4 shared_memory[];
  return reinterpret_cast<ClusterWaiting*>(reinterpret_cast<ClusterShared*>(shared_memory) +
                                           kClusterWarps)[threadIdx.x / kWarpLanes];
}

/// This warp's memory for masks in kernels whose shared memory is static; null if they draw only opaque triangles.
template <Alpha kAlpha>
__device__ inline ClusterWaiting* block_masks() {
  if constexpr (kAlpha != Alpha::kOpaque) {
    __shared__ ClusterWaiting masks[kClusterWarps];
    return masks + threadIdx.x / kWarpLanes;
  } else {
    return nullptr;
  }
}

/// The tests of the lane's triangle. `masks()`: returns the warp's shared memory for masks; called only if kAlpha is
/// not kOpaque.
template <Alpha kAlpha, class Masks>
__device__ inline auto lane_mask(const ClusterFrame& frame, const Masks& masks) {
  if constexpr (kAlpha != Alpha::kOpaque) {
    return LaneMask<ClusterPlanes, kAlpha == Alpha::kBlended>(masks(), ClusterPlanes{&frame});
  } else {
    return NoLaneMask{};
  }
}

/// LaneMask::find() of a survivor.
template <class Mask>
__device__ inline uint32_t find_mask(Mask& mask, const ClusterFrame& frame, const SurvivorTriangle& survivor) {
  return mask.find(frame.small.scene, frame.list.draws[frame.list.items[survivor.item].draw].chunk, survivor);
}

/// Projects a survivor. Returns false if there is nothing to draw, or if it was queued to be clipped.
template <bool kOrthographic>
__device__ inline bool project_cluster_survivor(const ClusterFrame& frame, const SurvivorTriangle& survivor,
                                                Triangle& triangle, PixelBox& box, int64_t& area) {
  const FrameView& view = frame.small.view;
  const SurvivorReader reader(frame, survivor);
  const ClusterDraw& draw = reader.draw;
  ProjectedPoint points[3];
  for (uint32_t i = 0; i < 3; ++i) {  // reading all corners first would take more registers
    int32_t position[3];
    reader.relative(i, position);
    points[i] = reader.project<kOrthographic>(position);
  }
  const bool in_range = points[0].in_range & points[1].in_range & points[2].in_range;
  const bool far_away = (draw.flags & ClusterDraw::kFarAway) != 0;
  if (!in_range || far_away) {
    uint32_t outside = far_away ? 0u : uint32_t{kOutsideMask};
    for (int i = 0; i < 3; ++i) {
      outside &= plane_flags<kOrthographic>(points[i], view, draw.error[0], draw.error[1], draw.error[2]);
    }
    if (outside == 0)
      push(WarpTeam{}, &frame.small.list.counters->to_clip, frame.list.to_clip, frame.list.clip_capacity,
           ClipItem{survivor, draw.instance, draw.chunk, reader.number});
    return false;
  }
  return reader.set_up(view, snap_point(points[0], view, 0), snap_point(points[1], view, 0),
                       snap_point(points[2], view, 0), triangle, box, area);
}

/// One warp's work on the clusters to be drawn. `kParts`: the most warps that share a cluster if clusters are few. With
/// many clusters 1 is 2% faster, because it leaves out the code for parts. `kLateCull`: if a pass has many clusters in
/// comparison with pass 1, as after a jump of the camera, each run of clusters is tested against the current picture
/// just before it is drawn. It requires kParts == 1.
template <bool kOrthographic, uint32_t kParts, bool kLateCull, Alpha kAlpha>
class ClusterWarp {
  static_assert(!kLateCull || kParts == 1);

 public:
  __device__ explicit ClusterWarp(const ClusterFrame& frame) : frame_(frame), lane_(threadIdx.x % kWarpLanes) {}

  __device__ void run() {
    FrameCounters& counters = *frame_.small.list.counters;
    const uint64_t first = clusters_before(counters, frame_.pass);
    const uint64_t capacity = frame_.list.item_capacity;
    const uint64_t total = min_of(first + counters.clusters[frame_.pass], capacity) - min_of(first, capacity);
    if (total == 0) return;
    // Several warps share a cluster if a warp then draws at most 2.5 parts on average.
    if constexpr (kParts != 1) parts_ = 2 * total * kParts <= 5 * uint64_t{gridDim.x} * kClusterWarps ? kParts : 1;
    auto mask = lane_mask<kAlpha>(frame_, cluster_masks);
    if constexpr (kAlpha != Alpha::kOpaque) mask.begin(cluster_masks());
    ClusterShared& shared = cluster_shared();
    if (lane_ == 0) shared.end = total * parts();
    if (kLateCull && lane_ == 0) {
      shared.culls_late = counters.clusters[frame_.pass] > counters.clusters[0] / kLateCullShare ? 1 : 0;
      shared.culled_late = 0;
    }
    __syncwarp();
    take_run(0, kFirstRun);
    for (;;) {
      __syncwarp();
      const uint64_t start = __shfl_sync(~0u, next_start_, 0);
      if (start >= shared.end) break;
      draw_run(first, start, static_cast<uint32_t>(min_of<uint64_t>(shared.run_share, shared.end - start)));
    }
    if (survivor_count_ != 0) flush_survivors();
    if constexpr (kAlpha != Alpha::kOpaque) mask.template finish<kOrthographic>(frame_.small.target);
    const uint64_t small = sum_of_lanes(small_);
    if (lane_ == 0 && small != 0) WarpTeam::add(&counters.queues.triangles_small, small);
    if (kLateCull && lane_ == 0 && shared.culled_late != 0)
      WarpTeam::add(&counters.clusters_culled_late, uint64_t{shared.culled_late});
  }

 private:
  // A pass is tested if it has more than a quarter of pass 1's clusters. In smaller passes hardly any cluster is
  // hidden.
  static constexpr uint64_t kLateCullShare = 4;

  // A run takes at most 1/kRunsLeft of a warp's share of the remaining clusters, so that runs shrink towards the end.
  static constexpr uint32_t kRunsLeft = 6;
  // The most clusters of a warp's first run, and the number of flushes at which a later run aims, estimated from the
  // run before. In a close-up view a cluster may take four flushes of 16 us each, so a run of 16 clusters would keep
  // its warp busy for a millisecond.
  static constexpr uint32_t kFirstRun = 4;
  static constexpr uint32_t kRunFlushes = 8;

  /// Takes a run: consecutive clusters, or a part of one if warps share clusters. `taken_so_far`: the number of
  /// clusters that were taken before this warp's last run. `most`: of clusters in the run.
  __device__ void take_run(uint32_t taken_so_far, uint32_t most) {
    next_start_ = 0;
    if (lane_ != 0) return;
    ClusterShared& shared = cluster_shared();
    const uint32_t rest = static_cast<uint32_t>(shared.end) - taken_so_far;
    const uint32_t warps = gridDim.x * kClusterWarps;
    shared.run_share = min_of(max_of(rest / (kRunsLeft * warps), 1u), most);
    shared.run_flushes = 0;
    next_start_ = WarpTeam::add(&frame_.small.list.counters->next_cluster[frame_.pass], uint64_t{shared.run_share});
  }
  /// Takes the next run during the last cluster of the current one, so that the warp does not wait for the atomic's
  /// result. If it were taken earlier, its clusters would wait longer for this warp while other warps run out of work.
  __device__ void take_next_run() {
    const ClusterShared& shared = cluster_shared();
    const uint32_t flushes = max_of(shared.run_flushes, 1u);
    take_run(shared.run_start, min_of(max_of(kRunFlushes * shared.run_share / flushes, 1u), kRunClusters));
  }

  /// Draws `share` clusters, beginning with number `start` of the pass, and takes the next run. `first_of_pass`: the
  /// item of the pass's first cluster. If warps share clusters, a run is one part of a cluster.
  __device__ void draw_run(uint64_t first_of_pass, uint64_t start, uint32_t share) {
    ClusterShared& shared = cluster_shared();
    const auto first = static_cast<uint32_t>(first_of_pass + start / parts());
    const auto part = static_cast<uint32_t>(start % parts());
    if (lane_ == 0) shared.run_start = static_cast<uint32_t>(start);
    uint32_t count = share;
    if constexpr (kLateCull) count = cull_late(first, count);
    if (kLateCull && count == 0) {
      take_next_run();
      return;
    }
    prepare_run<kOrthographic, kLateCull>(frame_, first, count, parts() == 1 && frame_.small.filters);
    __syncwarp();
    StageCopy<> copy;
    stage_cluster(copy, shared.run[0], shared.stages[0]);
    copy.commit();
    for (uint32_t i = 0;; ++i) {
      const PreparedCluster& cluster = shared.run[i];
      const ClusterStage& stage = shared.stages[i % 2];
      const bool is_last = (cluster.offsets & PreparedCluster::kLast) != 0;
      if (!is_last) stage_cluster(copy, shared.run[i + 1], shared.stages[(i + 1) % 2]);
      copy.commit();
      if (is_last) take_next_run();
      copy.wait();
      __syncwarp();
      if (!kOrthographic && cluster.projection.twice_slack != 0) {
        if (byte_of(cluster.codes, PreparedCluster::kBitsXyz) <= 32) {
          project_vertices<false>(cluster, stage);
        } else {
          project_vertices<true>(cluster, stage);
        }
        __syncwarp();
        const bool is_narrow = (cluster.offsets & PreparedCluster::kWideSteps) == 0;
        survivor_count_ = is_narrow && byte_of(cluster.shape, PreparedCluster::kDistanceBits) == 4
                              ? filter_triangles<true, true>(cluster, stage, survivor_count_, 0, 1)
                              : filter_triangles<true, false>(cluster, stage, survivor_count_, 0, 1);
      } else {
        filter_vertices<kOrthographic>(frame_, cluster, stage);
        __syncwarp();
        survivor_count_ = filter_triangles<false, false>(cluster, stage, survivor_count_, part, parts());
      }
      __syncwarp();  // before set_up overwrites centers or screen_places
      // The survivors of a part of a cluster are drawn at once. Otherwise a warp would draw its last triangles by a
      // second copy of the code, which would not be in the instruction cache by then.
      while (survivor_count_ >= (parts() == 1 ? kWarpLanes : 1)) flush_survivors();
      if (is_last) break;
    }
    __syncwarp();
  }

  /// Lists in the run the items from `first` on that are drawn. Returns their number.
  __device__ uint32_t cull_late(uint32_t first, uint32_t count) {
    ClusterShared& shared = cluster_shared();
    uint32_t shown = count;
    if (shared.culls_late != 0) {
      shown = list_unoccluded<kOrthographic>(frame_, first, count);
      if (lane_ == 0) shared.culled_late += count - shown;
    } else if (lane_ < count) {
      shared.run[lane_].item = first + lane_;
    }
    __syncwarp();
    return shown;
  }

  /// Draws the last survivors, up to 32, one per lane.
  __device__ void flush_survivors() {
    ClusterShared& shared = cluster_shared();
    if (lane_ == 0) ++shared.run_flushes;
    const uint32_t count = min_of(survivor_count_, kWarpLanes);
    survivor_count_ -= count;
    Triangle triangle{};
    PixelBox box{};
    int64_t area = 0;
    int64_t pixels = 0;
    auto mask = lane_mask<kAlpha>(frame_, cluster_masks);
    if (lane_ < count && project_cluster_survivor<kOrthographic>(frame_, shared.survivors[survivor_count_ + lane_],
                                                                 triangle, box, area)) {
      pixels = box.pixels();
      if constexpr (kAlpha != Alpha::kOpaque)
        triangle.is_masked = find_mask(mask, frame_, shared.survivors[survivor_count_ + lane_]);
    }
    if (draw_set_up<kOrthographic>(frame_.small.target, frame_.small.queues, shared.set_up, triangle, box, area, pixels,
                                   mask)) {
      ++small_;
    }
    __syncwarp();
  }

  __device__ uint32_t parts() const { return kParts == 1 ? 1 : parts_; }

  const ClusterFrame& frame_;
  uint32_t lane_;
  uint32_t parts_ = 1;
  uint64_t next_start_ = 0;  // of the run that was taken last; only in lane 0
  uint32_t survivor_count_ = 0;
  uint32_t small_ = 0;
};

template <bool kOrthographic, uint32_t kParts, bool kLateCull, Alpha kAlpha>
__global__ void __launch_bounds__(kClusterThreads, kAlpha != Alpha::kOpaque ? kMaskedBlocks : kClusterBlocks)
    raster_clusters(const __grid_constant__ ClusterFrame frame) {
  ClusterWarp<kOrthographic, kParts, kLateCull, kAlpha>(frame).run();
}

inline constexpr uint32_t kNearClippedBlocks = 4;  // of a multiprocessor

/// Clips a triangle of a cluster at the near plane. Returns false if it needs other clipping, or if its reference is
/// too far away for int32.
__device__ inline bool clip_survivor_near(const ClusterFrame& frame, const SurvivorReader& reader, NearPolygon& out) {
  if ((reader.draw.flags & ClusterDraw::kFarAway) != 0) return false;
  const Transform& transform = frame.small.list.transforms[reader.draw.instance];
  ClipVertex corners[3];
  for (uint32_t i = 0; i < 3; ++i) {
    int32_t position[3];
    reader.relative(i, position);
    const double exact[3] = {static_cast<double>(position[0]), static_cast<double>(position[1]),
                             static_cast<double>(position[2])};
    corners[i] = clip_vertex(transform, exact, snap_point(reader.project<false>(position), frame.small.view, 0));
  }
  return clip_near(corners, frame.small.view, out);
}

/// Clips up to 32 triangles of clusters, one per lane, and draws their remaining pieces. Returns counts in the form of
/// clip_and_draw(). `masks`: null if all triangles are opaque.
template <Alpha kAlpha>
__device__ inline uint32_t draw_near_clipped(const ClusterFrame& frame, const ClipItem& item, bool has_one,
                                             SetUpTriangles& set_up, [[maybe_unused]] ClusterWaiting* masks) {
  const SurvivorReader reader(frame, item.survivor);
  NearPolygon polygon;
  uint32_t drawn = 0;
  if (has_one) {
    if (clip_survivor_near(frame, reader, polygon)) {
      drawn = 1u << 16;
    } else {
      polygon.count = 0;
      drawn = clip_and_draw<false, kAlpha>(frame.small, item.instance, item.chunk, item.triangle);
    }
  }
  auto mask = lane_mask<kAlpha>(frame, [&]() -> ClusterWaiting& { return *masks; });
  [[maybe_unused]] uint32_t is_masked = 0;
  if constexpr (kAlpha != Alpha::kOpaque) is_masked = find_mask(mask, frame, item.survivor);
    // A polygon of 4 corners is drawn as two triangles.
#pragma unroll 1
  for (int i = 2; i < 4; ++i) {
    Triangle triangle{};
    PixelBox box{};
    int64_t area = 0;
    int64_t pixels = 0;
    if (i < polygon.count &&
        reader.set_up(frame.small.view, polygon.corner[0], polygon.corner[1], polygon.corner[2], triangle, box, area))
      pixels = box.pixels();
    if constexpr (kAlpha != Alpha::kOpaque) triangle.is_masked = is_masked;
    if (draw_set_up<false>(frame.small.target, frame.small.queues, set_up, triangle, box, area, pixels, mask)) ++drawn;
    polygon.corner[1] = polygon.corner[2];
    polygon.corner[2] = polygon.corner[3];
  }
  return drawn;
}

/// Draws the triangles of clusters that need clipping, or whose reference is too far away for int32, one per thread.
/// Neighbours in the queue go to different warps, because hardly any two take the same branches.
template <bool kOrthographic, Alpha kAlpha>
__global__ void __launch_bounds__(kClusterThreads) raster_clipped(const __grid_constant__ ClusterFrame frame) {
  FrameCounters& counters = *frame.small.list.counters;
  const uint64_t count = min_of(counters.to_clip, frame.list.clip_capacity);
  const uint64_t threads = uint64_t{gridDim.x} * kClusterThreads;
  const uint64_t warp = uint64_t{blockIdx.x} * kClusterWarps + threadIdx.x / kWarpLanes;
  const uint64_t first = counters.to_clip_drawn + threadIdx.x % kWarpLanes * (threads / kWarpLanes) + warp;
  for (uint64_t i = first; i < count; i += threads) {
    const ClipItem item = frame.list.to_clip[i];
    const uint32_t drawn = clip_and_draw<kOrthographic, kAlpha>(frame.small, item.instance, item.chunk, item.triangle);
    WarpTeam::add(&counters.queues.triangles_small, drawn & 0xffffu);
    WarpTeam::add(&counters.queues.triangles_clipped, drawn >> 16);
  }
}

/// As above, for a perspective camera and many triangles. Neighbours in the queue go to one warp. Triangles that only
/// the near plane cuts are clipped in registers (clip_near).
template <Alpha kAlpha>
__global__ void __launch_bounds__(kClusterThreads, kNearClippedBlocks)
    raster_near_clipped(const __grid_constant__ ClusterFrame frame) {
  __shared__ SetUpTriangles set_up[kClusterWarps];
  FrameCounters& counters = *frame.small.list.counters;
  const uint64_t end = min_of(counters.to_clip, frame.list.clip_capacity);
  const uint64_t threads = uint64_t{gridDim.x} * kClusterThreads;
  const uint32_t lane = threadIdx.x % kWarpLanes;
  const uint32_t warp = threadIdx.x / kWarpLanes;
  ClusterWaiting* const masks = block_masks<kAlpha>();
  auto mask = lane_mask<kAlpha>(frame, [&]() -> ClusterWaiting& { return *masks; });
  if constexpr (kAlpha != Alpha::kOpaque) mask.begin(*masks);
  uint32_t small = 0;
  uint32_t clipped = 0;
  for (uint64_t first = counters.to_clip_drawn + uint64_t{blockIdx.x} * kClusterThreads + warp * kWarpLanes;
       first < end; first += threads) {
    const bool has_one = first + lane < end;
    const uint32_t drawn = draw_near_clipped<kAlpha>(frame, frame.list.to_clip[has_one ? first + lane : first], has_one,
                                                     set_up[warp], masks);
    small += drawn & 0xffffu;
    clipped += drawn >> 16;
  }
  if constexpr (kAlpha != Alpha::kOpaque) mask.template finish<false>(frame.small.target);
  small = sum_of_lanes(small);
  clipped = sum_of_lanes(clipped);
  if (lane != 0) return;
  if (small != 0) WarpTeam::add(&counters.queues.triangles_small, uint64_t{small});
  if (clipped != 0) WarpTeam::add(&counters.queues.triangles_clipped, uint64_t{clipped});
}

}  // namespace scree::kernels
