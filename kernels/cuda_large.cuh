// Stages 2 and 3 on a GPU: a warp a medium triangle, a warp a tile of a large one.
#pragma once

#include "kernels/backend_cuda.cuh"
#include "kernels/cuda_cull.cuh"
#include "kernels/raster_large.h"

namespace scree::kernels {

struct LargeFrame {
  FrameView view;
  Target target;
  Queues queues;
  const FrameCounters* counters;  // what the passes before have drawn
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

/// Appends the tiles that a large triangle may touch, by a warp. What the queue has no room for is drawn at once.
template <bool kOrthographic>
__device__ inline void split_triangle(const LargeFrame& frame, uint32_t number) {
  const Queues& queues = frame.queues;
  const uint32_t lane = threadIdx.x % kWarpLanes;
  const Triangle triangle = queues.large[number];
  const LargeTiles tiles(triangle, frame.view);
  for (uint32_t base = 0; base < tiles.count(); base += kWarpLanes) {
    bool touches = false;
    uint32_t x = 0;
    uint32_t y = 0;
    if (base + lane < tiles.count()) {
      tiles.tile(base + lane, x, y);
      touches = may_cover_tile(triangle, static_cast<int32_t>(x), static_cast<int32_t>(y));
    }
    const uint32_t lanes = __ballot_sync(~0u, touches);
    if (lanes == 0) continue;
    uint64_t first = 0;
    if (lane == 0) first = WarpTeam::add(&queues.counters->tiles, static_cast<uint64_t>(__popc(lanes)));
    first = __shfl_sync(~0u, first, 0);
    const uint64_t slot = first + static_cast<uint32_t>(__popc(lanes & ((1u << lane) - 1)));
    const bool kept = slot < queues.tile_capacity;
    if (touches && kept) {
      queues.tiles[slot] = {number, static_cast<uint16_t>(x), static_cast<uint16_t>(y)};
    }
    for (uint32_t left = __ballot_sync(~0u, touches && !kept); left != 0; left &= left - 1) {
      const int owner = __ffs(static_cast<int>(left)) - 1;
      const PixelBox box = tile_box(triangle, frame.view, static_cast<int32_t>(__shfl_sync(~0u, x, owner)),
                                    static_cast<int32_t>(__shfl_sync(~0u, y, owner)));
      if (box.empty()) continue;
      draw_box_with_team<kOrthographic, int64_t>(WarpTeam{}, frame.target, triangle, box,
                                                 doubled_area(triangle.x, triangle.y));
    }
  }
}

/// Splits the large queue into tiles, a triangle a warp.
template <bool kOrthographic>
__global__ void __launch_bounds__(kLargeThreads, kLargeBlocks) split_large(const __grid_constant__ LargeFrame frame) {
  const uint64_t warp = (uint64_t{blockIdx.x} * blockDim.x + threadIdx.x) / kWarpLanes;
  const uint64_t warps = uint64_t{gridDim.x} * blockDim.x / kWarpLanes;
  const uint64_t large = min_of(frame.queues.counters->large, frame.queues.large_capacity);
  for (uint64_t i = frame.counters->large_drawn + warp; i < large; i += warps)
    split_triangle<kOrthographic>(frame, static_cast<uint32_t>(i));
}

/// Draws the medium queue, a triangle or a quarter of its rows a warp.
template <bool kOrthographic>
__global__ void __launch_bounds__(kLargeThreads, kMediumBlocks)
    raster_medium(const __grid_constant__ LargeFrame frame) {
  const uint64_t warp = (uint64_t{blockIdx.x} * blockDim.x + threadIdx.x) / kWarpLanes;
  const uint64_t warps = uint64_t{gridDim.x} * blockDim.x / kWarpLanes;
  const uint64_t from = min_of(frame.counters->medium_drawn, frame.queues.medium_capacity);
  const uint64_t medium = min_of(frame.queues.counters->medium, frame.queues.medium_capacity) - from;
  // The larger boxes in parts, which lie a part's count apart in the items, so that one warp does not get them all.
  constexpr uint32_t kParts = 4;
  constexpr int64_t kWholeBox = 512;
  uint64_t number = warp;
  uint32_t part = 0;
  while (medium != 0) {
    for (; number >= medium && part < kParts; number -= medium) ++part;
    if (part == kParts) break;
    const Triangle triangle = frame.queues.medium[from + number];
    number += warps;
    const PixelBox whole = pixel_box(triangle.x, triangle.y, frame.view);
    const bool divided = whole.pixels() > kWholeBox;
    if (part != 0 && !divided) continue;
    const PixelBox box =
        divided ? rows_of(whole, part, (whole.y1 - whole.y0) / static_cast<int32_t>(kParts) + 1) : whole;
    if (box.empty()) continue;
    const int64_t area = doubled_area(triangle.x, triangle.y);
    if (fits_narrow_edges(triangle.x, triangle.y)) {
      draw_box_with_team<kOrthographic, int32_t>(WarpTeam{}, frame.target, triangle, box, area);
    } else {
      draw_box_with_team<kOrthographic, int64_t>(WarpTeam{}, frame.target, triangle, box, area);
    }
  }
}

/// Draws the tiles, a strip a warp: a lane has two columns and goes down the rows.
template <bool kOrthographic>
__global__ void __launch_bounds__(kLargeThreads, kLargeBlocks) raster_large(const __grid_constant__ LargeFrame frame) {
  const auto lane = static_cast<int32_t>(threadIdx.x % kWarpLanes);
  const uint64_t warp = (uint64_t{blockIdx.x} * blockDim.x + threadIdx.x) / kWarpLanes;
  const uint64_t warps = uint64_t{gridDim.x} * blockDim.x / kWarpLanes;
  const uint64_t tiles = min_of(frame.queues.counters->tiles, frame.queues.tile_capacity);
  for (uint64_t i = warp; i < tiles * kStrips; i += warps) {
    const TileItem tile = frame.queues.tiles[i / kStrips];
    const Triangle triangle = frame.queues.large[tile.triangle];
    PixelBox box = pixel_box(triangle.x, triangle.y, frame.view);
    const int32_t first_x = tile.x * kTileSide;
    const int32_t first_y = tile.y * kTileSide + static_cast<int32_t>(i % kStrips) * kStripRows;
    box.x1 = min_of(box.x1, first_x + kTileSide - 1);
    box.y1 = min_of(box.y1, first_y + kStripRows - 1);
    if (max_of(box.y0, first_y) > box.y1) continue;
    const Edges<int64_t> edges = make_edges<int64_t>(triangle, first_x, first_y);
    bool outside = false;
    for (int e = 0; e < 3; ++e) {
      outside |= edges.value[e] + (kTileSide - 1) * max_of<int64_t>(edges.step_x[e], 0) +
                     (kStripRows - 1) * max_of<int64_t>(edges.step_y[e], 0) <
                 0;
    }
    if (outside) continue;
    const DepthPlane plane = make_depth_plane(triangle, doubled_area(triangle.x, triangle.y));
    for (int32_t x = first_x + lane; x < first_x + kTileSide; x += static_cast<int32_t>(kWarpLanes)) {
      if (x < box.x0 || x > box.x1) continue;
      int64_t value[3];
      for (int e = 0; e < 3; ++e) value[e] = edges.value[e] + (x - first_x) * edges.step_x[e];
      uint64_t* at = frame.target.row(first_y) + x;
      constexpr int32_t kBatch = 4;
      for (int32_t y = first_y; y <= box.y1; y += kBatch) {
        uint64_t drawn[kBatch];
        uint64_t seen[kBatch];
        for (int32_t k = 0; k < kBatch; ++k) {
          const float depth = depth_at<int64_t>(plane, value[1] + edges.exclusive[1], value[2] + edges.exclusive[2]);
          const bool covered = (y + k >= box.y0) & (y + k <= box.y1) & ((value[0] | value[1] | value[2]) >= 0);
          drawn[k] = covered ? pack_sample(depth_code<kOrthographic>(depth), triangle.id) : kBackground;
          for (int e = 0; e < 3; ++e) value[e] += edges.step_y[e];
        }
        for (int32_t k = 0; k < kBatch; ++k) {
          seen[k] = drawn[k] != kBackground ? WarpTeam::look(at + static_cast<uint64_t>(k * frame.target.width)) : 0;
        }
        for (int32_t k = 0; k < kBatch; ++k) {
          if (drawn[k] < seen[k]) WarpTeam::put_min(at + static_cast<uint64_t>(k * frame.target.width), drawn[k]);
        }
        at += static_cast<uint64_t>(kBatch) * static_cast<uint64_t>(frame.target.width);
      }
    }
  }
}

}  // namespace scree::kernels
