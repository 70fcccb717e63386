// Culling of clustered chunks on a GPU: chunks of instances, groups of clusters, clusters. A level is tested only if
// the level above may be visible.
#pragma once

#include <bit>

#include "kernels/cuda/cull/cull.cuh"
#include "kernels/cuda/frame/cluster_list.h"
#include "kernels/cull/cluster_bounds.h"
#include "kernels/raster/mask.h"

namespace scree::kernels {

/// Counts one draw of a clustered chunk, above its work: its number of groups of clusters.
__device__ inline uint64_t packed_count(const ClusterChunk& chunk) {
  return (uint64_t{1} << kWorkBits) + (chunk.cluster_count + format::kGroupClusters - 1) / format::kGroupClusters;
}

/// The draw of a clustered chunk of an instance. `box`: the chunk's rounded_chunk_box().
__device__ inline ClusterDraw make_cluster_draw(const SceneView& scene, const FrameView& view,
                                                const ClusterList& clusters, const Transform& transform,
                                                const format::MeshRecord& mesh, const ClusterChunk& chunk,
                                                const RoundedBox& box, uint32_t chunk_number, uint32_t instance) {
  const TransformError error = error_of(transform, box);
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
               (is_double_sided(scene, mesh) ? ClusterDraw::kDoubleSided : 0u) |
               (scene.draws_blended || mask_of(scene, mesh) != nullptr ? ClusterDraw::kMasked : 0u);
  draw.first_id = scene.instance_base[instance] + chunk.first_triangle;
  draw.hint_offset = clusters.hint_offset[instance] + chunk.hint_offset;
  draw.payload = scene.pages[chunk.page] + chunk.offset;
  draw.chunk = chunk_number;
  draw.instance = instance;
  draw.cluster_count = chunk.cluster_count;
  draw.error[0] = error.x;
  draw.error[1] = error.y;
  draw.error[2] = error.w;
  return draw;
}

/// One thread per pair of a visible instance and a chunk. Makes the draws in any order, counts them by bucket and
/// stores their places. Without `sorts` all draws share one bucket. Threads with chunks of one instance read the same
/// transform. The lanes of a warp write its draws together. If each lane wrote its own, the stores would touch many
/// times as many sectors.
template <bool kClips>
__global__ void __launch_bounds__(kCullThreads)
    cull_clustered_chunks(const __grid_constant__ SceneView scene, const __grid_constant__ FrameView view,
                          const __grid_constant__ DrawList list, const __grid_constant__ ClusterList clusters,
                          bool sorts) {
  __shared__ ClusterDraw staged[kCullThreads];
  __shared__ uint64_t in_bucket[kNearBuckets];  // this block's sums; then the sums of the blocks before
  __shared__ uint64_t in_block;                 // number of draws above their work
  __shared__ uint64_t before_block;
  __shared__ uint64_t triangles_in_block;
  for (uint32_t i = threadIdx.x; i < kNearBuckets; i += kCullThreads) in_bucket[i] = 0;
  if (threadIdx.x == 0) in_block = triangles_in_block = 0;
  __syncthreads();
  const uint32_t lane = threadIdx.x % kWarpLanes;
  const uint64_t thread = uint64_t{blockIdx.x} * blockDim.x + threadIdx.x;
  ClusterDraw draw;
  uint64_t packed = 0;
  uint64_t triangles = 0;
  uint32_t bucket = kNearBuckets;  // none
  if (thread < uint64_t{clusters.candidate_count} * kDrawInstances) {
    const CandidateDraw candidate = clusters.candidates[thread / kDrawInstances];
    const uint32_t mesh_number = scene.chunks[candidate.chunk].mesh;
    const format::MeshRecord& mesh = scene.meshes[mesh_number];
    const auto first_chunk = static_cast<uint32_t>(mesh.first_chunk);
    const auto chunk_count = static_cast<uint32_t>(mesh.chunk_count);
    const uint32_t ahead = candidate.chunk - first_chunk + static_cast<uint32_t>(thread % kDrawInstances);
    const uint32_t index = candidate.first + ahead / chunk_count;
    const uint32_t chunk_number = first_chunk + ahead % chunk_count;
    const ClusterChunk chunk = clusters.chunks[chunk_number];
    if (index < list.visible_count[mesh_number] && chunk.cluster_count != 0 && scene.pages[chunk.page] != nullptr) {
      const uint32_t instance = list.visible[list.mesh_first[mesh_number] + index];
      const Transform& transform = list.transforms[instance];
      const RoundedBox box = rounded_chunk_box(mesh, chunk, transform);
      // A mesh of one chunk has been tested with its instance.
      if (chunk_count == 1 || may_be_drawn<kClips>(transform, view, box, drawn_rows(view))) {
        bucket = sorts ? near_bucket(nearness(transform.w, view, box), view.orthographic, clusters.farthest) : 0;
        packed = packed_count(chunk);
        triangles = chunk.triangle_count;
        draw = make_cluster_draw(scene, view, clusters, transform, mesh, chunk, box, chunk_number, instance);
      }
    }
  }
  const bool seen = bucket != kNearBuckets;
  uint64_t of_warp;
  uint64_t triangles_of_warp;
  const auto rank = static_cast<uint32_t>(sum_before(packed, lane, of_warp) >> kWorkBits);
  sum_before(triangles, lane, triangles_of_warp);
  ClusterDraw* const of_this_warp = staged + (threadIdx.x - lane);
  if (seen) of_this_warp[rank] = draw;
  uint64_t warp_before = 0;
  if (lane == 0 && of_warp != 0) {
    warp_before = WarpTeam::add(&in_block, of_warp);
    WarpTeam::add(&triangles_in_block, triangles_of_warp);
  }
  const auto first_in_block = static_cast<uint32_t>(__shfl_sync(~0u, warp_before, 0) >> kWorkBits);
  const uint64_t before = seen ? WarpTeam::add(in_bucket + bucket, packed) : 0;
  __syncthreads();
  if (in_block == 0) return;
  for (uint32_t i = threadIdx.x; i < kNearBuckets; i += kCullThreads) {
    if (in_bucket[i] != 0) in_bucket[i] = WarpTeam::add(list.counters->in_bucket + i, in_bucket[i]);
  }
  if (threadIdx.x == 0) {
    before_block = WarpTeam::add(&list.counters->draws, in_block);
    WarpTeam::add(&list.counters->queues.triangles, triangles_in_block);
  }
  __syncthreads();
  const uint64_t first = (before_block >> kWorkBits) + first_in_block;
  if (seen)
    clusters.places[first + rank] = {in_bucket[bucket] + before, bucket, static_cast<uint32_t>(packed & kWorkMask)};
  constexpr uint32_t kPieces = sizeof(ClusterDraw) / sizeof(uint4);
  const auto* from = reinterpret_cast<const uint4*>(of_this_warp);
  auto* to = reinterpret_cast<uint4*>(clusters.draws + first);
  const uint32_t pieces = static_cast<uint32_t>(of_warp >> kWorkBits) * kPieces;
  for (uint32_t i = lane; i < pieces; i += kWarpLanes) to[i] = from[i];
}

inline constexpr uint32_t kPlaceThreads = kNearBuckets;

/// Orders the draws by their buckets, stores the prefix sum of their work, finds the first draw of each run of work,
/// and sets kept_of_run, unless it is null, to zero. One thread per draw; in the first step, one per bucket.
__global__ void __launch_bounds__(kPlaceThreads)
    place_cluster_draws(const FrameCounters* counters, const DrawPlace* places, OrderedDraw* order,
                        uint32_t* first_of_run, uint32_t* kept_of_run) {
  __shared__ uint64_t first_of_bucket[kNearBuckets];  // sums over the buckets before: number of draws above their work
  __shared__ uint64_t of_warp[kPlaceThreads / kWarpLanes];
  const uint64_t draw_count = counters->draws >> kWorkBits;
  if (uint64_t{blockIdx.x} * kPlaceThreads >= draw_count) return;
  const uint32_t lane = threadIdx.x % kWarpLanes;
  const uint32_t warp = threadIdx.x / kWarpLanes;
  const uint32_t draw = blockIdx.x * kPlaceThreads + threadIdx.x;
  const DrawPlace place = draw < draw_count ? places[draw] : DrawPlace{};
  uint64_t all;
  uint64_t before = sum_before(counters->in_bucket[threadIdx.x], lane, all);
  if (lane == 0) of_warp[warp] = all;
  __syncthreads();
  for (uint32_t i = 0; i < warp; ++i) before += of_warp[i];
  first_of_bucket[threadIdx.x] = before;
  __syncthreads();
  if (draw >= draw_count) return;
  const uint64_t base = first_of_bucket[place.bucket] + place.before;
  const auto index = static_cast<uint32_t>(base >> kWorkBits);
  const uint64_t work = base & kWorkMask;
  order[index] = {work, draw};
  for (uint64_t run = (work + kRunWork - 1) / kRunWork; run * kRunWork < work + place.work; ++run) {
    first_of_run[run] = index;
    if (kept_of_run != nullptr) kept_of_run[run] = 0;
  }
}

/// A group of clusters.
struct DrawGroup {
  uint32_t draw;
  uint32_t group;  // number in the draw's chunk
};

/// The group with work number `start` + the lane's number. If `start` is no multiple of kRunWork, only lane 0's result
/// is valid.
__device__ inline DrawGroup group_of_lane(const ClusterList& list, uint32_t draw_count, uint64_t start) {
  // The 32 groups of a run belong to at most 32 consecutive draws.
  static_assert(kRunWork == kWarpLanes);
  const uint32_t lane = threadIdx.x % kWarpLanes;
  const uint32_t first_draw = list.first_of_run[start / kRunWork];
  const OrderedDraw mine =
      first_draw + lane < draw_count ? list.order[first_draw + lane] : OrderedDraw{~uint64_t{0}, 0};
  const uint64_t work = start + lane;
  uint32_t ahead = 0;
  for (uint32_t step = kWarpLanes / 2; step != 0; step /= 2) {
    if (__shfl_sync(~0u, mine.work_before, static_cast<int>(ahead + step)) <= work) ahead += step;
  }
  const auto group = static_cast<uint32_t>(work - __shfl_sync(~0u, mine.work_before, static_cast<int>(ahead)));
  return {__shfl_sync(~0u, mine.draw, static_cast<int>(ahead)), group};
}

/// Lists the clusters of the lanes' groups that `kept` has, from `first_slot` on (which differs between lanes).
__device__ inline void list_clusters(const ClusterList& list, const DrawGroup& of, uint32_t kept, uint64_t first_slot) {
  const uint32_t lane = threadIdx.x % kWarpLanes;
  for (uint32_t left = __ballot_sync(~0u, kept != 0); left != 0; left &= left - 1) {
    const int owner = __ffs(static_cast<int>(left)) - 1;
    const uint32_t lanes = __shfl_sync(~0u, kept, owner);
    const uint64_t slot = __shfl_sync(~0u, first_slot, owner) + rank_among(lanes);
    const uint32_t cluster = __shfl_sync(~0u, of.group, owner) * format::kGroupClusters + lane;
    const uint32_t draw = __shfl_sync(~0u, of.draw, owner);
    if ((lanes >> lane & 1) != 0 && slot < list.item_capacity) list.items[slot] = {draw, cluster};
  }
}

/// Lists the clusters of pass 1 that cull_clusters() kept, in the order of the draws: from near to far. cull_clusters()
/// itself lists runs of groups as their warps finish, and in a scene of few groups all of them run at once. One warp
/// per run.
__global__ void __launch_bounds__(kCullThreads)
    list_in_order(const __grid_constant__ ClusterList list, const FrameCounters* counters) {
  __shared__ uint32_t of_warp[kCullWarps];
  const uint32_t lane = threadIdx.x % kWarpLanes;
  const uint32_t warp = threadIdx.x / kWarpLanes;
  const uint64_t work = counters->draws & kWorkMask;
  const uint32_t first_run = blockIdx.x * kCullWarps;
  const uint32_t run = first_run + warp;
  uint32_t before = 0;  // number of clusters of earlier runs
  for (uint32_t i = threadIdx.x; i < first_run; i += kCullThreads) before += list.kept_of_run[i];
  before = sum_of_lanes(before);
  if (lane == 0) of_warp[warp] = before;
  __syncthreads();
  const uint64_t start = uint64_t{run} * kRunWork;
  if (start >= work) return;
  before = 0;
  for (uint32_t i = 0; i < kCullWarps; ++i) before += of_warp[i];
  for (uint32_t i = first_run; i < run; ++i) before += list.kept_of_run[i];
  const DrawGroup group = group_of_lane(list, static_cast<uint32_t>(counters->draws >> kWorkBits), start);
  const uint32_t kept = start + lane < work ? list.kept[start + lane] : 0;
  uint32_t all;
  const uint32_t before_lane = sum_before(static_cast<uint32_t>(__popc(kept)), lane, all);
  list_clusters(list, group, kept, before + before_lane);
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

/// The groups of a round: whole runs, up to the share ((round + 1) / rounds)^3 of all groups, from near to far.
__device__ inline WorkRange work_of_round(uint64_t total, uint32_t round, uint32_t rounds) {
  const auto end_of = [&](uint64_t round_count) {
    const uint64_t end = total * (round_count * round_count * round_count) / (uint64_t{rounds} * rounds * rounds);
    return round_count == rounds ? end : end / kRunWork * kRunWork;
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

/// One lane per group of clusters. Then, for each group that may be visible, one lane per cluster.
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
  // With few groups, each warp takes one group. Otherwise it takes 32 and tests their clusters one group after the
  // other.
  const uint32_t most = work.end - work.first <= warps ? 1 : kWarpLanes;
  // Groups take very different times, so each warp takes its next groups when it is free. The counter is read in
  // advance.
  uint32_t taken = 0;
  const auto next_start = [&] { return work.first + (warps + __shfl_sync(~0u, taken, 0)) * most; };
  for (uint64_t start = work.first + warp * most; start < work.end; start = next_start()) {
    if (lane == 0) taken = static_cast<uint32_t>(WarpTeam::add(&counters.next_run[cull.pass], uint64_t{1}));
    const uint64_t end = min_of(start + most, work.end);
    const uint64_t work_index = start + lane;
    const DrawGroup of_lane = group_of_lane(cull.list, draw_count, start);
    const uint32_t draw_number = of_lane.draw;
    const uint32_t group = of_lane.group;
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
    const bool in_order = kPass == ClusterPass::kPreviouslyVisible && cull.list.kept != nullptr;
    if (in_order && looked_at) cull.list.kept[work_index] = kept;
    if (all == 0) continue;
    uint64_t first_slot = 0;
    if (lane == 0) {
      first_slot = WarpTeam::add(&counters.clusters[cull.pass], all);
      if (in_order) atomicAdd(cull.list.kept_of_run + start / kRunWork, static_cast<uint32_t>(all));
    }
    if (in_order) continue;
    list_clusters(cull.list, of_lane, kept, first_item + __shfl_sync(~0u, first_slot, 0) + before);
  }
  tested = sum_of_lanes(tested);
  groups_tested = sum_of_lanes(groups_tested);
  if (lane == 0 && tested != 0) WarpTeam::add(&counters.clusters_tested, tested);
  if (lane == 0 && groups_tested != 0) WarpTeam::add(&counters.groups_tested, groups_tested);
}

}  // namespace scree::kernels
