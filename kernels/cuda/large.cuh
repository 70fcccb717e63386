// Stages 2 and 3 on a GPU: a warp a medium triangle, a warp a tile of a large one.
#pragma once

#include "kernels/cuda/backend.cuh"
#include "kernels/cuda/cull.cuh"
#include "kernels/cuda/masks.cuh"
#include "kernels/raster/large.h"

namespace scree::kernels {

template <bool kMasked>
struct LargeFrame {
  FrameView view;
  Target target;
  Queues queues;
  const DrawnTriangles* drawn;
  MaskSource<kMasked> masks;
};

inline constexpr uint32_t kLargeThreads = 256;
// Blocks of a multiprocessor, all at once.
inline constexpr uint32_t kMediumBlocks = 3;
inline constexpr uint32_t kLargeBlocks = 4;

/// Tiles are drawn in strips of so many rows.
inline constexpr int32_t kStripRows = 8;
inline constexpr uint32_t kStrips = kTileSide / kStripRows;

/// `rows` rows of a box, after `part` times as many; may be empty.
__device__ inline PixelBox rows_of(const PixelBox& box, uint32_t part, int32_t rows) {
  PixelBox out = box;
  out.y0 = box.y0 + static_cast<int32_t>(part) * rows;
  out.y1 = min_of(box.y1, out.y0 + rows - 1);
  return out;
}

/// Calls draw(mask) with what the samples of a warp's triangle are tested by. One lane makes the plane for all.
template <bool kOrthographic, bool kMasked, class Draw>
__device__ inline void with_warp_mask(const LargeFrame<kMasked>& frame, const Triangle& triangle, const Draw& draw) {
  if constexpr (kMasked) {
    if (triangle.is_masked != 0) {
      __shared__ MaskPlane planes[kLargeThreads / kWarpLanes];
      MaskPlane& plane = planes[threadIdx.x / kWarpLanes];
      if (threadIdx.x % kWarpLanes == 0)
        frame.masks.template make_plane<kOrthographic>(WarpTeam{}, frame.view, triangle.id, plane);
      __syncwarp();
      draw(WarpPlane{&plane});
      __syncwarp();
      return;
    }
  }
  draw(NoMask{});
}

/// Appends the tiles that a large triangle may touch, by a warp: counts them first, since each addition to the queue's
/// counter is waited for. What the queue has no room for is drawn at once.
template <bool kOrthographic, bool kMasked>
__device__ inline void split_triangle(const LargeFrame<kMasked>& frame, uint32_t number) {
  const Queues& queues = frame.queues;
  const uint32_t lane = threadIdx.x % kWarpLanes;
  const Triangle triangle = queues.large[number];
  const LargeTiles tiles(triangle, frame.view);
  const TileTest test(triangle);
  uint32_t count = 0;
  for (uint32_t i = lane; i < tiles.count(); i += kWarpLanes) {
    uint32_t x;
    uint32_t y;
    tiles.tile(i, x, y);
    if (test.may_cover(x, y)) ++count;
  }
  uint64_t next = 0;
  if (const uint32_t all = sum_of_lanes(count); lane == 0) next = WarpTeam::add(&queues.counters->tiles, uint64_t{all});
  next = __shfl_sync(~0u, next, 0);
  for (uint32_t base = 0; base < tiles.count(); base += kWarpLanes) {
    uint32_t x;
    uint32_t y;
    tiles.tile(base + lane, x, y);
    const bool touches = base + lane < tiles.count() && test.may_cover(x, y);
    const uint32_t lanes = __ballot_sync(~0u, touches);
    const uint64_t slot = next + static_cast<uint32_t>(__popc(lanes & ((1u << lane) - 1)));
    next += static_cast<uint32_t>(__popc(lanes));
    const bool kept = slot < queues.tile_capacity;
    if (touches && kept) {
      queues.tiles[slot] = {number, static_cast<uint16_t>(x), static_cast<uint16_t>(y)};
    }
    if (next <= queues.tile_capacity) continue;
    for (uint32_t left = __ballot_sync(~0u, touches && !kept); left != 0; left &= left - 1) {
      const int owner = __ffs(static_cast<int>(left)) - 1;
      const PixelBox box = tile_box(triangle, frame.view, static_cast<int32_t>(__shfl_sync(~0u, x, owner)),
                                    static_cast<int32_t>(__shfl_sync(~0u, y, owner)));
      if (box.empty()) continue;
      with_warp_mask<kOrthographic>(frame, triangle, [&](const auto& mask) {
        draw_box_with_team<kOrthographic, int64_t>(WarpTeam{}, frame.target, triangle, box,
                                                   doubled_area(triangle.x, triangle.y), mask);
      });
    }
  }
}

/// Splits the large queue into tiles, a triangle a warp.
template <bool kOrthographic, bool kMasked>
__global__ void __launch_bounds__(kLargeThreads, kLargeBlocks)
    split_large(const __grid_constant__ LargeFrame<kMasked> frame) {
  const uint64_t warp = (uint64_t{blockIdx.x} * blockDim.x + threadIdx.x) / kWarpLanes;
  const uint64_t warps = uint64_t{gridDim.x} * blockDim.x / kWarpLanes;
  const uint64_t large = min_of(frame.queues.counters->large, frame.queues.large_capacity);
  for (uint64_t i = frame.drawn->large + warp; i < large; i += warps)
    split_triangle<kOrthographic>(frame, static_cast<uint32_t>(i));
}

/// Larger boxes of the medium queue are drawn in so many parts.
inline constexpr uint32_t kMediumParts = 4;
inline constexpr int64_t kWholeBox = 512;  // pixels

/// Draws one part of a triangle of the medium queue, or all of it where it has but one.
template <bool kOrthographic, bool kMasked>
__device__ inline void draw_medium_part(const LargeFrame<kMasked>& frame, const Triangle& triangle, uint32_t part) {
  const PixelBox whole = pixel_box(triangle.x, triangle.y, frame.view);
  const int32_t rows = (whole.y1 - whole.y0) / static_cast<int32_t>(kMediumParts) + 1;
  const PixelBox box = whole.pixels() > kWholeBox ? rows_of(whole, part, rows) : whole;
  if (box.empty()) return;
  const int64_t area = doubled_area(triangle.x, triangle.y);
  with_warp_mask<kOrthographic>(frame, triangle, [&](const auto& mask) {
    if (fits_narrow_edges(triangle.x, triangle.y)) {
      draw_box_with_team<kOrthographic, int32_t>(WarpTeam{}, frame.target, triangle, box, area, mask);
    } else {
      draw_box_with_team<kOrthographic, int64_t>(WarpTeam{}, frame.target, triangle, box, area, mask);
    }
  });
}

/// Draws the medium queue, a triangle or a part of one per warp. First come whole triangles and part 0 of split ones;
/// then the remaining parts, spread over the warps, so that no warp draws all parts of a triangle. Few triangles are
/// split: a warp's lanes test 32 candidates at a time.
template <bool kOrthographic, bool kMasked>
__global__ void __launch_bounds__(kLargeThreads, kMediumBlocks)
    raster_medium(const __grid_constant__ LargeFrame<kMasked> frame) {
  const uint32_t lane = threadIdx.x % kWarpLanes;
  const uint64_t warp = (uint64_t{blockIdx.x} * blockDim.x + threadIdx.x) / kWarpLanes;
  const uint64_t warps = uint64_t{gridDim.x} * blockDim.x / kWarpLanes;
  const uint64_t from = min_of(frame.drawn->medium, frame.queues.medium_capacity);
  const uint64_t medium = min_of(frame.queues.counters->medium, frame.queues.medium_capacity) - from;
  const Triangle* const triangles = frame.queues.medium + from;
  uint64_t first = warp;  // triangle whose first part is next
  uint64_t next = warp;   // the other parts, one after the other: those to be looked at next
  uint64_t found = 0;     // by this lane
  uint32_t left = 0;      // lanes that have found one
  for (;;) {
    uint64_t number = first;
    uint32_t part = 0;
    if (first < medium) {
      first += warps;
    } else {
      for (; left == 0 && next < medium * (kMediumParts - 1); next += warps * kWarpLanes) {
        found = medium + next + lane * warps;
        const bool inside = found < medium * kMediumParts;
        const Triangle& looked_at = triangles[inside ? found % medium : 0];
        left = __ballot_sync(~0u, inside && pixel_box(looked_at.x, looked_at.y, frame.view).pixels() > kWholeBox);
      }
      if (left == 0) break;
      number = __shfl_sync(~0u, found, __ffs(static_cast<int>(left)) - 1);
      left &= left - 1;
      for (; number >= medium; number -= medium) ++part;
    }
    draw_medium_part<kOrthographic>(frame, triangles[number], part);
  }
}

/// The edge functions of a strip's pixels by additions of 32 bits: a step of one pixel changes them by a multiple of
/// 256, corners lie within 2^23 sub-pixels of the image's centre, and so what is above bit 7 changes by less than 2^31
/// from one end of a strip to the other.
struct StripEdges {
  int32_t high[3];     // at the strip's first pixel: bit 24 and on
  int32_t low[3];      // bits 8 to 23
  uint32_t lowest[3];  // bits 0 to 7, the same at all pixels
  int32_t right[3];    // what `low` changes by to the next pixel right
  int32_t down[3];

