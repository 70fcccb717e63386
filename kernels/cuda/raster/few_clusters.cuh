// Stage 1 of clusters where they are few: a block per cluster, so that the whole GPU works on them.
#pragma once

#include "kernels/cuda/raster/cluster_survivor.cuh"

namespace scree::kernels {

/// Blocks per multiprocessor, by their shared memory. More than 8 would leave too few registers.
inline constexpr uint32_t kFewClusterBlocks =
    blocks_in_shared(kClusterWarps * sizeof(SetUpTriangles) + format::kMaxClusterVertices * sizeof(ScreenVertex), 8);

/// Projects a vertex of a cluster exactly. `code`: its lattice offset from the smallest of the cluster's `bounds`.
template <bool kOrthographic>
__device__ inline ScreenVertex project_cluster_vertex(const FrameView& view, const ClusterDraw& draw,
                                                      const format::ClusterBounds& bounds, const uint32_t code[3]) {
  if ((draw.flags & ClusterDraw::kFarAway) != 0) return {0, 0, 0.0f, kNeedsClip};
  float position[3];
  for (int k = 0; k < 3; ++k)
    position[k] = static_cast<float>(draw.base[k] + static_cast<int32_t>(format::bounds_min(bounds, k) + code[k]));
  const ProjectedPoint point =
      project_point<kOrthographic>(draw.x, draw.y, draw.w, position[0], position[1], position[2]);
  // Without growth the filter shows that no vertex of the chunk needs clipping.
  const uint32_t flags = draw.filter.growth != 0.0f
                             ? plane_flags<kOrthographic>(point, view, draw.error[0], draw.error[1], draw.error[2])
                             : 0;
  return snap_point(point, view, flags);
}

/// Draws the clusters of a pass: one thread per vertex, then one per triangle. There is no filter and no staging, and
/// no vertex is read twice. A triangle that needs clipping is queued, unless it lies outside the picture.
template <bool kOrthographic, Alpha kAlpha>
__global__ void __launch_bounds__(kClusterThreads, kAlpha != Alpha::kOpaque ? kMaskedBlocks : kFewClusterBlocks)
    raster_few_clusters(const __grid_constant__ ClusterFrame frame) {
  static_assert(kClusterThreads >= format::kMaxClusterVertices && kClusterThreads >= format::kMaxClusterTriangles);
  __shared__ ScreenVertex vertices[format::kMaxClusterVertices];
  __shared__ SetUpTriangles set_up_triangles[kClusterWarps];
  [[maybe_unused]] ClusterWaiting* const masks = block_masks<kAlpha>();
  const auto new_mask = [&] {
    return lane_mask<kAlpha>(ClusterPlanes{&frame}, [&]() -> ClusterWaiting& { return *masks; });
  };
  if constexpr (kAlpha != Alpha::kOpaque) masks->begin();
  FrameCounters& counters = *frame.small.list.counters;
  const FrameView& view = frame.small.view;
  const uint32_t thread = threadIdx.x;
  const auto end = static_cast<uint32_t>(min_of(counters.clusters[frame.pass], frame.list.item_capacity));
  uint32_t small = 0;
  for (uint32_t i = blockIdx.x; i < end; i += gridDim.x) {
    const ClusterItem item = frame.list.items[i];
    const ClusterDraw& draw = frame.list.draws[item.draw];
    const uint4 record = __ldg(reinterpret_cast<const uint4*>(draw.clusters() + item.cluster));
    const format::ClusterBounds bounds = load_bounds(draw.cluster_bounds() + item.cluster);
    const format::ClusterReader reader = format::make_cluster_reader({record.x, record.y, record.z, record.w}, bounds,
                                                                     reinterpret_cast<const std::byte*>(draw.data()));
    const bool has_triangle = thread < reader.layout.triangle_count;
    uint32_t corner[3] = {};
    if (has_triangle) reader.triangle(thread, corner);
    if (thread < reader.layout.vertex_count) {
      uint32_t code[3];
      reader.stored(thread, code);
      reader.predictor.apply(code);
      vertices[thread] = project_cluster_vertex<kOrthographic>(view, draw, bounds, code);
    }
    __syncthreads();
    const SurvivorTriangle numbers{i, thread | corner[0] << 7 | corner[1] << 14 | corner[2] << 21};
    const uint32_t number = reader.first_triangle + thread;
    const ScreenVertex a = vertices[corner[0]];
    const ScreenVertex b = vertices[corner[1]];
    const ScreenVertex c = vertices[corner[2]];
    __syncthreads();  // before the next cluster's vertices
    Triangle triangle{};
    PixelBox box{};
    int64_t area = 0;
    int64_t pixels = 0;
    auto mask = new_mask();
    if (has_triangle && ((a.flags | b.flags | c.flags) & kNeedsClip) != 0) {
      if ((a.flags & b.flags & c.flags & kOutsideMask) == 0)
        push(WarpTeam{}, &counters.to_clip, frame.list.to_clip, frame.list.clip_capacity,
             ClipItem{numbers, draw.instance, draw.chunk, number});
    } else if (has_triangle && set_up(view, a, b, c, draw.first_id + number, (draw.flags & ClusterDraw::kMirrored) != 0,
                                      (draw.flags & ClusterDraw::kDoubleSided) != 0, triangle, box, area)) {
      pixels = box.pixels();
      if constexpr (kAlpha != Alpha::kOpaque) triangle.is_masked = find_mask(mask, frame, numbers);
    }
    if (draw_set_up<kOrthographic>(frame.small.target, frame.small.queues, set_up_triangles[thread / kWarpLanes],
                                   triangle, box, area, pixels, mask))
      ++small;
  }
  if constexpr (kAlpha != Alpha::kOpaque) new_mask().template finish<kOrthographic>(frame.small.target);
  small = sum_of_lanes(small);
  if (thread % kWarpLanes == 0 && small != 0) WarpTeam::add(&counters.queues.triangles_small, uint64_t{small});
}

}  // namespace scree::kernels
