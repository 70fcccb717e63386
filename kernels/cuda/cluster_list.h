// The clustered chunks that one frame on a GPU draws, and its hints from the frame before. The frame has passes: pass 1
// draws the clusters that were visible last time; pass 2 draws the others that the depth pyramid of pass 1 does not
// hide. If the camera has moved, pass 2 has rounds from near to far, each with a pyramid of all before.
#pragma once

#include "kernels/cuda/draw_list.h"
#include "kernels/cull/coverage_filter.h"
#include "kernels/cull/depth_pyramid.h"

namespace scree::kernels {

/// A clustered chunk drawn for one instance. Its work is the number of its groups of 32 clusters. In a small scene each
/// group has a draw of its own.
struct alignas(16) ClusterDraw {
  CoverageFilter filter;
  float x[4];  // rows of the instance's transform
  float y[4];
  float w[4];
  int32_t base[3];  // lattice coordinate of the chunk's position_min minus the transform's reference
  uint32_t flags;
  uint64_t first_id;     // id of the chunk's triangle 0
  uint64_t work_before;  // sum of the work of the draws before; 0 in a small scene
  uint64_t hint_offset;  // index in ClusterList::hints of its group 0
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
  uint32_t corners;  // 7 bits each: the triangle's number in the cluster, and its corners' vertex numbers
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
  const CandidateDraw* candidates;    // clustered chunks
  const uint32_t* chunk_hint_offset;  // by chunk: groups of the mesh's chunks before it
  const uint64_t* hint_offset;        // by instance: groups of the instances before it
  uint32_t candidate_count;
  // Kept from frame to frame: one bit per cluster of each instance, set if it was not hidden when last tested. Null:
  // one pass draws every cluster that is not outside the picture.
  uint32_t* hints;
  // Per frame:
  uint16_t* draw_bucket;  // by thread, kDrawInstances per candidate: bucket number, or kNearBuckets if it is not drawn
  ClusterDraw* draws;     // room for DrawTables::cluster_draws, from near to far; in a small scene one per ClusterGroup
  ClusterItem* items;
  uint64_t item_capacity;  // below 2^32
  ClipItem* to_clip;
  uint64_t clip_capacity;
  DepthPyramid pyramid;
  float farthest;  // w of the scene's farthest point, at least 1: where the buckets end
};

}  // namespace scree::kernels
