// Stage 1 of clusters on a GPU: a warp a cluster. The filter (sample_filter.h) takes each vertex once and says which
// pixel centres may lie to its left and right; a triangle then looks at three of those. The few that may cover a centre
// wait until 32 are there, from whatever clusters, and are projected and drawn exactly, as those of other chunks are.
//
// The next cluster's data are copied to shared memory while one is looked at. What needs clipping goes to a queue of
// its own: with a call in it, the loop would keep its values in memory.
#pragma once

#include <cuda_pipeline_primitives.h>

#include "kernels/cuda_cluster_cull.cuh"
#include "kernels/cuda_small.cuh"

namespace scree::kernels {

struct ClusterFrame {
  SmallFrame small;
  ClusterList list;
  uint32_t pass;  // of FrameCounters::clusters: the items of this pass
};

inline constexpr uint32_t kClusterThreads = 128;
inline constexpr uint32_t kClusterWarps = kClusterThreads / kWarpLanes;
inline constexpr uint32_t kClusterBlocks = 8;  // of a multiprocessor
inline constexpr uint32_t kClusterParts = 4;   // of a cluster, where there are few

/// 16-byte pieces of a cluster's data that are staged: more than almost any takes, and than its triangles alone ever
/// do.
inline constexpr uint32_t kStagePieces = 64;

/// A triangle that may cover a pixel centre.
struct WaitingTriangle {
  uint32_t item;     // of ClusterList::items
  uint32_t corners;  // numbers in the cluster, 7 bits each: the triangle's, and its corners'
};

/// A cluster of a run: what all lanes need of it.
struct alignas(16) StagedCluster {
  uint64_t data;    // address of its first word
  uint32_t layout;  // set_layout()
  uint32_t counts;  // of its record
  uint32_t min[3];  // of its bounds
  uint32_t draw;

  /// Word count, then from bit 16 on, 4, 7, 2 and 1 bits: distances, positions, predicted axis, wide steps.
  __device__ void set_layout(const format::ClusterLayout& at) {
    layout = (at.end - at.prediction) | (at.distances - at.prediction) << 16 | (at.positions - at.prediction) << 20 |
             at.predicted_axis << 27 | (at.wide_steps ? 1u << 29 : 0u);
  }
  // Places are words from `data`.
  __device__ uint32_t word_count() const { return layout & 0xffffu; }
  __device__ uint32_t distances() const { return layout >> 16 & 15; }
  __device__ uint32_t positions() const { return layout >> 20 & 127; }
  __device__ uint32_t predicted_axis() const { return layout >> 27 & 3; }
  __device__ uint32_t steps() const { return predicted_axis() != format::kNotPredicted ? 2 : 0; }
  __device__ bool wide_steps() const { return (layout >> 29 & 1) != 0; }
};

/// A cluster on its way through shared memory.
struct ClusterStage {
  StagedCluster cluster;
  SampleFilter filter;
  uint4 pieces[kStagePieces + 1];  // its data, from the multiple of 16 bytes before; a vertex is read as three words

  __device__ uint32_t skipped_words() const { return static_cast<uint32_t>(cluster.data >> 2 & 3); }
  __device__ const uint32_t* words() const { return reinterpret_cast<const uint32_t*>(pieces) + skipped_words(); }
};

/// A warp's shared memory.
struct ClusterShared {
  ClusterStage stages[2];
  WaitingTriangle waiting[kWarpLanes - 1 + format::kMaxClusterTriangles];
  union {
    // Of each vertex the first pixel centre at or after it and the last one at or before it, with the filter's slack;
    // two 16-bit numbers each. The smallest `first` and the largest `last` of three corners hold the triangle's
    // pixel_box().
    uint2 centers[format::kMaxClusterVertices];
    SetUpTriangles set_up;
  };

