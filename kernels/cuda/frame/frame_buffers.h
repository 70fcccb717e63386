// The device memory of a scene's frames: the tables of its draw list, the lists and queues that kernels fill, hints and
// the depth pyramid. docs/frame.md lists who writes and reads them.
#pragma once

#include "kernels/cuda/common/device_array.h"
#include "kernels/cuda/frame/draw_tables.h"
#include "kernels/cuda/frame/frame.h"
#include "kernels/cuda/frame/queues.h"

namespace scree::kernels {

struct FrameBuffers {
  /// Allocates everything but the pyramid, and copies the tables. `host`: as for CudaFrames::create(). Errors kRange,
  /// kDevice.
  Result<void> open(const SceneView& host, const CudaQueueSizes& first_sizes);

  /// The device memory that open() takes.
  static uint64_t device_bytes(const SceneView& host, const CudaQueueSizes& sizes);

  /// Fits the pyramid to the picture, if the picture's size has changed. Errors kDevice.
  Result<void> fit_pyramid(const FrameView& frame);

  FrameCounters* counters() const { return reinterpret_cast<FrameCounters*>(zeroed.data()); }
  DrawList draw_list() const;
  ClusterList cluster_list(const FrameView& frame) const;

  bool has_clusters() const { return cluster_candidates.count() != 0; }
  bool in_two_passes() const { return traits.cluster_groups >= sizes.two_pass_groups; }
  /// Whether one kernel does all culling, because there are few groups and no other chunks.
  bool is_small_scene() const { return small_scene_groups.count() != 0; }

  DrawTraits traits;
  CudaQueueSizes sizes;  // the first ones
  DeviceArray<uint32_t> order;
  DeviceArray<uint32_t> mesh_first;
  DeviceArray<CandidateDraw> candidates;
  DeviceArray<ChunkBounds> bounds;
  DeviceArray<std::byte> zeroed;  // the counters, then the visible instances of each mesh
  DeviceArray<uint32_t> visible;
  DeviceArray<Transform> transforms;
  DeviceArray<InstancedDraw> instanced_draws;
  FrameQueues queues;
  // Clustered chunks:
  DeviceArray<CandidateDraw> cluster_candidates;
  DeviceArray<ClusterChunk> cluster_chunks;
  DeviceArray<uint64_t> hint_offset;
  DeviceArray<uint32_t> hints;  // of scenes that are drawn in two passes; open() does not clear them
  DeviceArray<ClusterDraw> draws;
  DeviceArray<DrawPlace> draw_places;
  DeviceArray<OrderedDraw> draw_order;
  DeviceArray<uint32_t> first_of_run;
  DeviceArray<uint32_t> kept;  // of scenes whose clusters are listed in order
  DeviceArray<uint32_t> kept_of_run;
  DeviceArray<ClusterGroup> small_scene_groups;
  DeviceArray<uint32_t> pyramid_codes;
  DepthPyramid pyramid{};

 private:
  Result<void> open_clusters(const SceneView& host, const DrawTables& tables);
};

}  // namespace scree::kernels
