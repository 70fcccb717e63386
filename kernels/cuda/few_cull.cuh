// Culling of few clusters on a GPU, in one kernel. Where a frame takes a tenth of a millisecond, the number of kernels
// is what costs: each begins when the last warp of the one before has ended, and then waits for memory and for its own
// instructions. So one warp per group of clusters does all tests, from its instance's matrix on. Warps of one instance
// repeat each other's tests; that is cheaper than another launch.
#pragma once

#include "kernels/cuda/cluster_cull.cuh"

namespace scree::kernels {

struct FewCull {
  SceneView scene;
  Transform* transforms;  // as DrawList has them
  ClusterCull cull;
  const ClusterGroup* groups;
  uint32_t group_count;
  SamplesToClear clear;
};

/// A warp per group of clusters: its instance's transform, the tests of the instance, the chunk, the group and the
/// clusters, and a draw of its own. The last blocks clear the picture.
template <bool kOrthographic>
__global__ void __launch_bounds__(kCullThreads) cull_few(const __grid_constant__ FewCull few) {
  const uint32_t culling_blocks = gridDim.x - few.clear.blocks;
  if (blockIdx.x >= culling_blocks) {
    clear_samples(few.clear, blockIdx.x - culling_blocks);
    return;
  }
  const uint32_t lane = threadIdx.x % kWarpLanes;
  const uint32_t number = blockIdx.x * kCullWarps + threadIdx.x / kWarpLanes;
  if (number >= few.group_count) return;
  const ClusterGroup at = few.groups[number];
  const SceneView& scene = few.scene;
  const FrameView& view = few.cull.view;
  FrameCounters& counters = *few.cull.counters;
  const format::InstanceRecord& instance = scene.instances[at.instance];
  const format::ChunkRecord& chunk = scene.chunks[at.chunk];
  const format::MeshRecord& mesh = scene.meshes[chunk.mesh];
  constexpr bool kFloat32 = false;  // clusters lie on a lattice
  const Transform transform = make_transform(view, scene.matrices[instance.matrix], mesh.lattice_exponent, kFloat32);
  if (!may_be_seen(transform, view, mesh_box(mesh, transform))) return;
  if (lane == 0 && at.group == 0 && at.chunk == mesh.first_chunk) {
    few.transforms[at.instance] = transform;
    WarpTeam::add(&counters.queues.instances_drawn, 1);
  }
  if (scene.pages[chunk.page] == nullptr) return;
  const RelativeBox box = chunk_box(mesh, chunk, transform);
  if (mesh.chunk_count != 1 && !may_be_seen(transform, view, box)) return;
  if (lane == 0 && at.group == 0) {
    WarpTeam::add(&counters.queues.draws, 1);
    WarpTeam::add(&counters.queues.triangles, uint64_t{chunk.triangle_count});
  }
  const ClusterDraw draw = make_cluster_draw(scene, view, few.cull.list, transform, box, at.chunk, at.instance, 0);
  if (lane == 0) WarpTeam::add(&counters.groups_tested, 1);
  if (may_show<kOrthographic, false>(few.cull, draw.filter, load_bounds(draw.group_bounds() + at.group)) !=
      BoxShows::kCenters)
    return;
  const uint32_t cluster = at.group * format::kGroupClusters + lane;
  const bool is_there = cluster < draw.cluster_count;
  const bool kept =
      is_there && may_show<kOrthographic, false>(few.cull, draw.filter, load_bounds(draw.cluster_bounds() + cluster)) ==
                      BoxShows::kCenters;
  const uint32_t lanes = __ballot_sync(~0u, kept);
  const auto tested = static_cast<uint64_t>(__popc(__ballot_sync(~0u, is_there)));
  uint64_t first = 0;
  if (lane == 0) {
    WarpTeam::add(&counters.clusters_tested, tested);
    first = WarpTeam::add(&counters.clusters[few.cull.pass], static_cast<uint64_t>(__popc(lanes)));
  }
  const uint64_t slot = __shfl_sync(~0u, first, 0) + static_cast<uint32_t>(__popc(lanes & ((1u << lane) - 1)));
  if (kept && slot < few.cull.list.item_capacity) few.cull.list.items[slot] = {number, cluster};
  if (lane == 0 && lanes != 0) few.cull.list.draws[number] = draw;
}

}  // namespace scree::kernels