  __device__ ClusterShared() {}
};

/// This warp's, by its name: through a pointer the compiler would not know that it is shared memory.
__device__ inline ClusterShared& cluster_shared() {
  extern __shared__ uint4 shared_memory[];
  return reinterpret_cast<ClusterShared*>(shared_memory)[threadIdx.x / kWarpLanes];
}

/// format::ClusterPredictor with its axes sorted out once a cluster, not once a vertex: no branch is left in the loop.
struct ClusterPrediction {
  int32_t slope[3];  // of the predicted axis 0
  uint32_t bias;
  uint32_t axis;  // or kNotPredicted

  /// `words`: the two of the cluster's data, where an axis is predicted.
  __device__ ClusterPrediction(uint32_t predicted_axis, const uint32_t* words) : axis(predicted_axis) {
    slope[0] = slope[1] = slope[2] = 0;
    bias = 0;
    if (axis == format::kNotPredicted) return;
    const auto slopes = static_cast<int32_t>(words[0]);
    const int32_t u = static_cast<int16_t>(slopes);
    const int32_t v = slopes >> 16;
    slope[0] = axis == 0 ? 0 : axis == 1 ? v : u;
    slope[1] = axis == 0 ? u : axis == 1 ? 0 : v;
    slope[2] = axis == 0 ? v : axis == 1 ? u : 0;
    bias = words[1];
  }