  __device__ explicit StripEdges(const Edges<int64_t>& edges) {
    for (int e = 0; e < 3; ++e) {
      high[e] = static_cast<int32_t>(edges.value[e] >> 24);
      low[e] = static_cast<int32_t>(edges.value[e] >> 8 & 0xffff);
      lowest[e] = static_cast<uint32_t>(edges.value[e] & 0xff);
      right[e] = static_cast<int32_t>(edges.step_x[e] / kSubpixels);
      down[e] = static_cast<int32_t>(edges.step_y[e] / kSubpixels);
    }
  }

  /// Bit 24 and on of edge `e` where its `low` has become `moved`: negative outside.
  __device__ int32_t high_at(int e, int32_t moved) const { return high[e] + (moved >> 16); }

  /// The edge value there plus `more`, 0 or 1, rounded once to float. `kHuge`: it may be 2^48 or more.
  template <bool kHuge>
  __device__ float value_at(int e, int32_t moved, uint32_t more) const {
    const int32_t above = high_at(e, moved);
    const uint32_t rest = __byte_perm(static_cast<uint32_t>(moved), lowest[e], 0x7104) + more;
    if constexpr (kHuge) return static_cast<float>((int64_t{above} << 24) + static_cast<int64_t>(rest));
    // Both are floats without rounding, and so is the product: what is rounded is the sum, once.
    return fused(static_cast<float>(above), 16777216.0f, static_cast<float>(rest));
  }
};

/// A strip of a tile, `rows` (a bit each) of its pixels in columns `x0` to `x1`. A lane has two columns, whose samples
/// it asks for before it finds their depths.
template <bool kOrthographic, bool kHuge, class Mask>
__device__ inline void draw_strip(const Target& target, const StripEdges& strip, const DepthPlane& plane,
                                  uint32_t exclusive1, uint32_t exclusive2, uint64_t id, int32_t first_x,
                                  int32_t first_y, int32_t x0, int32_t x1, uint32_t rows, const Mask& mask) {
  const auto lane = static_cast<int32_t>(threadIdx.x % kWarpLanes);
#pragma unroll 1
  for (int32_t column = lane; column < kTileSide; column += static_cast<int32_t>(kWarpLanes)) {
    const int32_t x = first_x + column;
    int32_t moved[3];
    for (int e = 0; e < 3; ++e) moved[e] = strip.low[e] + column * strip.right[e];
    uint64_t* const samples = target.row(first_y) + x;
    const auto stride = static_cast<uint32_t>(target.width);
    const uint32_t left_out = x >= x0 && x <= x1 ? ~rows : ~0u;
    uint64_t seen[kStripRows];
    for (int32_t y = 0; y < kStripRows; ++y) {
      auto sign = static_cast<int32_t>(left_out << (31 - y));
      for (int e = 0; e < 3; ++e) sign |= strip.high_at(e, moved[e] + y * strip.down[e]);
      seen[y] = sign >= 0 ? WarpTeam::load_relaxed(samples + static_cast<uint32_t>(y) * stride) : 0;
    }
    for (int32_t y = 0; y < kStripRows; ++y) {
      if (seen[y] != 0) {
        const float weight1 = strip.value_at<kHuge>(1, moved[1], exclusive1) * plane.inverse_area;
        const float weight2 = strip.value_at<kHuge>(2, moved[2], exclusive2) * plane.inverse_area;
        const uint64_t drawn = pack_sample(depth_code<kOrthographic>(depth_of_weights(plane, weight1, weight2)), id);
        if constexpr (Mask::kTests) {
          if (drawn < seen[y] && target.is_behind_peeled(samples + static_cast<uint32_t>(y) * stride, drawn) &&
              mask.passes(x, first_y + y))
            WarpTeam::atomic_min(samples + static_cast<uint32_t>(y) * stride, drawn);
        } else {
          if (drawn < seen[y]) WarpTeam::atomic_min(samples + static_cast<uint32_t>(y) * stride, drawn);
        }
      }
      moved[1] += strip.down[1];
      moved[2] += strip.down[2];
    }
  }
}

/// Draws the tiles, a strip a warp.
template <bool kOrthographic, bool kMasked>
__global__ void __launch_bounds__(kLargeThreads, kLargeBlocks)
    raster_large(const __grid_constant__ LargeFrame<kMasked> frame) {
  const uint64_t warp = (uint64_t{blockIdx.x} * blockDim.x + threadIdx.x) / kWarpLanes;
  const uint64_t warps = uint64_t{gridDim.x} * blockDim.x / kWarpLanes;
  const uint64_t tiles = min_of(frame.queues.counters->tiles, frame.queues.tile_capacity);
  for (uint64_t i = warp; i < tiles * kStrips; i += warps) {
    const TileItem tile = frame.queues.tiles[i / kStrips];
    const Triangle triangle = frame.queues.large[tile.triangle];
    const PixelBox box = pixel_box(triangle.x, triangle.y, frame.view);
    const int32_t first_x = tile.x * kTileSide;
    const int32_t first_y = tile.y * kTileSide + static_cast<int32_t>(i % kStrips) * kStripRows;
    const int32_t first_row = max_of(box.y0 - first_y, 0);
    const int32_t last_row = min_of(box.y1 - first_y, kStripRows - 1);
    if (first_row > last_row) continue;
    const Edges<int64_t> edges = make_edges<int64_t>(triangle, first_x, first_y);
    bool outside = false;
    for (int e = 0; e < 3; ++e) {
      outside |= edges.value[e] + (kTileSide - 1) * max_of<int64_t>(edges.step_x[e], 0) +
                     (kStripRows - 1) * max_of<int64_t>(edges.step_y[e], 0) <
                 0;
    }
    if (outside) continue;
    const int64_t area = doubled_area(triangle.x, triangle.y);
    const DepthPlane plane = make_depth_plane(triangle, area);
    const StripEdges strip(edges);
    const auto exclusive1 = static_cast<uint32_t>(edges.exclusive[1]);
    const auto exclusive2 = static_cast<uint32_t>(edges.exclusive[2]);
    const uint32_t rows = (2u << last_row) - (1u << first_row);
    with_warp_mask<kOrthographic>(frame, triangle, [&](const auto& mask) {
      if (area < int64_t{1} << 48) {
        draw_strip<kOrthographic, false>(frame.target, strip, plane, exclusive1, exclusive2, triangle.id, first_x,
                                         first_y, box.x0, box.x1, rows, mask);
      } else {
        draw_strip<kOrthographic, true>(frame.target, strip, plane, exclusive1, exclusive2, triangle.id, first_x,
                                        first_y, box.x0, box.x1, rows, mask);
      }
    });
  }
}

}  // namespace scree::kernels
