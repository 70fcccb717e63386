// Culling of clustered chunks on a GPU: chunks of instances, groups of clusters, clusters. Each level is looked at only
// where the one above is to be seen.
#pragma once

#include "kernels/cluster_bounds.h"
#include "kernels/cluster_list.h"
#include "kernels/cuda_cull.cuh"

namespace scree::kernels {

/// Which bucket a chunk's nearest point is in: w is 1 on the near plane and grows with the distance; an orthographic
/// camera's t is 1 there and 0 on the far plane. NaN is in any.
__device__ inline uint32_t near_bucket(const FrameView& view, const Transform& transform, const RelativeBox& box) {
  double at = transform.exact_w[3];
  double reach = 0;
  for (int i = 0; i < 3; ++i) {
    at += transform.exact_w[i] * box.center[i];
    reach += abs_of(transform.exact_w[i]) * box.extent[i];
  }
  if (view.orthographic) {
    const auto far = static_cast<float>((1.0 - (at + reach)) * kNearBuckets);
    return static_cast<uint32_t>(greatest(least(far, kNearBuckets - 1.0f), 0.0f));
  }
  const float nearest = greatest(static_cast<float>(at - reach), 1.0f);
  return min_of((float_bits(nearest) - float_bits(1.0f)) >> 18, kNearBuckets - 1);
}

/// One thread for each of the kGroupInstances instances of a candidate: appends the draws and their prefix sum.
__global__ void __launch_bounds__(kCullThreads)
    cull_clustered_chunks(const __grid_constant__ SceneView scene, const __grid_constant__ FrameView view,
                          const __grid_constant__ DrawList list, const __grid_constant__ ClusterList clusters) {
  __shared__ uint32_t units_by_bucket[kNearBuckets];
  for (uint32_t i = threadIdx.x; i < kNearBuckets; i += blockDim.x) units_by_bucket[i] = 0;
  __syncthreads();
  const uint32_t lane = threadIdx.x % kWarpLanes;
  const uint64_t thread = uint64_t{blockIdx.x} * blockDim.x + threadIdx.x;
  const uint64_t number = thread / kGroupInstances;
  bool seen = false;
  uint32_t instance = 0;
  Candidate candidate{};
  uint64_t units = 0;
  uint64_t triangles = 0;
  uint32_t bucket = 0;
  if (number < clusters.candidate_count) {
    candidate = clusters.candidates[number];
    const format::ChunkRecord& chunk = scene.chunks[candidate.chunk];
    const format::MeshRecord& mesh = scene.meshes[chunk.mesh];
    const uint32_t place = candidate.first + static_cast<uint32_t>(thread % kGroupInstances);
    if (place < list.visible_count[chunk.mesh] && scene.pages[chunk.page] != nullptr) {
      instance = list.visible[list.mesh_first[chunk.mesh] + place];
      const Transform& transform = list.transforms[instance];
      const RelativeBox box = chunk_box(mesh, chunk, transform);
      seen = mesh.chunk_count == 1 || may_be_seen(transform, view, box);
      bucket = near_bucket(view, transform, box);
      units = (chunk.cluster_count + format::kGroupClusters - 1) / format::kGroupClusters;
      triangles = chunk.triangle_count;
    }
  }
  if (seen) atomicAdd(units_by_bucket + bucket, static_cast<uint32_t>(units));
  __syncthreads();
  for (uint32_t i = threadIdx.x; i < kNearBuckets; i += blockDim.x) {
    if (units_by_bucket[i] != 0) atomicAdd(list.counters->units_by_bucket + i, units_by_bucket[i]);
  }
  uint64_t total;
  const uint64_t before = sum_before(seen ? (uint64_t{1} << kUnitBits) + units : 0, lane, total);
  if (total == 0) return;
  uint64_t base = 0;
  if (lane == 0) base = WarpTeam::add(&list.counters->draws, total);
  base = __shfl_sync(~0u, base, 0) + before;
  uint64_t all_triangles;
  sum_before(seen ? triangles : 0, lane, all_triangles);
  if (lane == 0) {
    WarpTeam::add(&list.counters->queues.draws, total >> kUnitBits);
    WarpTeam::add(&list.counters->queues.triangles, all_triangles);
  }
  if (!seen) return;

  const format::ChunkRecord& chunk = scene.chunks[candidate.chunk];
  const format::MeshRecord& mesh = scene.meshes[chunk.mesh];
  const Transform& transform = list.transforms[instance];
  const RelativeBox box = chunk_box(mesh, chunk, transform);
  const TransformError error = error_of(transform, box);
  ClusterDraw& draw = clusters.draws[base >> kUnitBits];
  draw.filter = make_sample_filter(view, transform, error, box, mesh, chunk);
  bool narrow = true;
  for (int i = 0; i < 4; ++i) {
    draw.x[i] = transform.x[i];
    draw.y[i] = transform.y[i];
    draw.w[i] = transform.w[i];
  }
  constexpr int64_t kNarrow = int64_t{1} << 30;
  for (int i = 0; i < 3; ++i) {
    const int64_t from = wrapping_sub(wrapping_add(mesh.lattice_min[i], static_cast<int64_t>(chunk.position_min[i])),
                                      transform.reference[i]);
    narrow = narrow && from < kNarrow && from > -kNarrow;
    draw.base[i] = static_cast<int32_t>(from);
  }
  draw.flags = (transform.mirrored ? ClusterDraw::kMirrored : 0u) | (narrow ? 0u : ClusterDraw::kFarAway) |
               (is_double_sided(scene, mesh) ? ClusterDraw::kDoubleSided : 0u);
  draw.first_id = scene.instance_base[instance] + chunk.first_triangle;
  draw.first_unit = base & kUnitMask;
  draw.first_word = clusters.first_word[instance] + clusters.chunk_group[candidate.chunk];
  draw.payload = scene.pages[chunk.page] + chunk.offset;
  draw.chunk = candidate.chunk;
  draw.instance = instance;
  draw.cluster_count = chunk.cluster_count;
  draw.error[0] = error.x;
  draw.error[1] = error.y;
  draw.error[2] = error.w;
  draw.bucket = bucket;
  draw.reserved = 0;
}

/// What the passes of culling ask.
struct ClusterTests {
  bool bounds;     // outside of the picture, or between pixel centres
  bool occlusion;  // hidden behind the pyramid
};

struct ClusterCull {
  FrameView view;
  CenterRange centers;
  ClusterList list;
  FrameCounters* counters;
  const uint64_t* samples;
  ClusterTests tests;
  uint32_t pass;    // of FrameCounters::clusters
  uint32_t round;   // of the rounds of the second pass
  uint32_t rounds;  // 1: all at once
};

/// Buckets.
struct BucketRange {
  uint32_t first;
  uint32_t end;
};

/// The buckets of a round, by a warp: the last has the farther half of all units, the one before half of the rest, and
/// so on; whole buckets.
__device__ inline BucketRange buckets_of_round(const FrameCounters& counters, uint32_t round, uint32_t rounds) {
  if (rounds <= 1) return {0, kNearBuckets};
  constexpr uint32_t kPerLane = kNearBuckets / kWarpLanes;
  const uint32_t lane = threadIdx.x % kWarpLanes;
  const uint32_t* const mine = counters.units_by_bucket + lane * kPerLane;
  uint64_t sum = 0;
  for (uint32_t i = 0; i < kPerLane; ++i) sum += mine[i];
  uint64_t total;
  const uint64_t before = sum_before(sum, lane, total);
  // A bucket belongs to the round in which it begins.
  const auto end_of = [&](uint32_t number) -> uint32_t {
    if (number + 1 >= rounds) return kNearBuckets;
    const uint64_t share = total >> (rounds - 1 - number);
    uint32_t count = 0;
    uint64_t at = before;
    for (uint32_t i = 0; i < kPerLane; ++i) {
      count += at < share ? 1 : 0;
      at += mine[i];
    }
    return __reduce_add_sync(~0u, count);
  };
  const uint32_t first = round == 0 ? 0 : end_of(round - 1);
  return {first, max_of(first, end_of(round))};
}

/// How a pass takes the bits of the clusters seen in the last frame: it draws those, or tests all and draws the others,
/// or there are none.
enum class ClusterPass : uint32_t { kSeenBefore, kNewlySeen, kOnly };

/// False only where nothing of the box can show in the picture.
template <bool kOrthographic, bool kOcclusion>
__device__ inline bool may_show(const ClusterCull& cull, const SampleFilter& filter,
                                const format::ClusterBounds& bounds) {
  ScreenBounds on_screen;
  if (!cull.tests.bounds) return true;
  if (!bound_on_screen<kOrthographic>(filter, cull.view, cull.centers, offset_box(bounds), on_screen)) return false;
  if constexpr (kOcclusion) {
    return !cull.tests.occlusion ||
           !is_hidden(cull.list.pyramid, cull.samples, on_screen.pixels, on_screen.nearest_code);
  }
  return true;
}

__device__ inline format::ClusterBounds load_bounds(const format::ClusterBounds* from) {
  const uint4 words = __ldg(reinterpret_cast<const uint4*>(from));
  return {{words.x, words.y, words.z}, words.w};
}

/// A lane a group of clusters; of those that may show, a lane a cluster.
template <bool kOrthographic, ClusterPass kPass>
__global__ void __launch_bounds__(kCullThreads) cull_clusters(const __grid_constant__ ClusterCull cull) {
  constexpr bool kOcclusion = kPass == ClusterPass::kNewlySeen;
  const uint32_t lane = threadIdx.x % kWarpLanes;
  const uint64_t warp = (uint64_t{blockIdx.x} * blockDim.x + threadIdx.x) / kWarpLanes;
  const uint64_t warps = uint64_t{gridDim.x} * blockDim.x / kWarpLanes;
  FrameCounters& counters = *cull.counters;
  const auto draw_count = static_cast<uint32_t>(counters.draws >> kUnitBits);
  const uint64_t total = counters.draws & kUnitMask;
  // The items of a later pass follow those of the ones before.
  const uint64_t first_item = clusters_before(counters, cull.pass);
  const BucketRange buckets =
      kPass == ClusterPass::kNewlySeen ? buckets_of_round(counters, cull.round, cull.rounds) : BucketRange{0, 0};
  const ClusterDraw* const draws = cull.list.draws;
  uint32_t tested = 0;
  uint32_t groups_tested = 0;
  for (uint64_t start = warp * kWarpLanes; start < total; start += warps * kWarpLanes) {
    // The draws of 32 consecutive units are at most 32 consecutive ones.
    const uint32_t first_draw = find_item(draw_count, start, lane, [&](uint32_t i) { return draws[i].first_unit; });
    const uint64_t first_unit = first_draw + lane < draw_count ? draws[first_draw + lane].first_unit : ~uint64_t{0};
    const uint64_t unit = start + lane;
    uint32_t ahead = 0;
    for (uint32_t step = kWarpLanes / 2; step != 0; step /= 2) {
      if (__shfl_sync(~0u, first_unit, static_cast<int>(ahead + step)) <= unit) ahead += step;
    }
    const uint32_t draw_number = first_draw + ahead;
    const auto group = static_cast<uint32_t>(unit - __shfl_sync(~0u, first_unit, static_cast<int>(ahead)));
    bool shows = unit < total;
    if constexpr (kPass == ClusterPass::kNewlySeen) {
      if (shows && cull.rounds > 1) {
        const uint32_t bucket = draws[draw_number].bucket;
        shows = bucket >= buckets.first && bucket < buckets.end;
      }
    }
    const bool looked_at = shows;
    uint32_t seen = 0;  // last time
    uint64_t word = 0;
    if (shows) {
      const ClusterDraw& draw = draws[draw_number];
      if constexpr (kPass != ClusterPass::kOnly) {
        word = draw.first_word + group;
        seen = cull.list.seen[word];
      }
      if constexpr (kPass == ClusterPass::kSeenBefore) {
        shows = seen != 0;
      } else {
        shows = may_show<kOrthographic, kOcclusion>(cull, draw.filter, load_bounds(draw.group_bounds() + group));
        ++groups_tested;
      }
    }
    uint32_t kept = 0;  // of this lane's group
    for (uint32_t left = __ballot_sync(~0u, shows); left != 0; left &= left - 1) {
      const int owner = __ffs(static_cast<int>(left)) - 1;
      const ClusterDraw& draw = draws[__shfl_sync(~0u, draw_number, owner)];
      const uint32_t cluster = __shfl_sync(~0u, group, owner) * format::kGroupClusters + lane;
      const uint32_t seen_there = __shfl_sync(~0u, seen, owner);
      bool keep = cluster < draw.cluster_count;
      if constexpr (kPass == ClusterPass::kSeenBefore) keep = keep && (seen_there >> lane & 1) != 0;
      if (keep) {
        keep = may_show<kOrthographic, kOcclusion>(cull, draw.filter, load_bounds(draw.cluster_bounds() + cluster));
        ++tested;
      }
      const uint32_t lanes = __ballot_sync(~0u, keep);
      if (static_cast<int>(lane) == owner) kept = lanes;
    }
    if constexpr (kPass == ClusterPass::kNewlySeen) {
      if (looked_at && kept != seen) cull.list.seen[word] = kept;
      kept &= ~seen;
    }
    uint64_t all;
    const uint64_t before = sum_before(static_cast<uint64_t>(__popc(kept)), lane, all);
    if (all == 0) continue;
    uint64_t place = 0;
    if (lane == 0) place = WarpTeam::add(&counters.clusters[cull.pass], all);
    place = first_item + __shfl_sync(~0u, place, 0) + before;
    for (uint32_t left = __ballot_sync(~0u, kept != 0); left != 0; left &= left - 1) {
      const int owner = __ffs(static_cast<int>(left)) - 1;
      const uint32_t lanes = __shfl_sync(~0u, kept, owner);
      const uint64_t slot = __shfl_sync(~0u, place, owner) + static_cast<uint32_t>(__popc(lanes & ((1u << lane) - 1)));
      const uint32_t cluster = __shfl_sync(~0u, group, owner) * format::kGroupClusters + lane;
      const uint32_t of_draw = __shfl_sync(~0u, draw_number, owner);
      if ((lanes >> lane & 1) != 0 && slot < cull.list.item_capacity) cull.list.items[slot] = {of_draw, cluster};
    }
  }
  tested = __reduce_add_sync(~0u, tested);
  groups_tested = __reduce_add_sync(~0u, groups_tested);
  if (lane == 0 && tested != 0) WarpTeam::add(&counters.clusters_tested, tested);
  if (lane == 0 && groups_tested != 0) WarpTeam::add(&counters.groups_tested, groups_tested);
}

}  // namespace scree::kernels
