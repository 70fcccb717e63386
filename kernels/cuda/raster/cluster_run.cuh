// Runs of clusters on a GPU before they are drawn (cluster.cuh): a warp's shared memory, late culling, and the data
// that all lanes need of each cluster.
#pragma once

#include "kernels/cuda/cull/cluster_cull.cuh"
#include "kernels/cuda/raster/small.cuh"
#include "kernels/cull/affine_projection.h"

namespace scree::kernels {

struct ClusterFrame {
  SmallFrame small;
  ClusterList list;
  uint32_t pass;  // index in FrameCounters::clusters: the items of this pass
};

inline constexpr uint32_t kClusterThreads = 128;
inline constexpr uint32_t kClusterWarps = kClusterThreads / kWarpLanes;
inline constexpr uint32_t kClusterParts = 4;  // per cluster, if there are few clusters

/// Size of the staging buffer in pieces of 16 bytes. It holds the triangles of every cluster, and all data of almost
/// every one; PreparedCluster::kTruncated marks the others.
inline constexpr uint32_t kStagePieces = 64;

/// The most clusters that a warp takes at once. Two lanes prepare each.
inline constexpr uint32_t kRunClusters = 16;

/// Byte `i` of a word.
__device__ inline uint32_t byte_of(uint32_t word, uint32_t i) {
  return __byte_perm(word, 0, 0x4440 + i);
}

/// A cluster of a run: the data that all lanes need. Bytes share words, because a lane reads 64 bytes of shared memory
/// with four loads.
struct alignas(16) PreparedCluster {
  uint64_t data;  // address of its data, rounded down to a multiple of 16 bytes
  uint32_t shape;
  uint32_t offsets;
  AffineProjection projection;
  uint32_t codes;
  uint32_t item;  // index in ClusterList::items

  // Bytes of `shape`.
  static constexpr uint32_t kLastTriangle = 0;  // number of triangles minus one
  static constexpr uint32_t kLastVertex = 1;    // number of vertices minus one
  static constexpr uint32_t kDistanceBits = 2;
  static constexpr uint32_t kPieces = 3;  // to be staged
  // Bytes of `offsets`: the first word of each stream of the cluster, counted from `data`.
  static constexpr uint32_t kSteps = 0;
  static constexpr uint32_t kDistances = 1;
  static constexpr uint32_t kPositions = 2;
  // Bits of the last byte of `offsets`.
  static constexpr uint32_t kWideSteps = 1u << 24;
  static constexpr uint32_t kTruncated = 1u << 25;  // longer than a ClusterStage
  static constexpr uint32_t kLast = 1u << 26;       // last of the run
  static constexpr uint32_t kPredictedAxisShift = 27;
  // Bytes of `codes`: the bits of x, of x and y, and of all three.
  static constexpr uint32_t kBitsX = 0;
  static constexpr uint32_t kBitsXy = 1;
  static constexpr uint32_t kBitsXyz = 2;

  __device__ uint32_t predicted_axis() const { return offsets >> kPredictedAxisShift; }
};
static_assert(sizeof(PreparedCluster) == 64);

/// A cluster's staged data. A vertex is read as three words.
struct ClusterStage {
  uint4 pieces[kStagePieces + 1];

  __device__ const uint32_t* words() const { return reinterpret_cast<const uint32_t*>(pieces); }
};

/// A warp's shared memory. Lanes write for one another, so every change of writer has a __syncwarp() between.
struct ClusterShared {
  ClusterStage stages[2];  // alternating: one cluster's data arrive while the other cluster is filtered
  PreparedCluster run[kRunClusters];
  SurvivorTriangle survivors[kWarpLanes - 1 + format::kMaxClusterTriangles];
  uint64_t end;            // the number of clusters of the pass, or of shared parts of clusters
  uint32_t run_start;      // number in the pass of the first cluster of the run that is drawn, or part of a cluster
  uint32_t run_share;      // the number of clusters of the run that was taken last
  uint32_t run_flushes;    // calls of ClusterWarp::flush_survivors() since then
  uint32_t run_is_masked;  // whether the last prepared run has masked clusters (in kernels that drop hidden triangles)
  uint32_t culls_late;     // whether ClusterWarp::cull_late() tests them once more
  uint32_t culled_late;    // the number of clusters that this removed
  // These three share memory, since no two are needed at once. For each cluster of a run:
  //   centers or screen_places  written by filter_vertices() or project_vertices(), read by filter_triangles();
  //   set_up             written and read by draw_set_up(), for the triangles that wait.
  // ClusterWarp::draw_run() has a __syncwarp() after each of the first two steps: without the second a lane would set
  // up its triangle over vertices that another lane still reads. draw_pixels() ends with one, so that the next
  // cluster's vertices do not overwrite a triangle that is still being drawn.
  union {
    // For each vertex the first pixel centre at or after it and the last one at or before it, with the filter's slack:
    // two 16-bit numbers each. The smallest `first` and the largest `last` of three corners hold the triangle's
    // pixel_box().
    struct {
      uint2 centers[format::kMaxClusterVertices];
      // In kernels that drop hidden triangles (drop_hidden()):
      float nearest_w[format::kMaxClusterVertices];         // of each vertex, a lower bound
      uint32_t first_center[format::kMaxClusterTriangles];  // of each survivor's box, two 16-bit numbers
      float triangle_w[format::kMaxClusterTriangles];       // of each survivor: the least nearest_w of its corners
    };
    uint32_t screen_places[format::kMaxClusterVertices];  // instead of centers, if the cluster has an AffineProjection
    SetUpTriangles set_up;
  };

