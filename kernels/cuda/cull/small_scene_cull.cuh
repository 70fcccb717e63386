// Culls a small scene's clusters on a GPU, in one kernel. If a frame takes a tenth of a millisecond, the number of
// kernels dominates: each begins when the last warp of the previous one has ended, and then waits for memory and for
// its own instructions. So one warp per group of clusters does all tests, beginning with its instance's matrix. Warps
// of one instance repeat each other's tests, which takes less time than another launch.
#pragma once

#include "kernels/cuda/cull/cluster_cull.cuh"

namespace scree::kernels {

struct SmallSceneCull {
  SceneView scene;
  Transform* transforms;  // as in DrawList
  ClusterCull cull;
  const ClusterGroup* groups;
  uint32_t group_count;
  SamplesToClear clear;
};

/// One warp per group of clusters: makes its instance's transform, tests the instance, the chunk, the group and the
/// clusters, and makes a draw for the group if a cluster is left. The last blocks clear the picture.
template <bool kOrthographic, bool kClips>
__global__ void __launch_bounds__(kCullThreads) cull_small_scene(const __grid_constant__ SmallSceneCull in) {
  const uint32_t culling_blocks = gridDim.x - in.clear.blocks;
  if (blockIdx.x >= culling_blocks) {
    clear_samples(in.clear, blockIdx.x - culling_blocks);
    return;
  }
  const uint32_t lane = threadIdx.x % kWarpLanes;
  const uint32_t number = blockIdx.x * kCullWarps + threadIdx.x / kWarpLanes;
  if (number >= in.group_count) return;
  const ClusterGroup at = in.groups[number];
  const SceneView& scene = in.scene;
  const FrameView& view = in.cull.view;
  if (is_omitted(view, at.instance)) return;
  FrameCounters& counters = *in.cull.counters;
  const format::InstanceRecord& instance = scene.instances[at.instance];
  const ClusterChunk& chunk = in.cull.list.chunks[at.chunk];
  const format::MeshRecord& mesh = scene.meshes[instance.mesh];
  constexpr bool kFloat32 = false;  // clusters lie on a lattice
  const Transform transform = make_transform(view, scene.matrices[instance.matrix], mesh.lattice_exponent, kFloat32);
  if (!may_be_drawn<kClips>(transform, view, mesh_box(mesh, transform), all_rows(view))) return;
  if (lane == 0 && at.group == 0 && at.chunk == mesh.first_chunk) {
    in.transforms[at.instance] = transform;
    WarpTeam::add(&counters.queues.instances_drawn, 1);
  }
  if (scene.pages[chunk.page] == nullptr) return;
  if (mesh.chunk_count != 1 &&
      !may_be_drawn<kClips>(transform, view, rounded_chunk_box(mesh, chunk, transform), drawn_rows(view)))
    return;
  if (lane == 0 && at.group == 0) {
    WarpTeam::add(&counters.queues.draws, 1);
    WarpTeam::add(&counters.queues.triangles, uint64_t{chunk.triangle_count});
  }
  // Computed again: keeping this box would take two more registers.
  const RoundedBox box = rounded_chunk_box(mesh, chunk, transform);
  const ClusterDraw draw =
      make_cluster_draw(scene, view, in.cull.list, transform, mesh, chunk, box, at.chunk, at.instance);
  if (lane == 0) WarpTeam::add(&counters.groups_tested, 1);
  if (may_show<kOrthographic, false, kClips>(in.cull, draw.filter, load_bounds(draw.group_bounds() + at.group)) !=
      BoxCoverage::kCenters)
    return;
  const uint32_t cluster = at.group * format::kGroupClusters + lane;
  const bool is_there = cluster < draw.cluster_count;
  const bool kept =
      is_there && may_show<kOrthographic, false, kClips>(
                      in.cull, draw.filter, load_bounds(draw.cluster_bounds() + cluster)) == BoxCoverage::kCenters;
  const uint32_t lanes = __ballot_sync(~0u, kept);
  const auto tested = static_cast<uint64_t>(__popc(__ballot_sync(~0u, is_there)));
  uint64_t first = 0;
  if (lane == 0) {
    WarpTeam::add(&counters.clusters_tested, tested);
    first = WarpTeam::add(&counters.clusters[in.cull.pass], static_cast<uint64_t>(__popc(lanes)));
  }
  const uint64_t slot = __shfl_sync(~0u, first, 0) + rank_among(lanes);
  if (kept && slot < in.cull.list.item_capacity) in.cull.list.items[slot] = {number, cluster};
  if (lane == 0 && lanes != 0) in.cull.list.draws[number] = draw;
}

}  // namespace scree::kernels