  __device__ void apply(uint32_t code[3]) const {
    const int32_t sloped = slope[0] * static_cast<int32_t>(code[0]) + slope[1] * static_cast<int32_t>(code[1]) +
                           slope[2] * static_cast<int32_t>(code[2]);
    const uint32_t sum = bias + static_cast<uint32_t>(sloped >> format::kPredictorShift);
    for (uint32_t i = 0; i < 3; ++i) code[i] += axis == i ? sum : 0;
  }
};

/// What StagedCluster says of an item.
__device__ inline StagedCluster find_cluster(const ClusterList& list, uint64_t number) {
  const ClusterItem item = list.items[number];
  const ClusterDraw& draw = list.draws[item.draw];
  const uint4 record = __ldg(reinterpret_cast<const uint4*>(draw.clusters() + item.cluster));
  const format::ClusterLayout at = format::cluster_layout({record.x, record.y, record.z, record.w});
  const format::ClusterBounds bounds = load_bounds(draw.cluster_bounds() + item.cluster);
  StagedCluster out;
  out.data = reinterpret_cast<uint64_t>(draw.data() + at.prediction);
  out.set_layout(at);
  out.counts = record.w;
  for (int i = 0; i < 3; ++i) out.min[i] = format::bounds_min(bounds, i);
  out.draw = item.draw;
  return out;
}

/// Starts copying what a lane's cluster takes to `stage`.
__device__ inline void stage_cluster(const ClusterList& list, const StagedCluster& mine, uint32_t owner,
                                     ClusterStage& stage) {
  const uint32_t lane = threadIdx.x % kWarpLanes;
  if (lane == owner) stage.cluster = mine;
  __syncwarp();
  // The stream of clusters begins and ends on multiples of 16 bytes, so these pieces lie within it.
  const auto* const from = reinterpret_cast<const uint4*>(stage.cluster.data & ~uint64_t{15});
  const uint32_t words = stage.cluster.word_count() + stage.skipped_words();
  const uint32_t pieces = min_of((words + 3) / 4, kStagePieces);
  if (lane < pieces) __pipeline_memcpy_async(stage.pieces + lane, from + lane, sizeof(uint4));
  if (lane + kWarpLanes < pieces) {
    __pipeline_memcpy_async(stage.pieces + lane + kWarpLanes, from + lane + kWarpLanes, sizeof(uint4));
  }
  constexpr uint32_t kFilterPieces = sizeof(SampleFilter) / sizeof(uint4);
  if (lane < kFilterPieces) {
    __pipeline_memcpy_async(reinterpret_cast<uint4*>(&stage.filter) + lane,
                            reinterpret_cast<const uint4*>(&list.draws[stage.cluster.draw].filter) + lane,
                            sizeof(uint4));
  }
}
static_assert(kStagePieces == 2 * kWarpLanes);

/// Two whole numbers within +-2^15 as floats, as two 16-bit ones.
__device__ inline uint32_t pack_centers(float x, float y) {
  constexpr float kMagic = 12582912.0f;  // 1.5 * 2^23: a float of this size has the number in its lowest bits
  return __byte_perm(__float_as_uint(x + kMagic), __float_as_uint(y + kMagic), 0x5410);
}

/// Pixel centres of the image, packed: all there are.
struct PackedRange {
  uint32_t first;
  uint32_t last;
};

/// The filter's answer for a vertex, as ClusterShared::centers has it.
template <bool kOrthographic>
__device__ inline uint2 vertex_centers(const SampleFilter& filter, const PackedRange& all, float x, float y, float z) {
  const FilteredVertex vertex = filter_vertex<kOrthographic>(filter, x, y, z);
  float slack = filter.slack;
  if (kOrthographic || filter.growth != 0.0f) {
    // Near the guard band, or where the vertex may be clipped, the exact way decides.
    const float farthest = greatest(size_of(vertex.u), size_of(vertex.v));
    slack = fused(farthest, filter.growth, slack);
    bool held = !(farthest < 32700.0f) | !(slack < 16.0f) | !(vertex.w >= filter.w_lowest);
    if constexpr (kOrthographic) held = held | !(vertex.w <= filter.w_highest);
    if (held) return {all.first, all.last};
  }
  // Adding 1.5 * 2^23 rounds to nearest: half less, and half more, round down and up. A hundredth is given away, so
  // that ties do not matter.
  const float reach = slack - 0.49f;
  return {__vmaxs2(pack_centers(vertex.u - reach, vertex.v - reach), all.first),
          __vmins2(pack_centers(vertex.u + reach, vertex.v + reach), all.last)};
}

/// Projects the vertices of a staged cluster into shared.centers; `keeps_all`: every triangle is looked at exactly.
template <bool kOrthographic>
__device__ inline void filter_vertices(const ClusterStage& stage, const PackedRange& all, bool keeps_all) {
  ClusterShared& shared = cluster_shared();
  const uint32_t lane = threadIdx.x % kWarpLanes;
  const uint32_t counts = stage.cluster.counts;
  const uint32_t vertex_count = (counts >> 7 & 127) + 1;
  const uint32_t bits_x = counts >> 17 & 31;
  const uint32_t bits_y = counts >> 22 & 31;
  const uint32_t bits_z = counts >> 27;
  const uint32_t stride = bits_x + bits_y + bits_z;
  // So are those of a length that hardly any cluster has.
  if (keeps_all || stage.cluster.word_count() + stage.skipped_words() > 4 * kStagePieces) {
    for (uint32_t vertex = lane; vertex < vertex_count; vertex += kWarpLanes) {
      shared.centers[vertex] = {all.first, all.last};
    }
    return;
  }
  const uint32_t mask[3] = {(1u << bits_x) - 1, (1u << bits_y) - 1, (1u << bits_z) - 1};
  const uint32_t min[3] = {stage.cluster.min[0], stage.cluster.min[1], stage.cluster.min[2]};
  const ClusterPrediction prediction(stage.cluster.predicted_axis(), stage.words());
  const uint32_t* const positions = stage.words() + stage.cluster.positions();
  const SampleFilter filter = stage.filter;
#pragma unroll 1
  for (uint32_t vertex = lane; vertex < vertex_count; vertex += kWarpLanes) {
    const uint32_t bit = vertex * stride;
    const uint32_t* const from = positions + (bit >> 5);
    const uint32_t low = __funnelshift_r(from[0], from[1], bit);
    const uint64_t window = (uint64_t{__funnelshift_r(from[1], from[2], bit)} << 32) | low;
    uint32_t code[3] = {low & mask[0], static_cast<uint32_t>(window >> bits_x) & mask[1],
                        static_cast<uint32_t>(window >> (bits_x + bits_y)) & mask[2]};
    if (stride > 64) code[2] = unpack_bits(positions, bit + bits_x + bits_y, bits_z);  // past the window
    prediction.apply(code);
    shared.centers[vertex] =
        vertex_centers<kOrthographic>(filter, all, static_cast<float>(min[0] + code[0]),
                                      static_cast<float>(min[1] + code[1]), static_cast<float>(min[2] + code[2]));
  }
}

/// Appends the triangles of a staged cluster that may cover a pixel centre to those that wait; returns how many do. Of
/// `parts` parts it takes those of one: every parts-th 32.
__device__ inline uint32_t filter_triangles(const ClusterStage& stage, uint32_t item, uint32_t waiting, uint32_t part,
                                            uint32_t parts) {
  ClusterShared& shared = cluster_shared();
  const uint32_t lane = threadIdx.x % kWarpLanes;
  const uint32_t before_lane = (1u << lane) - 1;
  const uint32_t up_to_lane = 2 * before_lane + 1;
  const uint32_t counts = stage.cluster.counts;
  const uint32_t triangle_count = (counts & 127) + 1;
  const uint32_t distance_bits = counts >> 14 & 7;
  const uint32_t mask = (1u << distance_bits) - 1;
  const uint32_t rounds = (triangle_count + kWarpLanes - 1) / kWarpLanes;
  const uint32_t* const words = stage.words();
  const uint32_t* const steps = words + stage.cluster.steps();
  const bool wide_steps = stage.cluster.wide_steps();
  const uint32_t* const distances = words + stage.cluster.distances();
  uint32_t largest = 2;  // vertex of the triangles before
#pragma unroll 2
  for (uint32_t round = 0; round < rounds; ++round) {
    const uint32_t low = steps[round];
    const uint32_t high = wide_steps ? steps[rounds + round] : 0;
    const uint32_t triangle = round * kWarpLanes + lane;
    const uint32_t bit = triangle * 2 * distance_bits;
    // Lanes past the last triangle read what follows it, and then look at the last.
    uint32_t code = __funnelshift_r(distances[bit >> 5], distances[(bit >> 5) + 1], bit);
    if (triangle >= triangle_count) code = 0;
    const uint32_t a = largest + static_cast<uint32_t>(__popc(low & up_to_lane) + 2 * __popc(high & up_to_lane));
    largest += static_cast<uint32_t>(__popc(low) + 2 * __popc(high));
    if (parts != 1 && round % parts != part) continue;
    const uint32_t b = a - (code & mask);
    const uint32_t c = a - (code >> distance_bits & mask);
    const uint2 first = shared.centers[a];
    const uint2 second = shared.centers[b];
    const uint2 third = shared.centers[c];
    const uint32_t from = __vimin3_s16x2(first.x, second.x, third.x);
    const uint32_t to = __vimax3_s16x2(first.y, second.y, third.y);
    const bool survives = (triangle < triangle_count) & (__vmaxs2(from, to) == to);
    const uint32_t lanes = __ballot_sync(~0u, survives);
    if (lanes == 0) continue;
    if (survives) {
      shared.waiting[waiting + static_cast<uint32_t>(__popc(lanes & before_lane))] = {
          item, triangle | a << 7 | b << 14 | c << 21};
    }
    waiting += static_cast<uint32_t>(__popc(lanes));
  }
  return waiting;
}

/// Projects a triangle that waits. False where there is nothing to draw, or it was queued to be clipped.
template <bool kOrthographic>
__device__ inline bool project_waiting(const ClusterFrame& frame, const WaitingTriangle& waiting, Triangle& triangle,
                                       PixelBox& box, int64_t& area) {
  const FrameView& view = frame.small.view;
  const ClusterItem item = frame.list.items[waiting.item];
  const ClusterDraw& draw = frame.list.draws[item.draw];
  const uint4 record = __ldg(reinterpret_cast<const uint4*>(draw.clusters() + item.cluster));
  const format::ClusterLayout at = format::cluster_layout({record.x, record.y, record.z, record.w});
  const format::ClusterBounds bounds = load_bounds(draw.cluster_bounds() + item.cluster);
  const uint32_t* const data = draw.data();
  const ClusterPrediction prediction(at.predicted_axis, data + at.prediction);
  const uint32_t stride = at.position_bits[0] + at.position_bits[1] + at.position_bits[2];
  const uint32_t number = record.y + (waiting.corners & 127);
  ProjectedPoint points[3];
  for (int i = 0; i < 3; ++i) {
    uint64_t bit = uint64_t{waiting.corners >> (7 * (i + 1)) & 127} * stride;
    uint32_t code[3];
    for (int k = 0; k < 3; ++k) {
      code[k] = unpack_bits(data + at.positions, bit, at.position_bits[k]);
      bit += at.position_bits[k];
    }
    prediction.apply(code);
    float d[3];
    for (int k = 0; k < 3; ++k) {
      d[k] = static_cast<float>(draw.base[k] + static_cast<int32_t>(format::bounds_min(bounds, k) + code[k]));
    }
    points[i] = project_point<kOrthographic>(draw.x, draw.y, draw.w, d[0], d[1], d[2]);
  }
  const bool in_range = points[0].in_range & points[1].in_range & points[2].in_range;
  const bool far_away = (draw.flags & ClusterDraw::kFarAway) != 0;
  if (!in_range || far_away) {
    uint32_t outside = far_away ? 0u : uint32_t{kOutsideMask};
    for (int i = 0; i < 3; ++i) {
      outside &= plane_flags<kOrthographic>(points[i], view, draw.error[0], draw.error[1], draw.error[2]);
    }
    if (outside == 0) {
      push(WarpTeam{}, &frame.small.list.counters->to_clip, frame.list.to_clip, frame.list.clip_capacity,
           ClipItem{draw.instance, draw.chunk, number});
    }
    return false;
  }
  return set_up(view, snap_point(points[0], view, 0), snap_point(points[1], view, 0), snap_point(points[2], view, 0),
                draw.first_id + number, (draw.flags & ClusterDraw::kMirrored) != 0,
                (draw.flags & ClusterDraw::kDoubleSided) != 0, triangle, box, area);
}

/// One warp's way through the clusters to be drawn.
template <bool kOrthographic>
class ClusterWarp {
 public:
  __device__ explicit ClusterWarp(const ClusterFrame& frame) : frame_(frame), lane_(threadIdx.x % kWarpLanes) {}

