// Builds the depth pyramid on a GPU: levels 1 to 6 by blocks of 64 x 64 samples, the other levels by one block.
#pragma once

#include "kernels/cuda/common/backend.cuh"
#include "kernels/cuda/frame/draw_list.h"
#include "kernels/cull/depth_pyramid.h"

namespace scree::kernels {

inline constexpr uint32_t kPyramidThreads = 256;
inline constexpr uint32_t kPyramidTile = 64;      // samples per side of a block's tile
inline constexpr uint32_t kPyramidTileLevel = 6;  // the level that has one code per tile

/// Stores the code at (x, y) of a level, unless (x, y) lies outside the level.
__device__ inline void put_code(const DepthPyramid& pyramid, uint32_t level, int32_t x, int32_t y, uint32_t code) {
  if (x < pyramid.across(level) && y < pyramid.down(level)) pyramid.row(level, y)[x] = code;
}

/// A warp takes 8 rows of the tile, a lane two columns. Samples outside the rows from `first_row` to `end_row` - 1 are
/// not read.
__global__ void __launch_bounds__(kPyramidThreads)
    build_pyramid_tiles(const __grid_constant__ DepthPyramid pyramid, const uint64_t* samples, int32_t first_row,
                        int32_t end_row) {
  constexpr uint32_t kSide = kPyramidTile / 8;  // codes of level 3 per side
  __shared__ uint32_t level3[kSide][kSide];
  const auto lane = static_cast<int32_t>(threadIdx.x % kWarpLanes);
  const auto warp = static_cast<int32_t>(threadIdx.x / kWarpLanes);
  const int32_t tile_x = static_cast<int32_t>(blockIdx.x);
  const int32_t tile_y = static_cast<int32_t>(blockIdx.y);
  const int32_t x = tile_x * static_cast<int32_t>(kPyramidTile) + 2 * lane;
  const int32_t y = tile_y * static_cast<int32_t>(kPyramidTile) + 8 * warp;
  // Reads only the depth codes. Samples that are not drawn count as nearest, so that they do not weaken the test.
  const auto* words = reinterpret_cast<const uint32_t*>(samples) + 1;
  const auto code_at = [&](int32_t column, int32_t row) {
    if (column >= pyramid.width || row < first_row || row >= end_row) return 0u;
    const uint64_t index =
        static_cast<uint64_t>(row) * static_cast<uint64_t>(pyramid.width) + static_cast<uint64_t>(column);
    return words[2 * index] >> (kIdBits - 32);
  };
  uint32_t code[8][2];
  for (int32_t row = 0; row < 8; ++row) {
    for (int32_t column = 0; column < 2; ++column) code[row][column] = code_at(x + column, y + row);
  }
  uint32_t quads[4];
  for (int32_t i = 0; i < 4; ++i) {
    quads[i] = max_of(max_of(code[2 * i][0], code[2 * i][1]), max_of(code[2 * i + 1][0], code[2 * i + 1][1]));
    put_code(pyramid, 1, x >> 1, (y >> 1) + i, quads[i]);
  }
  uint32_t level2[2];
  for (int32_t i = 0; i < 2; ++i) {
    const uint32_t both = max_of(quads[2 * i], quads[2 * i + 1]);
    level2[i] = max_of(both, __shfl_xor_sync(~0u, both, 1));
    if (lane % 2 == 0) put_code(pyramid, 2, x >> 2, (y >> 2) + i, level2[i]);
  }
  const uint32_t both = max_of(level2[0], level2[1]);
  const uint32_t eighth = max_of(both, __shfl_xor_sync(~0u, both, 2));
  if (lane % 4 == 0) {
    put_code(pyramid, 3, x >> 3, y >> 3, eighth);
    level3[warp][lane / 4] = eighth;
  }
  __syncthreads();
  if (warp != 0) return;
  // Level 3 has 8 x 8 codes; a lane has two of a column.
  const int32_t column = lane % 8;
  const int32_t row = lane / 8;
  uint32_t most = max_of(level3[2 * row][column], level3[2 * row + 1][column]);
  most = max_of(most, __shfl_xor_sync(~0u, most, 1));
  if (column % 2 == 0) put_code(pyramid, 4, tile_x * 4 + column / 2, tile_y * 4 + row, most);
  most = max_of(most, __shfl_xor_sync(~0u, most, 2));
  most = max_of(most, __shfl_xor_sync(~0u, most, 8));
  if (column % 4 == 0 && row % 2 == 0) put_code(pyramid, 5, tile_x * 2 + column / 4, tile_y * 2 + row / 2, most);
  most = max_of(most, __shfl_xor_sync(~0u, most, 4));
  most = max_of(most, __shfl_xor_sync(~0u, most, 16));
  if (lane == 0) put_code(pyramid, kPyramidTileLevel, tile_x, tile_y, most);
}

/// Builds the levels above the tiles', one after the other, by one block. The same launch begins the frame's next pass
/// (begin_pass): if `stages_ran`, all queued triangles are drawn by now, and stages 2 and 3 continue after them. A
/// separate launch for that would take as long as this one. The next pass must not start without it.
__global__ void __launch_bounds__(1024) build_pyramid_top_and_begin_pass(const __grid_constant__ DepthPyramid pyramid,
                                                                         FrameCounters* counters, bool stages_ran) {
  for (uint32_t level = kPyramidTileLevel + 1; level <= kPyramidLevels; ++level) {
    fill_level(pyramid, level, static_cast<int32_t>(threadIdx.x), static_cast<int32_t>(blockDim.x));
    __syncthreads();
  }
  if (threadIdx.x == 0 && stages_ran) begin_pass(*counters);
}

}  // namespace scree::kernels
