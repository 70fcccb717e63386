// The queues of a frame on a GPU. They grow when a frame needed more than they hold.
#pragma once

#include "kernels/cuda/common/device_array.h"
#include "kernels/cuda/frame/cluster_list.h"
#include "kernels/cuda/frame/frame.h"

namespace scree::kernels {

/// Triangles that stage 1 passes to stages 2 and 3.
struct TriangleQueues {
  DeviceArray<Triangle> medium;
  DeviceArray<Triangle> large;
  DeviceArray<TileItem> tiles;  // never grow: tiles without room are drawn at once

  Queues view(Counters* counters) const {
    return {nullptr,        medium.data(), large.data(),  tiles.data(), 0,
            medium.count(), large.count(), tiles.count(), counters};
  }
};

struct FrameQueues {
  TriangleQueues triangles;
  // For clustered chunks:
  DeviceArray<ClusterItem> items;
  DeviceArray<ClipItem> to_clip;
  TriangleQueues clipped;  // pieces of clipped triangles, if clipping has its own stream

  /// Grows the queues to at least `wanted`, without tiles. A queue that grows loses its contents. Errors kDevice.
  Result<void> grow(const CudaQueueSizes& wanted) {
    constexpr const char* kWhat = "allocating the queues; --backend cpu draws without them";
    // Indices into them are 32-bit numbers.
    constexpr uint64_t kMost = UINT32_MAX;
    SCREE_TRY(triangles.medium.grow(wanted.medium, kWhat));
    SCREE_TRY(triangles.large.grow(min_of(wanted.large, kMost), kWhat));
    SCREE_TRY(items.grow(min_of(wanted.clusters, kMost), kWhat));
    SCREE_TRY(to_clip.grow(wanted.to_clip, kWhat));
    SCREE_TRY(clipped.medium.grow(wanted.clipped, kWhat));
    return clipped.large.grow(min_of(wanted.clipped, kMost), kWhat);
  }

  /// The sizes that the frame needed. Queues that overflowed get 1 / `part` on top, unless `part` is 0.
  CudaQueueSizes needed(const FrameCounters& counters, uint64_t part) const {
    const auto more = [part](uint64_t count, uint64_t there) {
      return count > there && part != 0 ? count + count / part : count;
    };
    return {more(counters.queues.medium, triangles.medium.count()),
            more(counters.queues.large, triangles.large.count()),
            0,
            more(clusters_before(counters, kClusterPasses), items.count()),
            more(counters.to_clip, to_clip.count()),
            more(max_of(counters.clipped.medium, counters.clipped.large),
                 min_of(clipped.medium.count(), clipped.large.count())),
            0,
            0};
  }

  /// Whether the queue of clusters or of triangles to clip was too small.
  bool lost_clusters(const FrameCounters& counters) const {
    const CudaQueueSizes wanted = needed(counters, 0);
    return wanted.clusters > items.count() || wanted.to_clip > to_clip.count();
  }

  bool had_room(const FrameCounters& counters) const {
    const CudaQueueSizes wanted = needed(counters, 0);
    return wanted.medium <= triangles.medium.count() && wanted.large <= triangles.large.count() &&
           wanted.clusters <= items.count() && wanted.to_clip <= to_clip.count() &&
           wanted.clipped <= min_of(clipped.medium.count(), clipped.large.count());
  }
};

}  // namespace scree::kernels
