// What one frame on a GPU draws of clustered chunks, and what it knows from the frame before. The frame goes in passes:
// first what was seen last time, then, against the depth pyramid of that, what else is to be seen; where the camera has
// moved, in rounds from near to far, each against the pyramid of those before.
#pragma once

#include "kernels/cuda/draw_list.h"
#include "kernels/cull/coverage_filter.h"
#include "kernels/cull/depth_pyramid.h"

namespace scree::kernels {

/// A clustered chunk drawn for one instance. Its work is the number of its groups of 32 clusters. In a
/// small scene each group has a draw of its own.
struct alignas(16) ClusterDraw {
  CoverageFilter filter;
  float x[4];  // rows of the instance's transform
  float y[4];
  float w[4];
  int32_t base[3];  // lattice coordinate of the chunk's position_min minus the transform's reference
  uint32_t flags;
  uint64_t first_id;     // of the chunk's triangle 0
  uint64_t work_before;  // sum over the draws before; 0 in a small scene
  uint64_t hint_offset;  // of ClusterList::hints: of its group 0
  const std::byte* payload;
  uint32_t chunk;
  uint32_t instance;
  uint32_t cluster_count;
  float error[3];  // of x, y and w: error_of()
  uint32_t reserved[2];

  static constexpr uint32_t kMirrored = 1;
  static constexpr uint32_t kFarAway = 2;  // base + offset does not fit int32
  static constexpr uint32_t kDoubleSided = 4;

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
static_assert(sizeof(ClusterDraw) == 192);

/// A group of 32 clusters of a chunk of an instance: what a warp culls where there are few. Made once.
struct ClusterGroup {
  uint32_t instance;
  uint32_t chunk;
  uint32_t group;  // of the chunk
};

/// A cluster to be drawn.
struct ClusterItem {
  uint32_t draw;
  uint32_t cluster;  // of the draw's chunk
};

/// A triangle that may cover a pixel centre.
struct SurvivorTriangle {
  uint32_t item;     // of ClusterList::items
  uint32_t corners;  // numbers in the cluster, 7 bits each: the triangle's, and its corners'
};

/// A triangle that needs clipping. raster_clipped reads instance, chunk and triangle alone: copies that save it the
/// chain of loads from item to draw to record.
struct ClipItem {
  SurvivorTriangle survivor;
  uint32_t instance;
  uint32_t chunk;
  uint32_t triangle;  // of the chunk
};

/// Device memory.
struct ClusterList {
  // Of the scene:
  const CandidateDraw* candidates;    // of clustered chunks
  const uint32_t* chunk_hint_offset;  // by chunk: groups of the mesh's chunks before
  const uint64_t* hint_offset;        // by instance: groups of the instances before
  uint32_t candidate_count;
  // Kept from frame to frame: a bit for each cluster of each instance, set if it was not hidden when asked. Null: every
  // cluster that is not outside of the picture is drawn in one pass.
  uint32_t* hints;
  // Of the frame:
  uint16_t* draw_bucket;  // by thread, kDrawInstances a candidate: of kNearBuckets, or that where it is not drawn
  ClusterDraw* draws;     // room for DrawTables::cluster_draws, from near to far; or one a ClusterGroup
  ClusterItem* items;
  uint64_t item_capacity;  // below 2^32
  ClipItem* to_clip;
  uint64_t clip_capacity;
  DepthPyramid pyramid;
  float farthest;  // w of the scene's farthest point, at least 1: where the buckets end
};

}  // namespace scree::kernels
