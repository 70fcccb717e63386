// The draw list of one frame on a GPU, made on the GPU: the visible instances, their visible chunks, and the prefix sum
// by which warps take rows of triangles. The CPU's frame (passes.h) has draw blocks instead.
#pragma once

#include "kernels/cull/near_bucket.h"
#include "kernels/raster/queues.h"

namespace scree::kernels {

/// Instances per draw. With twice as many, their shared memory leaves too little of the L1 cache.
inline constexpr uint32_t kDrawInstances = 16;

/// The box of a chunk of float32 positions, which its record lacks. Made once.
struct ChunkBounds {
  float min[3];
  float max[3];
};

/// Up to kDrawInstances instances of a chunk's mesh, visible or not. One thread of the second culling kernel tests
/// them. Made once.
struct CandidateDraw {
  uint32_t chunk;
  uint32_t first;  // index in the mesh's list of visible instances
};

/// A chunk and up to kDrawInstances instances that it is drawn for. Its triangles are fetched once for all of them.
struct InstancedDraw {
  uint64_t work_before;  // sum over the draws before of (rows of 32 triangles) * instances
  uint32_t chunk;
  uint32_t first_visible;  // index in DrawList::visible of bit 0
  uint32_t instances;      // bit i: visible[first_visible + i]
  uint32_t reserved;
};
static_assert(sizeof(InstancedDraw) == 24);

/// Two sums in one word: the number of draws (28 bits) above their work (36 bits), which is rows of 32 triangles or
/// groups of 32 clusters. One atomic addition gives a draw its index and its part of a prefix sum in the same order.
inline constexpr uint32_t kWorkBits = 36;
inline constexpr uint64_t kWorkMask = (uint64_t{1} << kWorkBits) - 1;
inline constexpr uint64_t kMaxDraws = uint64_t{1} << 28;

/// Passes of a frame that draw clusters: those visible in the last frame, then the rest, in rounds from near to far.
inline constexpr uint32_t kMostRounds = 8;
inline constexpr uint32_t kClusterPasses = 1 + kMostRounds;

/// The entries of a queue that the earlier passes have drawn.
struct DrawnTriangles {
  uint64_t medium;
  uint64_t large;
};

/// All zero when a frame begins.
struct FrameCounters {
  Counters queues;
  Counters clipped;          // medium, large, tiles: the pieces of clipped triangles of clusters
  uint64_t instanced_draws;  // number of draws above their work
  uint64_t next_work;        // taken by stage 1
  // Clustered chunks:
  uint64_t draws;                         // number of ClusterDraws above their work
  uint64_t next_run[kClusterPasses];      // runs of groups that culling took, beside the first of each warp, by pass
  uint64_t clusters[kClusterPasses];      // in the queue, by pass
  uint64_t next_cluster[kClusterPasses];  // taken by stage 1, by pass
  uint64_t to_clip;                       // in the queue
  uint64_t groups_tested;
  uint64_t clusters_tested;
  uint64_t clusters_culled_late;  // removed by late culling
  DrawnTriangles drawn;
  DrawnTriangles clipped_drawn;
  uint64_t to_clip_drawn;
  // Not for the host:
  uint64_t in_bucket[kNearBuckets];  // number of draws above their work
};

/// The number of clusters in the queue from the passes before `pass`.
SCREE_HD inline uint64_t clusters_before(const FrameCounters& counters, uint32_t pass) {
  uint64_t sum = 0;
  for (uint32_t i = 0; i < pass; ++i) sum += counters.clusters[i];
  return sum;
}

/// Runs between two passes of a frame after which clipping and stages 2 and 3 ran: they continue after the triangles
/// that they have drawn.
SCREE_HD inline void begin_pass(FrameCounters& counters) {
  counters.drawn = {counters.queues.medium, counters.queues.large};
  counters.clipped_drawn = {counters.clipped.medium, counters.clipped.large};
  counters.to_clip_drawn = counters.to_clip;
  counters.queues.tiles = 0;
  counters.clipped.tiles = 0;
}

/// Device memory. Instances without triangles are in no list.
struct DrawList {
  // Per scene:
  const uint32_t* order;       // instances, mesh by mesh
  const uint32_t* mesh_first;  // mesh_count entries: first index of a mesh's instances in `order` and `visible`
  const CandidateDraw* candidates;
  const ChunkBounds* bounds;  // by chunk, for float32 positions; null if there are none
  uint32_t instance_count;    // entries of `order`
  uint32_t candidate_count;
  // Per frame:
  uint32_t* visible_count;         // by mesh; zero when a frame begins
  uint32_t* visible;               // visible instances, each mesh's from mesh_first on
  Transform* transforms;           // by instance; valid for visible ones
  InstancedDraw* instanced_draws;  // room for candidate_count
  FrameCounters* counters;
};

}  // namespace scree::kernels
