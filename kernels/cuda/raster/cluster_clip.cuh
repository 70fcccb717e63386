// Clips the triangles of clusters that need it, and draws the remaining pieces.
#pragma once

#include "kernels/cuda/raster/cluster_survivor.cuh"

namespace scree::kernels {

inline constexpr uint32_t kNearClippedBlocks = 4;  // of a multiprocessor

/// Clips a triangle of a cluster at the near plane. Returns false if it needs other clipping, or if its reference is
/// too far away for int32.
__device__ inline bool clip_survivor_near(const ClusterFrame& frame, const SurvivorReader& reader, NearPolygon& out) {
  if ((reader.draw.flags & ClusterDraw::kFarAway) != 0) return false;
  const Transform& transform = frame.small.list.transforms[reader.draw.instance];
  ClipVertex corners[3];
  for (uint32_t i = 0; i < 3; ++i) {
    int32_t position[3];
    reader.relative(i, position);
    const double exact[3] = {static_cast<double>(position[0]), static_cast<double>(position[1]),
                             static_cast<double>(position[2])};
    corners[i] = clip_vertex(transform, exact, snap_point(reader.project<false>(position), frame.small.view, 0));
  }
  return clip_near(corners, frame.small.view, out);
}

/// Clips up to 32 triangles of clusters, one per lane, and draws their remaining pieces. Returns counts in the form of
/// clip_and_draw(). `masks`: null if all triangles are opaque.
template <Alpha kAlpha>
__device__ inline uint32_t draw_near_clipped(const ClusterFrame& frame, const ClipItem& item, bool has_one,
                                             SetUpTriangles& set_up, [[maybe_unused]] ClusterWaiting* masks) {
  const SurvivorReader reader(frame, item.survivor);
  NearPolygon polygon;
  uint32_t drawn = 0;
  if (has_one) {
    if (clip_survivor_near(frame, reader, polygon)) {
      drawn = 1u << 16;
    } else {
      polygon.count = 0;
      drawn = clip_and_draw<false, kAlpha>(frame.small, item.instance, item.chunk, item.triangle);
    }
  }
  auto mask = lane_mask<kAlpha>(ClusterPlanes{&frame}, [&]() -> ClusterWaiting& { return *masks; });
  [[maybe_unused]] uint32_t is_masked = 0;
  if constexpr (kAlpha != Alpha::kOpaque) is_masked = find_mask(mask, frame, item.survivor);
    // A polygon of 4 corners is drawn as two triangles.
#pragma unroll 1
  for (int i = 2; i < 4; ++i) {
    Triangle triangle{};
    PixelBox box{};
    int64_t area = 0;
    int64_t pixels = 0;
    if (i < polygon.count &&
        reader.set_up(frame.small.view, polygon.corner[0], polygon.corner[1], polygon.corner[2], triangle, box, area))
      pixels = box.pixels();
    if constexpr (kAlpha != Alpha::kOpaque) triangle.is_masked = is_masked;
    if (draw_set_up<false>(frame.small.target, frame.small.queues, set_up, triangle, box, area, pixels, mask)) ++drawn;
    polygon.corner[1] = polygon.corner[2];
    polygon.corner[2] = polygon.corner[3];
  }
  return drawn;
}

/// Draws the triangles of clusters that need clipping, or whose reference is too far away for int32, one per thread.
/// Neighbours in the queue go to different warps, because hardly any two take the same branches.
template <bool kOrthographic, Alpha kAlpha>
__global__ void __launch_bounds__(kClusterThreads) raster_clipped(const __grid_constant__ ClusterFrame frame) {
  FrameCounters& counters = *frame.small.list.counters;
  const uint64_t count = min_of(counters.to_clip, frame.list.clip_capacity);
  const uint64_t threads = uint64_t{gridDim.x} * kClusterThreads;
  const uint64_t warp = uint64_t{blockIdx.x} * kClusterWarps + threadIdx.x / kWarpLanes;
  const uint64_t first = counters.to_clip_drawn + threadIdx.x % kWarpLanes * (threads / kWarpLanes) + warp;
  for (uint64_t i = first; i < count; i += threads) {
    const ClipItem item = frame.list.to_clip[i];
    const uint32_t drawn = clip_and_draw<kOrthographic, kAlpha>(frame.small, item.instance, item.chunk, item.triangle);
    WarpTeam::add(&counters.queues.triangles_small, drawn & 0xffffu);
    WarpTeam::add(&counters.queues.triangles_clipped, drawn >> 16);
  }
}

/// As above, for a perspective camera and many triangles. Neighbours in the queue go to one warp. Triangles that only
/// the near plane cuts are clipped in registers (clip_near).
template <Alpha kAlpha>
__global__ void __launch_bounds__(kClusterThreads, kNearClippedBlocks)
    raster_near_clipped(const __grid_constant__ ClusterFrame frame) {
  __shared__ SetUpTriangles set_up[kClusterWarps];
  FrameCounters& counters = *frame.small.list.counters;
  const uint64_t end = min_of(counters.to_clip, frame.list.clip_capacity);
  const uint64_t threads = uint64_t{gridDim.x} * kClusterThreads;
  const uint32_t lane = threadIdx.x % kWarpLanes;
  const uint32_t warp = threadIdx.x / kWarpLanes;
  ClusterWaiting* const masks = block_masks<kAlpha>();
  auto mask = lane_mask<kAlpha>(ClusterPlanes{&frame}, [&]() -> ClusterWaiting& { return *masks; });
  if constexpr (kAlpha != Alpha::kOpaque) masks->begin();
  uint32_t small = 0;
  uint32_t clipped = 0;
  for (uint64_t first = counters.to_clip_drawn + uint64_t{blockIdx.x} * kClusterThreads + warp * kWarpLanes;
       first < end; first += threads) {
    const bool has_one = first + lane < end;
    const uint32_t drawn = draw_near_clipped<kAlpha>(frame, frame.list.to_clip[has_one ? first + lane : first], has_one,
                                                     set_up[warp], masks);
    small += drawn & 0xffffu;
    clipped += drawn >> 16;
  }
  if constexpr (kAlpha != Alpha::kOpaque) mask.template finish<false>(frame.small.target);
  small = sum_of_lanes(small);
  clipped = sum_of_lanes(clipped);
  if (lane != 0) return;
  if (small != 0) WarpTeam::add(&counters.queues.triangles_small, uint64_t{small});
  if (clipped != 0) WarpTeam::add(&counters.queues.triangles_clipped, uint64_t{clipped});
}

}  // namespace scree::kernels