  __device__ ClusterShared() {}
};

/// Blocks that fit into a multiprocessor's shared memory. More than 7 would leave too few registers.
inline constexpr uint32_t kClusterBlocks = blocks_in_shared(kClusterWarps * sizeof(ClusterShared), 7);

/// This warp's shared memory. Accessed by name, because a pointer would hide its address space from the
/// compiler.
__device__ inline ClusterShared& cluster_shared() {
  extern __shared__ uint4 shared_memory[];
  return reinterpret_cast<ClusterShared*>(shared_memory)[threadIdx.x / kWarpLanes];
}

/// format::ClusterPredictor with its axes sorted out once per cluster, so that the loop over vertices has no branch.
struct ClusterPrediction {
  int32_t slope[3];  // 0 for the predicted axis
  uint32_t bias;
  uint32_t axis;  // format::kNotPredicted if there is none

  /// `words`: the first two of the cluster's data if an axis is predicted.
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

/// Compacts into `run` the items [first, first + count) that are not behind the current picture, and returns their
/// count. The others lose their hints (ClusterPass). Boxes of more than 8 samples per side are not tested and are kept.
template <bool kOrthographic>
__device__ inline uint32_t list_unoccluded(const ClusterFrame& frame, uint32_t first, uint32_t count) {
  constexpr int32_t kMostSamples = 8;  // per side
  ClusterShared& shared = cluster_shared();
  const uint32_t lane = threadIdx.x % kWarpLanes;
  bool shows = lane < count;
  if (shows) {
    const ClusterItem item = frame.list.items[first + lane];
    const ClusterDraw& draw = frame.list.draws[item.draw];
    const CenteredBox box = centered_box(load_bounds(draw.cluster_bounds() + item.cluster));
    const FrameView& view = frame.small.view;
    ScreenBounds on_screen;
    shows =
        bound_on_screen<kOrthographic>(draw.filter, view, center_range(view), box, on_screen) == BoxCoverage::kCenters;
    const PixelBox& pixels = on_screen.pixels;
    if (shows && max_of(pixels.x1 - pixels.x0, pixels.y1 - pixels.y0) < kMostSamples)
      shows = !is_occluded_now(WarpTeam{}, frame.small.target, on_screen);
    if (!shows) {  // so that pass 1 of the next frame does not draw it
      atomicAnd(frame.list.hints + draw.hint_offset + item.cluster / format::kGroupClusters,
                ~(1u << item.cluster % format::kGroupClusters));
    }
  }
  const uint32_t shown = __ballot_sync(~0u, shows);
  if (shows) shared.run[rank_among(shown)].item = first + lane;
  return static_cast<uint32_t>(__popc(shown));
}

/// Prepares the `count` clusters of a run: items from `first` on, or with `kListed` the items that `run` already lists.
/// Lane i < kRunClusters prepares cluster i and the u axis of its affine projection; lane kRunClusters + i prepares its
/// v axis. `projects`: whether clusters get an AffineProjection.
template <bool kOrthographic, bool kListed, bool kDropsHidden>
__device__ inline void prepare_run(const ClusterFrame& frame, uint32_t first, uint32_t count, bool projects) {
  ClusterShared& shared = cluster_shared();
  const uint32_t lane = threadIdx.x % kWarpLanes;
  const uint32_t slot = min_of(lane % kRunClusters, count - 1);
  const bool second_axis = lane >= kRunClusters;
  const uint32_t number = kListed ? shared.run[slot].item : first + slot;
  const ClusterItem item = frame.list.items[number];
  const ClusterDraw& draw = frame.list.draws[item.draw];
  [[maybe_unused]] const bool is_masked = (draw.flags & ClusterDraw::kMasked) != 0;
  const uint4 record = __ldg(reinterpret_cast<const uint4*>(draw.clusters() + item.cluster));
  const format::ClusterLayout at = format::cluster_layout({record.x, record.y, record.z, record.w});
  const uint32_t* const data = draw.data() + at.prediction;
  const auto address = reinterpret_cast<uint64_t>(data);
  const auto skipped = static_cast<uint32_t>(address >> 2 & 3);
  const uint32_t pieces = (at.end - at.prediction + skipped + 3) / 4;
  const uint32_t bits_xy = at.position_bits[0] + at.position_bits[1];
  const uint32_t bits_xyz = bits_xy + at.position_bits[2];
  uint32_t factors[4] = {};
  uint32_t twice_slack = 0;
  uint32_t fraction_bits = 0;
  if constexpr (!kOrthographic) {
    if (projects) {
      const ClusterPrediction prediction(at.predicted_axis, data);
      const ClusterCodes codes{{at.position_bits[0], at.position_bits[1], at.position_bits[2]},
                               at.predicted_axis,
                               {prediction.slope[0], prediction.slope[1], prediction.slope[2]},
                               static_cast<int32_t>(prediction.bias)};
      const AffineCenter middle = make_affine_center(draw.filter, load_bounds(draw.cluster_bounds() + item.cluster));
      const float4 row4 = *reinterpret_cast<const float4*>(second_axis ? draw.filter.v : draw.filter.u);
      const float row[4] = {row4.x, row4.y, row4.z, row4.w};
      const AffineAxis axis = make_affine_axis(middle, draw.filter.w, row);
      const float other_half = __shfl_xor_sync(~0u, axis.half, kRunClusters);
      fraction_bits = affine_fraction_bits(fast_max(axis.half, other_half));
      bool known = middle.known & (bits_xyz <= 64) & (pieces <= kStagePieces) & (fraction_bits != 0);
      // drop_hidden() needs the filter's boxes, which are tighter.
      if constexpr (kDropsHidden) known = known & !is_masked;
      known =
          known & finish_affine_axis(middle, axis, draw.filter.w, row, codes, fraction_bits & 15, factors, twice_slack);
      const uint32_t other_twice_slack = __shfl_xor_sync(~0u, known ? twice_slack : 0u, kRunClusters);
      twice_slack = known && other_twice_slack != 0 ? twice_slack | other_twice_slack << 16 : 0;
    }
  }
  if constexpr (kDropsHidden) {
    const uint32_t masked = __ballot_sync(~0u, is_masked);
    if (lane == 0) shared.run_is_masked = masked != 0 ? 1 : 0;
  }
  if (lane % kRunClusters >= count) return;
  PreparedCluster& out = shared.run[slot];
  if (second_axis) {
    for (int i = 0; i < 4; ++i) out.projection.v[i] = factors[i];
    return;
  }
  for (int i = 0; i < 4; ++i) out.projection.u[i] = factors[i];
  out.projection.twice_slack = twice_slack;
  out.projection.fraction = ((1u << fraction_bits) - 1) * 0x10001u;
  out.data = address & ~uint64_t{15};
  out.shape = (at.triangle_count - 1) | (at.vertex_count - 1) << 8 | at.distance_bits << 16 |
              min_of(pieces, kStagePieces) << 24;
  const uint32_t begin = at.prediction - skipped;
  out.offsets =
      (at.steps - begin) | (at.distances - begin) << 8 | (at.positions - begin) << 16 |
      (at.wide_steps ? PreparedCluster::kWideSteps : 0) | (pieces > kStagePieces ? PreparedCluster::kTruncated : 0) |
      (slot == count - 1 ? PreparedCluster::kLast : 0) | at.predicted_axis << PreparedCluster::kPredictedAxisShift;
  out.codes = at.position_bits[0] | bits_xy << 8 | bits_xyz << 16;
  if constexpr (!kListed) out.item = number;
}
static_assert(2 * kRunClusters == kWarpLanes);

/// Starts copying a cluster's data to `stage`. The stream of clusters begins and ends on multiples of 16 bytes, so the
/// pieces lie within it.
__device__ inline void stage_cluster(StageCopy<>& copy, const PreparedCluster& cluster, ClusterStage& stage) {
  copy.begin(stage.pieces, reinterpret_cast<const uint4*>(cluster.data),
             byte_of(cluster.shape, PreparedCluster::kPieces));
}
static_assert(kStagePieces == 2 * kWarpLanes);

}  // namespace scree::kernels
