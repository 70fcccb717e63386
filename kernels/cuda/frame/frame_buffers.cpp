#include "kernels/cuda/frame/frame_buffers.h"

#include <algorithm>
#include <cstddef>

namespace scree::kernels {
namespace {

constexpr const char* kDrawList = "allocating the draw list";

/// The first capacity of the queue of clusters.
uint64_t first_items(uint64_t cluster_groups, const CudaQueueSizes& sizes) {
  const uint64_t all = cluster_groups * format::kGroupClusters;
  return min_of(all, sizes.holds_first_frame ? max_of(sizes.clusters, all / 4) : sizes.clusters);
}

/// Whether the scene has no indexed chunks and is drawn in one pass.
bool suits_small_scene(const CandidateCounts& candidates, const CudaQueueSizes& sizes) {
  return candidates.indexed == 0 && candidates.cluster_groups < sizes.two_pass_groups;
}

/// Entries of ClusterList::first_of_run.
uint64_t runs_of(uint64_t groups) {
  return (groups + kRunWork - 1) / kRunWork;
}

/// Whether the clusters of pass 1 are listed in the order of the draws: in scenes with masks. With more groups than
/// this the order of runs of groups suffices, because only a small part of them is culled at a time.
bool lists_in_order(const SceneView& host, uint64_t groups, const CudaQueueSizes& sizes) {
  constexpr uint64_t kMostGroups = uint64_t{1} << 18;
  return host.masks != nullptr && groups >= sizes.two_pass_groups && groups <= kMostGroups;
}

}  // namespace

uint64_t FrameBuffers::device_bytes(const SceneView& host, const CudaQueueSizes& sizes) {
  const CandidateCounts candidates = count_candidates(host);
  uint64_t bytes = sizeof(FrameCounters) + 2 * host.mesh_count * sizeof(uint32_t) +
                   host.instance_count * (2 * sizeof(uint32_t) + sizeof(Transform)) +
                   host.chunk_count * sizeof(ChunkBounds) +
                   candidates.indexed * (sizeof(CandidateDraw) + sizeof(InstancedDraw)) +
                   (sizes.medium + sizes.large) * sizeof(Triangle) + sizes.tiles * sizeof(TileItem);
  const bool is_small = suits_small_scene(candidates, sizes);
  const uint64_t small_groups = is_small ? candidates.cluster_groups : 0;
  if (candidates.clustered != 0) {
    bytes += candidates.clustered * sizeof(CandidateDraw) +
             (is_small ? 0
                       : candidates.cluster_draws * (sizeof(DrawPlace) + sizeof(OrderedDraw)) +
                             runs_of(candidates.cluster_groups) * sizeof(uint32_t)) +
             (lists_in_order(host, candidates.cluster_groups, sizes)
                  ? (candidates.cluster_groups + runs_of(candidates.cluster_groups)) * sizeof(uint32_t)
                  : 0) +
             max_of(candidates.cluster_draws, small_groups) * sizeof(ClusterDraw) +
             small_groups * sizeof(ClusterGroup) + host.chunk_count * sizeof(ClusterChunk) +
             host.instance_count * sizeof(uint64_t) + candidates.cluster_groups * sizeof(uint32_t) +
             first_items(candidates.cluster_groups, sizes) * sizeof(ClusterItem) + sizes.to_clip * sizeof(ClipItem) +
             2 * sizes.clipped * sizeof(Triangle) + sizes.tiles * sizeof(TileItem);
  }
  return bytes;
}

Result<void> FrameBuffers::open(const SceneView& host, const CudaQueueSizes& first_sizes) {
  const DrawTables tables = SCREE_TRY(make_draw_tables(host));
  traits = tables;
  sizes = first_sizes;
  SCREE_TRY(order.fill(tables.order, kDrawList));
  SCREE_TRY(mesh_first.fill(tables.mesh_first, kDrawList));
  SCREE_TRY(candidates.fill(tables.candidates, kDrawList));
  if (tables.has_float32) SCREE_TRY(bounds.allocate(host.chunk_count, "allocating the chunks' bounds"));
  SCREE_TRY(zeroed.allocate(sizeof(FrameCounters) + host.mesh_count * sizeof(uint32_t), kDrawList));
  SCREE_TRY(visible.allocate(tables.order.size(), kDrawList));
  SCREE_TRY(transforms.allocate(host.instance_count, "allocating the frame's transforms"));
  SCREE_TRY(instanced_draws.allocate(tables.candidates.size(), kDrawList));
  SCREE_TRY(queues.triangles.tiles.allocate(sizes.tiles, "allocating the queues"));
  SCREE_TRY(queues.grow({sizes.medium, sizes.large, 0, 0, 0, 0, 0, 0}));
  return tables.cluster_candidates.empty() ? Result<void>() : open_clusters(host, tables);
}

Result<void> FrameBuffers::open_clusters(const SceneView& host, const DrawTables& tables) {
  SCREE_TRY(cluster_candidates.fill(tables.cluster_candidates, kDrawList));
  SCREE_TRY(cluster_chunks.fill(tables.cluster_chunks, kDrawList));
  SCREE_TRY(hint_offset.fill(tables.hint_offset, kDrawList));
  if (suits_small_scene(tables, sizes)) {
    SCREE_TRY(small_scene_groups.fill(list_cluster_groups(host), kDrawList));
  } else {
    SCREE_TRY(draw_places.allocate(tables.cluster_draws, kDrawList));
    SCREE_TRY(draw_order.allocate(tables.cluster_draws, kDrawList));
    SCREE_TRY(first_of_run.allocate(runs_of(tables.cluster_groups), kDrawList));
  }
  if (lists_in_order(host, tables.cluster_groups, sizes)) {
    SCREE_TRY(kept.allocate(tables.cluster_groups, kDrawList));
    SCREE_TRY(kept_of_run.allocate(runs_of(tables.cluster_groups), kDrawList));
  }
  SCREE_TRY(draws.allocate(max_of(tables.cluster_draws, small_scene_groups.count()), kDrawList));
  if (in_two_passes()) SCREE_TRY(hints.allocate(tables.cluster_groups, "allocating a bit for each cluster"));
  SCREE_TRY(queues.clipped.tiles.allocate(sizes.tiles, "allocating the queues"));
  return queues.grow({0, 0, 0, first_items(tables.cluster_groups, sizes), sizes.to_clip, sizes.clipped, 0, 0});
}

Result<void> FrameBuffers::fit_pyramid(const FrameView& frame) {
  if (!in_two_passes() || (pyramid.width == frame.width && pyramid.height == frame.height)) return {};
  pyramid = {};  // in case that there is no memory
  DepthPyramid fitted{};
  SCREE_TRY(pyramid_codes.grow(lay_out(fitted, frame.width, frame.height), "allocating the depth pyramid"));
  fitted.codes = pyramid_codes.data();
  pyramid = fitted;
  return {};
}

DrawList FrameBuffers::draw_list() const {
  return {order.data(),
          mesh_first.data(),
          candidates.data(),
          bounds.data(),
          static_cast<uint32_t>(order.count()),
          static_cast<uint32_t>(candidates.count()),
          reinterpret_cast<uint32_t*>(zeroed.data() + sizeof(FrameCounters)),
          visible.data(),
          transforms.data(),
          instanced_draws.data(),
          counters()};
}

ClusterList FrameBuffers::cluster_list(const FrameView& frame) const {
  return {cluster_candidates.data(),
          cluster_chunks.data(),
          hint_offset.data(),
          static_cast<uint32_t>(cluster_candidates.count()),
          hints.data(),
          draws.data(),
          draw_places.data(),
          draw_order.data(),
          first_of_run.data(),
          kept.data(),
          kept_of_run.data(),
          queues.items.data(),
          queues.items.count(),
          queues.to_clip.data(),
          queues.to_clip.count(),
          pyramid,
          static_cast<float>(std::clamp(traits.box.farthest(frame), 1.0, 1e38))};
}

}  // namespace scree::kernels