  __device__ void run() {
    FrameCounters& counters = *frame_.small.list.counters;
    const uint64_t first = clusters_before(counters, frame_.pass);
    const uint64_t capacity = frame_.list.item_capacity;
    const uint64_t total = min_of(first + counters.clusters[frame_.pass], capacity) - min_of(first, capacity);
    if (total == 0) return;
    const uint64_t warps = uint64_t{gridDim.x} * kClusterWarps;
    // Where there are fewer clusters than warps, several share one.
    parts_ = total * kClusterParts <= warps * 2 ? kClusterParts : 1;
    for (;;) {
      // A part of what each warp would get of the rest, and one at the end.
      uint64_t start = 0;
      uint64_t share = 0;
      if (lane_ == 0) {
        const uint64_t given = *static_cast<const volatile uint64_t*>(&counters.next_cluster[frame_.pass]);
        share = min_of<uint64_t>(max_of<uint64_t>((total * parts_ - min_of(given, total * parts_)) / (4 * warps), 1),
                                 kWarpLanes);
        start = WarpTeam::add(&counters.next_cluster[frame_.pass], share);
      }
      start = __shfl_sync(~0u, start, 0);
      share = __shfl_sync(~0u, share, 0);
      if (start >= total * parts_) break;
      draw_run(static_cast<uint32_t>(first + start / parts_),
               static_cast<uint32_t>(min_of(share, total * parts_ - start)), static_cast<uint32_t>(start % parts_));
    }
    if (waiting_ != 0) draw_waiting(0, waiting_);
    const uint64_t small = __reduce_add_sync(~0u, small_);
    if (lane_ == 0 && small != 0) WarpTeam::add(&counters.queues.triangles_small, small);
  }

