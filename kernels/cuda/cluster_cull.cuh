// Culling of clustered chunks on a GPU: chunks of instances, groups of clusters, clusters. A level is tested only if
// the level above may be visible.
#pragma once

#include <bit>

#include "kernels/cuda/cluster_list.h"
#include "kernels/cuda/cull.cuh"
#include "kernels/cull/cluster_bounds.h"

namespace scree::kernels {

/// The input of a thread of the two kernels below: one of the kDrawInstances instances of a candidate.
struct CandidateInstance {
  CandidateDraw candidate;
  uint32_t index;  // index in the mesh's list of visible instances

  __device__ CandidateInstance(const ClusterList& clusters, uint64_t thread)
      : candidate(clusters.candidates[thread / kDrawInstances]),
        index(candidate.first + static_cast<uint32_t>(thread % kDrawInstances)) {}

  __device__ uint32_t instance(const DrawList& list, uint32_t mesh) const {
    return list.visible[list.mesh_first[mesh] + index];
  }
};

/// Counts one draw of a clustered chunk, above its work: its number of groups of clusters.
__device__ inline uint64_t packed_count(const format::ChunkRecord& chunk) {
  return (uint64_t{1} << kWorkBits) + (chunk.cluster_count + format::kGroupClusters - 1) / format::kGroupClusters;
}

/// Clears the sums of a block's draws by bucket, in shared memory.
__device__ inline void clear_buckets(uint64_t* buckets) {
  for (uint32_t i = threadIdx.x; i < kNearBuckets; i += kCullThreads) buckets[i] = 0;
  __syncthreads();
}

/// Finds the draws and counts them by bucket. Stores each draw's bucket in ClusterList::draw_bucket. Without `sorts`
/// all draws share one bucket.
template <bool kClips>
__global__ void __launch_bounds__(kCullThreads)
    cull_clustered_chunks(const __grid_constant__ SceneView scene, const __grid_constant__ FrameView view,
                          const __grid_constant__ DrawList list, const __grid_constant__ ClusterList clusters,
                          bool sorts) {
  __shared__ uint64_t in_bucket[kNearBuckets];
  clear_buckets(in_bucket);
  const uint32_t lane = threadIdx.x % kWarpLanes;
  const uint64_t thread = uint64_t{blockIdx.x} * blockDim.x + threadIdx.x;
  const bool inside = thread < uint64_t{clusters.candidate_count} * kDrawInstances;
  uint32_t bucket = kNearBuckets;
  uint64_t triangles = 0;
  if (inside) {
    const CandidateInstance at(clusters, thread);
    const format::ChunkRecord& chunk = scene.chunks[at.candidate.chunk];
    const format::MeshRecord& mesh = scene.meshes[chunk.mesh];
    if (at.index < list.visible_count[chunk.mesh] && scene.pages[chunk.page] != nullptr) {
      const Transform& transform = list.transforms[at.instance(list, chunk.mesh)];
      const RoundedBox box = rounded_chunk_box(mesh, chunk, transform);
      // A mesh of one chunk has been tested with its instance.
      if (mesh.chunk_count == 1 || may_be_drawn<kClips>(transform, view, box, drawn_rows(view))) {
        bucket = sorts ? near_bucket(nearness(transform.w, view, box), view.orthographic, clusters.farthest) : 0;
        triangles = chunk.triangle_count;
        atomicAdd(reinterpret_cast<unsigned long long*>(in_bucket + bucket), packed_count(chunk));
      }
    }
    clusters.draw_bucket[thread] = static_cast<uint16_t>(bucket);
  }
  __syncthreads();
  for (uint32_t i = threadIdx.x; i < kNearBuckets; i += kCullThreads) {
    if (in_bucket[i] != 0) WarpTeam::add(list.counters->in_bucket + i, in_bucket[i]);
  }
  const auto seen = static_cast<uint32_t>(__popc(__ballot_sync(~0u, bucket != kNearBuckets)));
  uint64_t all_triangles;
  sum_before(triangles, lane, all_triangles);
  if (lane == 0 && seen != 0) {
    WarpTeam::add(&list.counters->queues.draws, uint64_t{seen});
    WarpTeam::add(&list.counters->queues.triangles, all_triangles);
  }
}

__device__ inline ClusterDraw make_cluster_draw(const SceneView& scene, const FrameView& view,
                                                const ClusterList& clusters, const Transform& transform,
                                                uint32_t chunk_number, uint32_t instance, uint64_t work_before) {
  const format::ChunkRecord& chunk = scene.chunks[chunk_number];
  const format::MeshRecord& mesh = scene.meshes[chunk.mesh];
  const TransformError error = error_of(transform, rounded_chunk_box(mesh, chunk, transform));
  ClusterDraw draw{};
  draw.filter = make_coverage_filter(view, transform, error, lattice_box(transform, mesh, chunk));
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
  draw.work_before = work_before;
  draw.hint_offset = clusters.hint_offset[instance] + clusters.chunk_hint_offset[chunk_number];
  draw.payload = scene.pages[chunk.page] + chunk.offset;
  draw.chunk = chunk_number;
  draw.instance = instance;
  draw.cluster_count = chunk.cluster_count;
  draw.error[0] = error.x;
  draw.error[1] = error.y;
  draw.error[2] = error.w;
  return draw;
}

/// Writes the draws in the order of buckets, and their prefix sum. Has as many threads as cull_clustered_chunks().
__global__ void __launch_bounds__(kCullThreads)
    place_cluster_draws(const __grid_constant__ SceneView scene, const __grid_constant__ FrameView view,
                        const __grid_constant__ DrawList list, const __grid_constant__ ClusterList clusters) {
  __shared__ uint64_t first_of_bucket[kNearBuckets];  // sums over the buckets before: number of draws above their work
  __shared__ uint64_t in_bucket[kNearBuckets];        // this block's sums; then the index of its first draw
  __shared__ uint64_t before_warp[kCullWarps];
  clear_buckets(in_bucket);
  const uint32_t lane = threadIdx.x % kWarpLanes;
  const uint64_t thread = uint64_t{blockIdx.x} * blockDim.x + threadIdx.x;
  const bool inside = thread < uint64_t{clusters.candidate_count} * kDrawInstances;
  const uint32_t bucket = inside ? clusters.draw_bucket[thread] : kNearBuckets;
  const CandidateInstance at(clusters, inside ? thread : 0);
  const format::ChunkRecord& chunk = scene.chunks[at.candidate.chunk];
  const bool seen = bucket != kNearBuckets;
  uint64_t in_block = 0;
  if (seen) in_block = atomicAdd(reinterpret_cast<unsigned long long*>(in_bucket + bucket), packed_count(chunk));

  constexpr uint32_t kPerThread = kNearBuckets / kCullThreads;
  const uint64_t* const mine = list.counters->in_bucket + threadIdx.x * kPerThread;
  uint64_t sum = 0;
  for (uint32_t i = 0; i < kPerThread; ++i) sum += mine[i];
  uint64_t of_warp;
  uint64_t before = sum_before(sum, lane, of_warp);
  if (lane == 0) before_warp[threadIdx.x / kWarpLanes] = of_warp;
  __syncthreads();
  for (uint32_t i = 0; i < threadIdx.x / kWarpLanes; ++i) before += before_warp[i];
  for (uint32_t i = 0; i < kPerThread; ++i) {
    first_of_bucket[threadIdx.x * kPerThread + i] = before;
    before += mine[i];
  }
  if (blockIdx.x == 0 && threadIdx.x == kCullThreads - 1) list.counters->draws = before;
  for (uint32_t i = threadIdx.x; i < kNearBuckets; i += kCullThreads) {
    if (in_bucket[i] != 0) in_bucket[i] = WarpTeam::add(list.counters->placed + i, in_bucket[i]);
  }
  __syncthreads();
  if (!seen) return;

  const uint64_t base = first_of_bucket[bucket] + in_bucket[bucket] + in_block;
  const uint32_t instance = at.instance(list, chunk.mesh);
  clusters.draws[base >> kWorkBits] = make_cluster_draw(scene, view, clusters, list.transforms[instance],
                                                        at.candidate.chunk, instance, base & kWorkMask);
}

/// The tests of clusters. A cluster that fails one is culled.
struct ClusterTests {
  bool bounds;     // not outside the picture, nor between pixel centres
  bool occlusion;  // not behind the pyramid
};

struct ClusterCull {
  FrameView view;
  CenterRange centers;
  ClusterList list;
  FrameCounters* counters;
  const uint64_t* samples;
  ClusterTests tests;
  uint32_t pass;    // index in FrameCounters::clusters
  uint32_t round;   // round of the second pass
  uint32_t rounds;  // 1: all in one round
  uint32_t frame;   // any increasing number
  uint32_t period;  // every hint is tested again once in this many frames
};

/// Groups of clusters, numbered through all draws.
struct WorkRange {
  uint64_t first;
  uint64_t end;
};

/// The groups of a round: up to the share ((round + 1) / rounds)^3 of all groups, from near to far.
__device__ inline WorkRange work_of_round(uint64_t total, uint32_t round, uint32_t rounds) {
  const auto end_of = [&](uint64_t round_count) {
    return total * (round_count * round_count * round_count) / (uint64_t{rounds} * rounds * rounds);
  };
  return {end_of(round), end_of(round + 1)};
}
static_assert(kWorkBits + 3 * std::bit_width(kMostRounds) <= 64);

/// The clusters that a pass draws. Hints are bits of ClusterList::hints.
/// - kPreviouslyVisible draws clusters with a hint.
/// - kNewlyVisible draws clusters without a hint that pass the tests.
/// - kOnly, without hints, draws all clusters that pass the tests.
///
/// A wrong hint costs only time. Invariant: no hint may be set between the first and the second pass of one frame,
/// because the second pass skips clusters whose hint is set. A hint is tested again every few frames. A cluster that
/// only lay between pixel centres keeps its hint, so that the first pass leaves no holes when the camera moves.
enum class ClusterPass : uint32_t { kPreviouslyVisible, kNewlyVisible, kOnly };

/// The coverage of a box in the picture. A hidden box counts as outside.
template <bool kOrthographic, bool kOcclusion, bool kClips>
__device__ inline BoxCoverage may_show(const ClusterCull& cull, const CoverageFilter& filter,
                                       const format::ClusterBounds& bounds) {
  if (!cull.tests.bounds) return BoxCoverage::kCenters;
  ScreenBounds on_screen;
  const BoxCoverage shows =
      bound_on_screen<kOrthographic, kClips>(filter, cull.view, cull.centers, centered_box(bounds), on_screen);
  if constexpr (kOcclusion) {
    if (shows != BoxCoverage::kNone && cull.tests.occlusion &&
        is_occluded(cull.list.pyramid, cull.samples, on_screen.pixels, on_screen.nearest_code))
      return BoxCoverage::kNone;
  }
  return shows;
}

/// One lane per group of clusters; then, for each group that may be visible, one lane per cluster.
template <bool kOrthographic, ClusterPass kPass, bool kClips>
__global__ void __launch_bounds__(kCullThreads) cull_clusters(const __grid_constant__ ClusterCull cull) {
  constexpr bool kOcclusion = kPass == ClusterPass::kNewlyVisible;
  const uint32_t lane = threadIdx.x % kWarpLanes;
  const uint64_t warp = (uint64_t{blockIdx.x} * blockDim.x + threadIdx.x) / kWarpLanes;
  const uint64_t warps = uint64_t{gridDim.x} * blockDim.x / kWarpLanes;
  FrameCounters& counters = *cull.counters;
  const auto draw_count = static_cast<uint32_t>(counters.draws >> kWorkBits);
  // The items of a pass follow those of earlier passes.
  const uint64_t first_item = clusters_before(counters, cull.pass);
  const WorkRange work = work_of_round(counters.draws & kWorkMask, cull.round, cull.rounds);
  const ClusterDraw* const draws = cull.list.draws;
  uint32_t tested = 0;
  uint32_t groups_tested = 0;
  // With few groups, each warp takes one: its clusters are tested one group after the other.
  const uint32_t most = work.end - work.first <= warps ? 1 : kWarpLanes;
  // Groups take very different times, so warps take their next ones as they come. The counter is read in advance.
  uint32_t taken = 0;
  const auto next_start = [&] { return work.first + (warps + __shfl_sync(~0u, taken, 0)) * most; };
  for (uint64_t start = work.first + warp * most; start < work.end; start = next_start()) {
    if (lane == 0) taken = static_cast<uint32_t>(WarpTeam::add(&counters.next_run[cull.pass], uint64_t{1}));
    const uint64_t end = min_of(start + most, work.end);
    // 32 consecutive groups belong to at most 32 consecutive draws.
    const uint32_t first_draw = find_draw(draw_count, start, lane, [&](uint32_t i) { return draws[i].work_before; });
    const uint64_t work_before = first_draw + lane < draw_count ? draws[first_draw + lane].work_before : ~uint64_t{0};
    const uint64_t work_index = start + lane;
    uint32_t ahead = 0;
    for (uint32_t step = kWarpLanes / 2; step != 0; step /= 2) {
      if (__shfl_sync(~0u, work_before, static_cast<int>(ahead + step)) <= work_index) ahead += step;
    }
    const uint32_t draw_number = first_draw + ahead;
    const auto group = static_cast<uint32_t>(work_index - __shfl_sync(~0u, work_before, static_cast<int>(ahead)));
    bool shows = work_index < end;
    const bool looked_at = shows;
    uint32_t old_hints = 0;  // of the last frame
    uint32_t hints = 0;      // for the next frame
    bool retests = true;
    uint64_t word = 0;
    if (shows) {
      const ClusterDraw& draw = draws[draw_number];
      if constexpr (kPass != ClusterPass::kOnly) {
        word = draw.hint_offset + group;
        old_hints = cull.list.hints[word];
      }
      if constexpr (kPass == ClusterPass::kPreviouslyVisible) {
        shows = old_hints != 0;
        if (shows) {
          shows = may_show<kOrthographic, false, kClips>(cull, draw.filter, load_bounds(draw.group_bounds() + group)) ==
                  BoxCoverage::kCenters;
          ++groups_tested;
        }
      } else {
        const uint32_t rest = draw.cluster_count - group * format::kGroupClusters;
        const uint32_t whole_group = rest >= format::kGroupClusters ? ~0u : (1u << rest) - 1;
        if constexpr (kOcclusion) retests = (static_cast<uint32_t>(word) + cull.frame) % cull.period == 0;
        if (!retests && old_hints == whole_group) {
          hints = whole_group;
          shows = false;
        } else {
          const BoxCoverage in_group =
              may_show<kOrthographic, kOcclusion, kClips>(cull, draw.filter, load_bounds(draw.group_bounds() + group));
          if (in_group == BoxCoverage::kBetween) hints = whole_group;
          shows = in_group == BoxCoverage::kCenters;
          ++groups_tested;
        }
      }
    }
    uint32_t kept = 0;  // clusters of this lane's group
    for (uint32_t left = __ballot_sync(~0u, shows); left != 0; left &= left - 1) {
      const int owner = __ffs(static_cast<int>(left)) - 1;
      const ClusterDraw& draw = draws[__shfl_sync(~0u, draw_number, owner)];
      const uint32_t cluster = __shfl_sync(~0u, group, owner) * format::kGroupClusters + lane;
      const uint32_t hints_there = __shfl_sync(~0u, old_hints, owner);
      bool keep = cluster < draw.cluster_count;
      const bool had_hint = (hints_there >> lane & 1) != 0;
      if constexpr (kPass == ClusterPass::kPreviouslyVisible) keep = keep && had_hint;
      bool hint = false;
      if constexpr (kPass == ClusterPass::kNewlyVisible) {
        const bool retested = __shfl_sync(~0u, retests ? 1 : 0, owner) != 0;
        hint = keep && had_hint && !retested;
        keep = keep && !hint;
      }
      if (keep) {
        const BoxCoverage in_cluster = may_show<kOrthographic, kOcclusion, kClips>(
            cull, draw.filter, load_bounds(draw.cluster_bounds() + cluster));
        keep = in_cluster == BoxCoverage::kCenters;
        hint = in_cluster != BoxCoverage::kNone;
        ++tested;
      }
      const uint32_t lanes = __ballot_sync(~0u, keep);
      if (static_cast<int>(lane) == owner) kept = lanes;
      if constexpr (kPass == ClusterPass::kNewlyVisible) {
        const uint32_t hinted = __ballot_sync(~0u, hint);
        if (static_cast<int>(lane) == owner) hints = hinted;
      }
    }
    if constexpr (kPass == ClusterPass::kNewlyVisible) {
      if (looked_at && hints != old_hints) cull.list.hints[word] = hints;
      kept &= ~old_hints;
    }
    uint64_t all;
    const uint64_t before = sum_before(static_cast<uint64_t>(__popc(kept)), lane, all);
    if (all == 0) continue;
    uint64_t first_slot = 0;
    if (lane == 0) first_slot = WarpTeam::add(&counters.clusters[cull.pass], all);
    first_slot = first_item + __shfl_sync(~0u, first_slot, 0) + before;
    for (uint32_t left = __ballot_sync(~0u, kept != 0); left != 0; left &= left - 1) {
      const int owner = __ffs(static_cast<int>(left)) - 1;
      const uint32_t lanes = __shfl_sync(~0u, kept, owner);
      const uint64_t slot =
          __shfl_sync(~0u, first_slot, owner) + static_cast<uint32_t>(__popc(lanes & ((1u << lane) - 1)));
      const uint32_t cluster = __shfl_sync(~0u, group, owner) * format::kGroupClusters + lane;
      const uint32_t of_draw = __shfl_sync(~0u, draw_number, owner);
      if ((lanes >> lane & 1) != 0 && slot < cull.list.item_capacity) cull.list.items[slot] = {of_draw, cluster};
    }
  }
  tested = sum_of_lanes(tested);
  groups_tested = sum_of_lanes(groups_tested);
  if (lane == 0 && tested != 0) WarpTeam::add(&counters.clusters_tested, tested);
  if (lane == 0 && groups_tested != 0) WarpTeam::add(&counters.groups_tested, groups_tested);
}

}  // namespace scree::kernels
