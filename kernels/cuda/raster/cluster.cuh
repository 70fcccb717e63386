// Stage 1 of clusters on a GPU: one warp per cluster. Most triangles are rejected by a filter (cluster_filter.cuh). The
// few that may cover a pixel centre wait, whatever their cluster, until there are 32. They are then projected and drawn
// exactly (cluster_survivor.cuh), like the triangles of indexed chunks.
//
// Up to 16 clusters are prepared at once (cluster_run.cuh). The next cluster's data are copied to shared memory while
// one is filtered. Triangles that need clipping go to a queue of their own (cluster_clip.cuh): a call for them inside
// the loop would force the loop's values into memory.
#pragma once

#include "kernels/cuda/raster/cluster_filter.cuh"
#include "kernels/cuda/raster/cluster_survivor.cuh"

namespace scree::kernels {

/// One warp's work on the clusters to be drawn. `kParts`: the most warps that share a cluster if clusters are few. With
/// many clusters 1 is 2% faster, because it leaves out the code for parts. `kLateCull`: if a pass has many clusters in
/// comparison with pass 1, as after a jump of the camera, each run of clusters is tested against the current picture
/// just before it is drawn. It requires kParts == 1.
template <bool kOrthographic, uint32_t kParts, bool kLateCull, Alpha kAlpha>
class ClusterWarp {
  static_assert(!kLateCull || kParts == 1);

 public:
  __device__ explicit ClusterWarp(const ClusterFrame& frame) : frame_(frame), lane_(threadIdx.x % kWarpLanes) {}

  __device__ void run() {
    FrameCounters& counters = *frame_.small.list.counters;
    const uint64_t first = clusters_before(counters, frame_.pass);
    const uint64_t capacity = frame_.list.item_capacity;
    const uint64_t total = min_of(first + counters.clusters[frame_.pass], capacity) - min_of(first, capacity);
    if (total == 0) return;
    // Several warps share a cluster if a warp then draws at most 2.5 parts on average.
    if constexpr (kParts != 1) parts_ = 2 * total * kParts <= 5 * uint64_t{gridDim.x} * kClusterWarps ? kParts : 1;
    auto mask = lane_mask<kAlpha>(ClusterPlanes{&frame_}, cluster_masks);
    if constexpr (kAlpha != Alpha::kOpaque) cluster_masks().begin();
    ClusterShared& shared = cluster_shared();
    if (lane_ == 0) {
      shared.end = total * parts();
      shared.run_is_masked = 0;
    }
    if (kLateCull && lane_ == 0) {
      shared.culls_late = counters.clusters[frame_.pass] > counters.clusters[0] / kLateCullShare ? 1 : 0;
      shared.culled_late = 0;
    }
    __syncwarp();
    take_run(0, kFirstRun);
    for (;;) {
      __syncwarp();
      const uint64_t start = __shfl_sync(~0u, next_start_, 0);
      if (start >= shared.end) break;
      draw_run(first, start, static_cast<uint32_t>(min_of<uint64_t>(shared.run_share, shared.end - start)));
    }
    if (survivor_count_ != 0) flush_survivors();
    if constexpr (kAlpha != Alpha::kOpaque) mask.template finish<kOrthographic>(frame_.small.target);
    const uint64_t small = sum_of_lanes(small_);
    if (lane_ == 0 && small != 0) WarpTeam::add(&counters.queues.triangles_small, small);
    if (kLateCull && lane_ == 0 && shared.culled_late != 0)
      WarpTeam::add(&counters.clusters_culled_late, uint64_t{shared.culled_late});
  }

 private:
  // A masked or blended triangle takes so long to draw that it is worth a test whether it is hidden.
  static constexpr bool kDropsHidden = !kOrthographic && kAlpha != Alpha::kOpaque;

  // A pass is tested if it has more than a quarter of pass 1's clusters. In smaller passes hardly any cluster is
  // hidden.
  static constexpr uint64_t kLateCullShare = 4;

  // A run takes at most 1/kRunsLeft of a warp's share of the remaining clusters, so that runs shrink towards the end.
  static constexpr uint32_t kRunsLeft = 6;
  // The most clusters of a warp's first run, and the number of flushes at which a later run aims, estimated from the
  // run before. In a close-up view a cluster may take four flushes of 16 us each, so a run of 16 clusters would keep
  // its warp busy for a millisecond. After a masked cluster a run has one cluster: their triangles should be drawn from
  // near to far, as nearly as warps that run side by side can do that, because hidden ones are dropped (drop_hidden()).
  static constexpr uint32_t kFirstRun = 4;
  static constexpr uint32_t kRunFlushes = 8;

  /// Takes a run: consecutive clusters, or a part of one if warps share clusters. `taken_so_far`: the number of
  /// clusters that were taken before this warp's last run. `most`: of clusters in the run.
  __device__ void take_run(uint32_t taken_so_far, uint32_t most) {
    next_start_ = 0;
    if (lane_ != 0) return;
    ClusterShared& shared = cluster_shared();
    const uint32_t rest = static_cast<uint32_t>(shared.end) - taken_so_far;
    const uint32_t warps = gridDim.x * kClusterWarps;
    shared.run_share = min_of(max_of(rest / (kRunsLeft * warps), 1u), most);
    shared.run_flushes = 0;
    next_start_ = WarpTeam::add(&frame_.small.list.counters->next_cluster[frame_.pass], uint64_t{shared.run_share});
  }
  /// Takes the next run during the last cluster of the current one, so that the warp does not wait for the atomic's
  /// result. If it were taken earlier, its clusters would wait longer for this warp while other warps run out of work.
  __device__ void take_next_run() {
    const ClusterShared& shared = cluster_shared();
    const uint32_t flushes = max_of(shared.run_flushes, 1u);
    const bool was_masked = kDropsHidden && shared.run_is_masked != 0;
    take_run(shared.run_start,
             was_masked ? 1 : min_of(max_of(kRunFlushes * shared.run_share / flushes, 1u), kRunClusters));
  }

