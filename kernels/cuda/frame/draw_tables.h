// The tables of a GPU's draw list. They follow from a scene's records alone and are made once.
#pragma once

#include <cmath>
#include <vector>

#include "format/result.h"
#include "kernels/cuda/frame/cluster_list.h"
#include "kernels/raster/transform.h"
#include "kernels/scene_view.h"

namespace scree::kernels {

/// A box around all instances whose matrices are finite, in world space. Only for sorting.
struct SceneBox {
  double center[3] = {};
  double half[3] = {};

  /// The depth of the farthest corner, in the units of FrameView::row_w.
  double farthest(const FrameView& view) const {
    double at = view.offset_w;
    for (int i = 0; i < 3; ++i) at += view.row_w[i] * (center[i] - view.eye[i]) + std::abs(view.row_w[i]) * half[i];
    return at;
  }
};

/// Numbers of candidates: chunks of drawn meshes with up to kDrawInstances instances each.
struct CandidateCounts {
  uint64_t indexed = 0;
  uint64_t clustered = 0;
  uint64_t cluster_draws = 0;   // clustered chunks, counted per instance
  uint64_t cluster_groups = 0;  // their groups of clusters, counted per instance
};

/// The features of a scene that its passes need.
struct DrawTraits : CandidateCounts {
  bool has_lattice = false;
  bool has_float32 = false;
  bool has_instances = false;  // a mesh is drawn more than once
  SceneBox box;
};

/// The tables of a scene's draw list.
struct DrawTables : DrawTraits {
  std::vector<uint32_t> order;
  std::vector<uint32_t> mesh_first;
  std::vector<CandidateDraw> candidates;
  std::vector<CandidateDraw> cluster_candidates;  // clustered chunks
  std::vector<ClusterChunk> cluster_chunks;       // as in ClusterList; empty if no chunk is clustered
  std::vector<uint64_t> hint_offset;
};

CandidateCounts count_candidates(const SceneView& scene);

/// Lists every group of clusters of every instance. Requires that all chunks are clustered.
std::vector<ClusterGroup> list_cluster_groups(const SceneView& scene);

/// Errors kRange: 2^32 instances or chunks, or more candidates than a draw list holds.
Result<DrawTables> make_draw_tables(const SceneView& scene);

}  // namespace scree::kernels