 private:
  /// Clusters `first` and on; where they are shared, one of them, and only a `part` of its triangles.
  __device__ void draw_run(uint32_t first, uint32_t count, uint32_t part) {
    ClusterShared& shared = cluster_shared();
    const StagedCluster mine = find_cluster(frame_.list, first + min_of(lane_, count - 1));
    const CenterRange range = center_range(frame_.small.view);
    const PackedRange all{pack_centers(range.first[0], range.first[1]), pack_centers(range.last[0], range.last[1])};
    stage_cluster(frame_.list, mine, 0, shared.stages[0]);
    __pipeline_commit();
    for (uint32_t i = 0; i < count; ++i) {
      if (i + 1 < count) stage_cluster(frame_.list, mine, i + 1, shared.stages[(i + 1) % 2]);
      __pipeline_commit();
      __pipeline_wait_prior(1);
      __syncwarp();
      const ClusterStage& stage = shared.stages[i % 2];
      filter_vertices<kOrthographic>(stage, all, !frame_.small.filters);
      __syncwarp();
      waiting_ = filter_triangles(stage, first + i, waiting_, part, parts_);
      __syncwarp();
      for (; waiting_ >= kWarpLanes; waiting_ -= kWarpLanes) draw_waiting(waiting_ - kWarpLanes, kWarpLanes);
    }
  }