  /// Draws `share` clusters, beginning with number `start` of the pass, and takes the next run. `first_of_pass`: the
  /// item of the pass's first cluster. If warps share clusters, a run is one part of a cluster.
  __device__ void draw_run(uint64_t first_of_pass, uint64_t start, uint32_t share) {
    ClusterShared& shared = cluster_shared();
    const auto first = static_cast<uint32_t>(first_of_pass + start / parts());
    const auto part = static_cast<uint32_t>(start % parts());
    if (lane_ == 0) shared.run_start = static_cast<uint32_t>(start);
    uint32_t count = share;
    if constexpr (kLateCull) count = cull_late(first, count);
    if (kLateCull && count == 0) {
      take_next_run();
      return;
    }
    prepare_run<kOrthographic, kLateCull, kDropsHidden>(frame_, first, count, parts() == 1 && frame_.small.filters);
    __syncwarp();
    StageCopy<> copy;
    stage_cluster(copy, shared.run[0], shared.stages[0]);
    copy.commit();
    for (uint32_t i = 0;; ++i) {
      const PreparedCluster& cluster = shared.run[i];
      const ClusterStage& stage = shared.stages[i % 2];
      const bool is_last = (cluster.offsets & PreparedCluster::kLast) != 0;
      if (!is_last) stage_cluster(copy, shared.run[i + 1], shared.stages[(i + 1) % 2]);
      copy.commit();
      if (is_last) take_next_run();
      copy.wait();
      __syncwarp();
      if (!kOrthographic && cluster.projection.twice_slack != 0) {
        if (byte_of(cluster.codes, PreparedCluster::kBitsXyz) <= 32) {
          project_vertices<false>(cluster, stage);
        } else {
          project_vertices<true>(cluster, stage);
        }
        __syncwarp();
        const bool is_narrow = (cluster.offsets & PreparedCluster::kWideSteps) == 0;
        survivor_count_ = is_narrow && byte_of(cluster.shape, PreparedCluster::kDistanceBits) == 4
                              ? filter_triangles<true, true, false>(cluster, stage, survivor_count_, 0, 1)
                              : filter_triangles<true, false, false>(cluster, stage, survivor_count_, 0, 1);
      } else {
        filter_vertices<kOrthographic, kDropsHidden>(frame_, cluster, stage);
        __syncwarp();
        const uint32_t first_survivor = survivor_count_;
        survivor_count_ = filter_triangles<false, false, kDropsHidden>(cluster, stage, first_survivor, part, parts());
        if constexpr (kDropsHidden) {
          __syncwarp();
          survivor_count_ = drop_hidden(frame_.small, first_survivor, survivor_count_);
        }
      }
      __syncwarp();  // before set_up overwrites centers or screen_places
      // The survivors of a part of a cluster are drawn at once. Otherwise a warp would draw its last triangles by a
      // second copy of the code, which would not be in the instruction cache by then.
      while (survivor_count_ >= (parts() == 1 ? kWarpLanes : 1)) flush_survivors();
      if (is_last) break;
    }
    __syncwarp();
  }

  /// Lists in the run the items from `first` on that are drawn. Returns their number.
  __device__ uint32_t cull_late(uint32_t first, uint32_t count) {
    ClusterShared& shared = cluster_shared();
    uint32_t shown = count;
    if (shared.culls_late != 0) {
      shown = list_unoccluded<kOrthographic>(frame_, first, count);
      if (lane_ == 0) shared.culled_late += count - shown;
    } else if (lane_ < count) {
      shared.run[lane_].item = first + lane_;
    }
    __syncwarp();
    return shown;
  }

  /// Draws the last survivors, up to 32, one per lane.
  __device__ void flush_survivors() {
    ClusterShared& shared = cluster_shared();
    if (lane_ == 0) ++shared.run_flushes;
    const uint32_t count = min_of(survivor_count_, kWarpLanes);
    survivor_count_ -= count;
    Triangle triangle{};
    PixelBox box{};
    int64_t area = 0;
    int64_t pixels = 0;
    auto mask = lane_mask<kAlpha>(ClusterPlanes{&frame_}, cluster_masks);
    if (lane_ < count && project_cluster_survivor<kOrthographic>(frame_, shared.survivors[survivor_count_ + lane_],
                                                                 triangle, box, area)) {
      pixels = box.pixels();
      if constexpr (kAlpha != Alpha::kOpaque)
        triangle.is_masked = find_mask(mask, frame_, shared.survivors[survivor_count_ + lane_]);
    }
    if (draw_set_up<kOrthographic>(frame_.small.target, frame_.small.queues, shared.set_up, triangle, box, area, pixels,
                                   mask)) {
      ++small_;
    }
    __syncwarp();
  }

  __device__ uint32_t parts() const { return kParts == 1 ? 1 : parts_; }

  const ClusterFrame& frame_;
  uint32_t lane_;
  uint32_t parts_ = 1;
  uint64_t next_start_ = 0;  // of the run that was taken last; only in lane 0
  uint32_t survivor_count_ = 0;
  uint32_t small_ = 0;
};

template <bool kOrthographic, uint32_t kParts, bool kLateCull, Alpha kAlpha>
__global__ void __launch_bounds__(kClusterThreads, kAlpha != Alpha::kOpaque ? kMaskedBlocks : kClusterBlocks)
    raster_clusters(const __grid_constant__ ClusterFrame frame) {
  ClusterWarp<kOrthographic, kParts, kLateCull, kAlpha>(frame).run();
}

}  // namespace scree::kernels
