// The clustered chunks that one frame on a GPU draws, and its hints from the frame before. The frame has passes: pass 1
// draws the clusters that were visible last time; pass 2 draws the others that the depth pyramid of pass 1 does not
// hide. If the camera has moved, pass 2 has rounds from near to far, each with a pyramid of all before.
#pragma once

#include "kernels/cuda/frame/draw_list.h"
#include "kernels/cull/coverage_filter.h"
#include "kernels/cull/depth_pyramid.h"

namespace scree::kernels {

/// A clustered chunk drawn for one instance. In a small scene each group of 32 clusters has a draw of its own.
struct alignas(16) ClusterDraw {
  CoverageFilter filter;
  float x[4];  // rows of the instance's transform
  float y[4];
  float w[4];
  int32_t base[3];  // lattice coordinate of the chunk's position_min minus the transform's reference
  uint32_t flags;
  uint64_t first_id;     // id of the chunk's triangle 0
  uint64_t hint_offset;  // index in ClusterList::hints of its group 0
  const std::byte* payload;
  uint32_t chunk;
  uint32_t instance;
  uint32_t cluster_count;
  float error[3];  // of x, y and w: error_of()

  static constexpr uint32_t kMirrored = 1;
  static constexpr uint32_t kFarAway = 2;  // base + offset does not fit int32
  static constexpr uint32_t kDoubleSided = 4;
  static constexpr uint32_t kMasked = 8;  // or blended: its samples are tested

  SCREE_HD uint32_t group_count() const {
    return (cluster_count + format::kGroupClusters - 1) / format::kGroupClusters;
  }
  SCREE_HD const format::ClusterBounds* group_bounds() const {
    return reinterpret_cast<const format::ClusterBounds*>(payload);
  }
  SCREE_HD const format::ClusterBounds* cluster_bounds() const { return group_bounds() + group_count(); }
  SCREE_HD const format::ClusterRecord* clusters() const {
    return reinterpret_cast<const format::ClusterRecord*>(cluster_bounds() + cluster_count);
  }
  SCREE_HD const uint32_t* data() const { return reinterpret_cast<const uint32_t*>(clusters() + cluster_count); }
};
// An odd number of 16 bytes, so that lanes that each write one to shared memory use different banks.
static_assert(sizeof(ClusterDraw) == 176);

/// The parts of a clustered chunk's record that culling reads, so that a lane reads them as three times 16 bytes. All
/// zero for other chunks. Made once.
struct alignas(16) ClusterChunk {
  uint32_t position_min[3];
  uint8_t position_bits[3];
  uint8_t reserved;
  uint32_t page;
  uint32_t cluster_count;
  uint32_t triangle_count;
  uint32_t hint_offset;  // groups of the mesh's chunks before it
  uint64_t offset;
  uint64_t first_triangle;
};

/// Where a draw goes in the order of buckets.
struct alignas(16) DrawPlace {
  uint64_t before;  // number of draws above their work, in its bucket
  uint32_t bucket;
  uint32_t work;  // of the draw
};

/// An entry of the draws' order from near to far. A draw's work is the number of its groups of 32 clusters.
struct alignas(16) OrderedDraw {
  uint64_t work_before;  // sum of the work of the entries before
  uint32_t draw;         // index in ClusterList::draws
};

/// Runs of this much work have an entry in ClusterList::first_of_run.
inline constexpr uint32_t kRunWork = 32;

/// A group of 32 clusters of a chunk of an instance. In a small scene a warp culls it. Made once.
struct ClusterGroup {
  uint32_t instance;
  uint32_t chunk;
  uint32_t group;  // number in the chunk
};

/// A cluster to be drawn.
struct ClusterItem {
  uint32_t draw;
  uint32_t cluster;  // number in the draw's chunk
};

/// A triangle that may cover a pixel centre.
struct SurvivorTriangle {
  uint32_t item;     // index in ClusterList::items
  uint32_t corners;  // 7 bits each: the triangle's number in the cluster, and its corners' vertex numbers; HiddenBox
};

/// A triangle that needs clipping. raster_clipped reads only instance, chunk and triangle; these copies save it the
/// chain of loads from item to draw to record.
struct ClipItem {
  SurvivorTriangle survivor;
  uint32_t instance;
  uint32_t chunk;
  uint32_t triangle;  // number in the chunk
};

/// Device memory.
struct ClusterList {
  // Per scene:
  // Each candidate stands for kDrawInstances pairs of a visible instance and a chunk of a mesh, from its own pair on.
  // After a mesh's last chunk its next instance follows.
  const CandidateDraw* candidates;
  const ClusterChunk* chunks;   // by chunk
  const uint64_t* hint_offset;  // by instance: groups of the instances before it
  uint32_t candidate_count;
  // Kept from frame to frame: one bit per cluster of each instance, set if it was not hidden when last tested. Null:
  // one pass draws every cluster that is not outside the picture.
  uint32_t* hints;
  // Per frame:
  ClusterDraw* draws;  // room for DrawTables::cluster_draws, in any order; in a small scene one per ClusterGroup
  DrawPlace* places;   // by draw
  OrderedDraw* order;
  uint32_t* first_of_run;  // by run of kRunWork: the entry of `order` with its first work
  // If the clusters of pass 1 are listed in the order of the draws, else null (list_in_order()):
  uint32_t* kept;         // by work: the clusters of the group that are drawn, one bit per cluster
  uint32_t* kept_of_run;  // by run of kRunWork: their number
  ClusterItem* items;
  uint64_t item_capacity;  // below 2^32
  ClipItem* to_clip;
  uint64_t clip_capacity;
  DepthPyramid pyramid;
  float farthest;  // w of the scene's farthest point, at least 1: where the buckets end
};

}  // namespace scree::kernels