  /// Draws `count` (up to 32) that wait, a lane each.
  __device__ void draw_waiting(uint32_t first, uint32_t count) {
    ClusterShared& shared = cluster_shared();
    Triangle triangle{};
    PixelBox box{};
    int64_t area = 0;
    int64_t pixels = 0;
    if (lane_ < count && project_waiting<kOrthographic>(frame_, shared.waiting[first + lane_], triangle, box, area)) {
      pixels = box.pixels();
    }
    if (draw_set_up<kOrthographic>(frame_.small.target, frame_.small.queues, shared.set_up, triangle, box, area,
                                   pixels)) {
      ++small_;
    }
    __syncwarp();
  }

  const ClusterFrame& frame_;
  uint32_t lane_;
  uint32_t parts_ = 1;
  uint32_t waiting_ = 0;
  uint32_t small_ = 0;
};

template <bool kOrthographic>
__global__ void __launch_bounds__(kClusterThreads, kClusterBlocks)
    raster_clusters(const __grid_constant__ ClusterFrame frame) {
  ClusterWarp<kOrthographic>(frame).run();
}

/// Draws the triangles of clusters that need clipping, or whose reference is too far away for int32; a thread each.
template <bool kOrthographic>
__global__ void __launch_bounds__(kClusterThreads) raster_clipped(const __grid_constant__ ClusterFrame frame) {
  FrameCounters& counters = *frame.small.list.counters;
  const uint64_t count = min_of(counters.to_clip, frame.list.clip_capacity);
  const uint64_t first = counters.to_clip_drawn + uint64_t{blockIdx.x} * blockDim.x + threadIdx.x;
  for (uint64_t i = first; i < count; i += uint64_t{gridDim.x} * blockDim.x) {
    const ClipItem item = frame.list.to_clip[i];
    const uint32_t drawn = draw_the_long_way<kOrthographic>(frame.small, item.instance, item.chunk, item.triangle);
    WarpTeam::add(&counters.queues.triangles_small, drawn & 0xffffu);
    WarpTeam::add(&counters.queues.triangles_clipped, drawn >> 16);
  }
}

}  // namespace scree::kernels
