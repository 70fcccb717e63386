// Culling and the draw list on a GPU: first instances, then their chunks.
#pragma once

#include "kernels/cuda/frame/draw_list.cuh"
#include "kernels/cull/cull.h"

namespace scree::kernels {

/// One warp per chunk: finds the bounds of float32 positions. A chunk without vertices gets a box of zeros.
__global__ void __launch_bounds__(128) find_bounds(const __grid_constant__ SceneView scene, ChunkBounds* bounds) {
  const uint32_t lane = threadIdx.x % kWarpLanes;
  const uint64_t warps = uint64_t{gridDim.x} * blockDim.x / kWarpLanes;
  for (uint64_t i = (uint64_t{blockIdx.x} * blockDim.x + threadIdx.x) / kWarpLanes; i < scene.chunk_count; i += warps) {
    const format::ChunkRecord& chunk = scene.chunks[i];
    const format::MeshRecord& mesh = scene.meshes[chunk.mesh];
    if (mesh.position_encoding != format::PositionEncoding::kFloat32 || scene.pages[chunk.page] == nullptr) continue;
    const auto* positions = reinterpret_cast<const float*>(scene.pages[chunk.page] + chunk.offset +
                                                           streams_of(mesh, chunk).positions.offset);
    ChunkBounds box;
    for (int axis = 0; axis < 3; ++axis) {
      const uint64_t count = chunk.vertex_count;
      float low = count != 0 ? positions[axis] : 0.0f;
      float high = low;
      for (uint64_t v = lane; v < count; v += kWarpLanes) {
        low = fminf(low, positions[3 * v + static_cast<uint64_t>(axis)]);
        high = fmaxf(high, positions[3 * v + static_cast<uint64_t>(axis)]);
      }
      box.min[axis] = join_lanes(low, [](float a, float b) { return fminf(a, b); });
      box.max[axis] = join_lanes(high, [](float a, float b) { return fmaxf(a, b); });
    }
    if (lane == 0) bounds[i] = box;
  }
}

inline constexpr uint32_t kCullThreads = 128;
inline constexpr uint32_t kCullWarps = kCullThreads / kWarpLanes;

/// Samples that additional blocks of the first culling kernel clear. These blocks run while the others wait for memory.
struct SamplesToClear {
  uint64_t* samples;
  uint64_t count;
  uint32_t blocks;
};

__device__ inline void clear_samples(const SamplesToClear& clear, uint32_t block) {
  const uint64_t threads = uint64_t{clear.blocks} * kCullThreads;
  for (uint64_t i = uint64_t{block} * kCullThreads + threadIdx.x; i < clear.count; i += threads) {
    clear.samples[i] = kBackground;
  }
}

/// One thread per instance, in the order of meshes. Stores the transforms of all visible instances, and lists the ones
/// that are visible in the drawn rows. The last blocks clear the picture. Here and below, kClips: the view has a
/// clipping box.
template <bool kClips>
__global__ void __launch_bounds__(kCullThreads)
    cull_instances(const __grid_constant__ SceneView scene, const __grid_constant__ FrameView view,
                   const __grid_constant__ DrawList list, const __grid_constant__ SamplesToClear clear) {
  __shared__ Transform staged[kCullThreads];
  const uint32_t culling_blocks = gridDim.x - clear.blocks;
  if (blockIdx.x >= culling_blocks) {
    clear_samples(clear, blockIdx.x - culling_blocks);
    return;
  }
  const uint32_t lane = threadIdx.x % kWarpLanes;
  const uint64_t i = uint64_t{blockIdx.x} * blockDim.x + threadIdx.x;
  bool seen = false;
  bool in_rows = true;
  uint32_t number = 0;
  uint32_t mesh_number = 0;
  if (i < list.instance_count) {
    number = list.order[i];
    const format::InstanceRecord& instance = scene.instances[number];
    mesh_number = instance.mesh;
    const format::MeshRecord& mesh = scene.meshes[mesh_number];
    const Transform transform = make_transform(view, scene.matrices[instance.matrix], mesh.lattice_exponent,
                                               mesh.position_encoding == format::PositionEncoding::kFloat32);
    const RelativeBox box = mesh_box(mesh, transform);
    seen = may_be_drawn<kClips>(transform, view, box, all_rows(view));
    if (seen && leaves_out_rows(view)) in_rows = may_be_seen(transform, view, box, drawn_rows(view));
    if (seen) staged[threadIdx.x] = transform;
    seen = seen && !is_omitted(view, number);  // last: before may_be_drawn() it would take more registers
  }
  __syncwarp();
  // All lanes of the warp write one transform after the other. If each lane wrote its own, the stores would touch 32
  // times as many sectors.
  constexpr uint32_t kWords = sizeof(Transform) / sizeof(uint32_t);
  for (uint32_t left = __ballot_sync(~0u, seen); left != 0; left &= left - 1) {
    const int owner = __ffs(static_cast<int>(left)) - 1;
    const auto* from = reinterpret_cast<const uint32_t*>(staged + (threadIdx.x - lane) + owner);
    auto* to = reinterpret_cast<uint32_t*>(list.transforms + __shfl_sync(~0u, number, owner));
    for (uint32_t word = lane; word < kWords; word += kWarpLanes) to[word] = from[word];
  }
  if (const uint32_t seen_lanes = __ballot_sync(~0u, seen); lane == 0 && seen_lanes != 0)
    WarpTeam::add(&list.counters->queues.instances_drawn, static_cast<uint64_t>(__popc(seen_lanes)));
  // One addition per mesh and warp.
  const uint32_t listed_lanes = __ballot_sync(~0u, seen && in_rows);
  if (!(seen && in_rows)) return;
  const uint32_t peers = __match_any_sync(listed_lanes, mesh_number);
  const uint32_t leader = static_cast<uint32_t>(__ffs(static_cast<int>(peers))) - 1;
  uint32_t base = 0;
  if (lane == leader) base = atomicAdd(list.visible_count + mesh_number, static_cast<uint32_t>(__popc(peers)));
  base = __shfl_sync(peers, base, static_cast<int>(leader));
  const uint32_t rank = rank_among(peers);
  list.visible[list.mesh_first[mesh_number] + base + rank] = number;
}

/// Bit k is set if the chunk may be seen for the k-th of `count` visible instances from `visible` on.
template <bool kClips>
__device__ inline uint32_t seen_instances(const SceneView& scene, const FrameView& view, const DrawList& list,
                                          const format::ChunkRecord& chunk, uint32_t chunk_number,
                                          const uint32_t* visible, uint32_t count) {
  const uint32_t all = ~0u >> (32 - count);
  const format::MeshRecord& mesh = scene.meshes[chunk.mesh];
  if (mesh.chunk_count == 1) return all;  // it has been tested with its instance
  uint32_t seen = 0;
  for (uint32_t k = 0; k < count; ++k) {
    const Transform& transform = list.transforms[visible[k]];
    if (may_be_drawn<kClips>(transform, view, drawn_box(list, mesh, chunk, chunk_number, transform), drawn_rows(view)))
      seen |= 1u << k;
  }
  return seen;
}

/// One thread per candidate: appends the InstancedDraws and their prefix sum.
template <bool kClips>
__global__ void __launch_bounds__(128)
    cull_chunks(const __grid_constant__ SceneView scene, const __grid_constant__ FrameView view,
                const __grid_constant__ DrawList list) {
  const uint32_t lane = threadIdx.x % kWarpLanes;
  const uint64_t i = uint64_t{blockIdx.x} * blockDim.x + threadIdx.x;
  InstancedDraw draw{};
  uint64_t triangles = 0;
  if (i < list.candidate_count) {
    const CandidateDraw candidate = list.candidates[i];
    const format::ChunkRecord& chunk = scene.chunks[candidate.chunk];
    const uint32_t visible_count = list.visible_count[chunk.mesh];
    if (candidate.first < visible_count && scene.pages[chunk.page] != nullptr) {
      draw.chunk = candidate.chunk;
      draw.first_visible = list.mesh_first[chunk.mesh] + candidate.first;
      draw.instances =
          seen_instances<kClips>(scene, view, list, chunk, candidate.chunk, list.visible + draw.first_visible,
                                 min_of(visible_count - candidate.first, kDrawInstances));
      triangles = chunk.triangle_count;
    }
  }
  const auto draws = static_cast<uint64_t>(__popc(draw.instances));
  const uint64_t work = (triangles + kWarpLanes - 1) / kWarpLanes * draws;
  uint64_t total;
  const uint64_t packed = work == 0 ? 0 : (uint64_t{1} << kWorkBits) + work;
  const uint64_t before = sum_before(packed, lane, total);
  if (total == 0) return;
  uint64_t base = 0;
  if (lane == 0) base = WarpTeam::add(&list.counters->instanced_draws, total);
  base = __shfl_sync(~0u, base, 0);
  if (work != 0) {
    draw.work_before = (base + before) & kWorkMask;
    list.instanced_draws[(base + before) >> kWorkBits] = draw;
  }
  uint64_t all_draws;
  uint64_t all_triangles;
  sum_before(draws, lane, all_draws);
  sum_before(triangles * draws, lane, all_triangles);
  if (lane == 0) {
    WarpTeam::add(&list.counters->queues.draws, all_draws);
    WarpTeam::add(&list.counters->queues.triangles, all_triangles);
  }
}

}  // namespace scree::kernels
