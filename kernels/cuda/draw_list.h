// What one frame on a GPU draws, made on the GPU: which instances are seen, which chunks of them, and the prefix sum
// that hands out their rows of triangles. The CPU's frame (passes.h) has blocks instead.
#pragma once

#include "kernels/cull/near_bucket.h"
#include "kernels/raster/queues.h"

namespace scree::kernels {

/// Instances of a group. With twice as many, what they need of shared memory leaves too little of the L1 cache.
inline constexpr uint32_t kDrawInstances = 16;

/// The box of a chunk of float32 positions, which its record does not have. Made once.
struct ChunkBounds {
  float min[3];
  float max[3];
};

/// Up to kDrawInstances instances of a chunk's mesh, seen or not: what one thread of the second culling pass looks at.
/// Made once.
struct CandidateDraw {
  uint32_t chunk;
  uint32_t first;  // index among the mesh's visible instances
};

/// A chunk and up to kDrawInstances instances that it is drawn for, so that its triangles are fetched once for all of
/// them.
struct InstancedDraw {
  uint64_t work_before;  // sum over the draws before, of rows of 32 triangles times instances
  uint32_t chunk;
  uint32_t first_visible;  // index in DrawList::visible of bit 0
  uint32_t instances;      // bit i: visible[first_visible + i]
  uint32_t reserved;
};
static_assert(sizeof(InstancedDraw) == 24);

/// Two sums in one word, so that one atomic addition gives a draw its index and its share of a prefix sum in the same
/// order: the number of draws (28 bits) over their work (36 bits): rows of 32 triangles, or groups of 32 clusters.
inline constexpr uint32_t kWorkBits = 36;
inline constexpr uint64_t kWorkMask = (uint64_t{1} << kWorkBits) - 1;
inline constexpr uint64_t kMaxDraws = uint64_t{1} << 28;

/// Passes of a frame that draw clusters: what was seen last time, then the rest, in rounds from near to far.
inline constexpr uint32_t kMostRounds = 8;
inline constexpr uint32_t kClusterPasses = 1 + kMostRounds;

/// How much of a queue the passes before have drawn.
struct DrawnTriangles {
  uint64_t medium;
  uint64_t large;
};

/// Zero when a frame begins.
struct FrameCounters {
  Counters queues;
  Counters clipped;          // medium, large, tiles: of what clipping the triangles of clusters leaves
  uint64_t instanced_draws;  // and their work
  uint64_t next_work;        // handed out to stage 1
  // Of clustered chunks:
  uint64_t draws;                         // ClusterDraws, and their work
  uint64_t in_bucket[kNearBuckets];       // draws and their work
  uint64_t placed[kNearBuckets];          // of those
  uint64_t clusters[kClusterPasses];      // in the queue, pass by pass
  uint64_t next_cluster[kClusterPasses];  // handed out
  uint64_t to_clip;                       // queued
  uint64_t groups_tested;
  uint64_t clusters_tested;
  uint64_t clusters_culled_late;  // of the queue: hidden when their turn came
  DrawnTriangles drawn;
  DrawnTriangles clipped_drawn;
  uint64_t to_clip_drawn;
};

/// Clusters in the queue from the passes before `pass`.
SCREE_HD inline uint64_t clusters_before(const FrameCounters& counters, uint32_t pass) {
  uint64_t sum = 0;
  for (uint32_t i = 0; i < pass; ++i) sum += counters.clusters[i];
  return sum;
}

/// Between two passes of a frame: stages 2 and 3 go on with what the next one queues.
SCREE_HD inline void begin_pass(FrameCounters& counters) {
  counters.drawn = {counters.queues.medium, counters.queues.large};
  counters.clipped_drawn = {counters.clipped.medium, counters.clipped.large};
  counters.to_clip_drawn = counters.to_clip;
  counters.queues.tiles = 0;
  counters.clipped.tiles = 0;
}

/// Device memory. Instances without triangles are in no list.
struct DrawList {
  // Of the scene:
  const uint32_t* order;       // instances, mesh by mesh
  const uint32_t* mesh_first;  // mesh_count: where a mesh's instances begin in `order` and `visible`
  const CandidateDraw* candidates;
  const ChunkBounds* bounds;  // by chunk, of those with float32 positions; null where there are none
  uint32_t instance_count;    // in `order`
  uint32_t candidate_count;
  // Of the frame:
  uint32_t* visible_count;         // by mesh; zero when a frame begins
  uint32_t* visible;               // instances seen, each mesh's from mesh_first on
  Transform* transforms;           // by instance; of those seen
  InstancedDraw* instanced_draws;  // room for candidate_count
  FrameCounters* counters;
};

}  // namespace scree::kernels
