// Stages 2 and 3 on a GPU: a warp per medium triangle, a warp per tile of a large one.
#pragma once

#include "kernels/cuda/common/backend.cuh"
#include "kernels/cuda/cull/cull.cuh"
#include "kernels/cuda/raster/masks.cuh"
#include "kernels/raster/large.h"

namespace scree::kernels {

template <Alpha kAlpha>
struct LargeFrame {
  FrameView view;
  Target target;
  Queues queues;
  const DrawnTriangles* drawn;
  MaskSource<kAlpha != Alpha::kOpaque> masks;
};

inline constexpr uint32_t kLargeThreads = 256;
// Blocks per multiprocessor, all at once. The builds that draw masked triangles need more registers.
template <Alpha kAlpha>
inline constexpr uint32_t kMediumBlocks = kAlpha != Alpha::kOpaque ? 2 : 3;
template <Alpha kAlpha>
inline constexpr uint32_t kLargeBlocks = kAlpha != Alpha::kOpaque ? 3 : 4;

/// Rows of a tile that are drawn together, as a strip.
inline constexpr int32_t kStripRows = 8;
inline constexpr uint32_t kStrips = kTileSide / kStripRows;

/// The `part`-th strip of `rows` rows of a box; may be empty.
__device__ inline PixelBox rows_of(const PixelBox& box, uint32_t part, int32_t rows) {
  PixelBox out = box;
  out.y0 = box.y0 + static_cast<int32_t>(part) * rows;
  out.y1 = min_of(box.y1, out.y0 + rows - 1);
  return out;
}

/// The planes of up to 32 triangles that a warp draws one after the other. A lane takes some thousand instructions for
/// a plane, so all lanes make their planes at once.
template <bool kOrthographic, Alpha kAlpha>
class WarpPlanes {
 public:
  __device__ explicit WarpPlanes(const LargeFrame<kAlpha>& frame) : frame_(frame) {}

  /// Makes the planes of the lanes' triangles; all lanes call it. `triangle`: the lane's, null if it has none.
  __device__ void make(const Triangle* triangle) {
    if constexpr (kAlpha != Alpha::kOpaque) {
      finish();  // the last planes are no longer used
      if (triangle != nullptr && triangle->is_masked != 0)
        frame_.masks.template make_plane<kOrthographic>(WarpTeam{}, frame_.view, triangle->id,
                                                        planes()[threadIdx.x % kWarpLanes]);
      __syncwarp();
    }
  }

  /// Calls draw(mask) with the tests of the samples of `triangle`, whose plane lane `maker` has made.
  template <class Draw>
  __device__ void with_mask(const Triangle& triangle, [[maybe_unused]] uint32_t maker, const Draw& draw) {
    if constexpr (kAlpha != Alpha::kOpaque) {
      if (triangle.is_masked != 0) return draw(tests(maker));
    }
    draw(NoMask{});
  }

  /// Tests the samples that still wait. Called once after the last triangle.
  __device__ void finish() {
    if constexpr (kAlpha != Alpha::kOpaque) tests(0).finish(frame_.target);
  }

 private:
  __device__ auto tests(uint32_t maker) {
    __shared__ WarpSamples of_block[kLargeThreads / kWarpLanes];
    return WarpPlane<kAlpha == Alpha::kBlended>{planes(), maker, &frame_.view, of_block + threadIdx.x / kWarpLanes,
                                                &waiting_};
  }
  __device__ static MaskPlane* planes() {
    __shared__ MaskPlane of_block[kLargeThreads];
    return of_block + threadIdx.x / kWarpLanes * kWarpLanes;
  }

  const LargeFrame<kAlpha>& frame_;
  uint32_t waiting_ = 0;  // samples
};

/// Appends the tiles that a large triangle may touch, with a warp. Counts the tiles first, so that it waits only once
/// for the queue's counter. Draws tiles for which the queue has no room immediately.
template <bool kOrthographic, Alpha kAlpha>
__device__ inline void split_triangle(const LargeFrame<kAlpha>& frame, uint32_t number) {
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
    const uint64_t slot = next + rank_among(lanes);
    next += static_cast<uint32_t>(__popc(lanes));
    const bool kept = slot < queues.tile_capacity;
    if (touches && kept) {
      queues.tiles[slot] = {number, static_cast<uint16_t>(x), static_cast<uint16_t>(y)};
    }
    if (next <= queues.tile_capacity) continue;
    WarpPlanes<kOrthographic, kAlpha> planes{frame};
    planes.make(lane == 0 ? &triangle : nullptr);
    for (uint32_t left = __ballot_sync(~0u, touches && !kept); left != 0; left &= left - 1) {
      const int owner = __ffs(static_cast<int>(left)) - 1;
      const PixelBox box = tile_box(triangle, frame.view, static_cast<int32_t>(__shfl_sync(~0u, x, owner)),
                                    static_cast<int32_t>(__shfl_sync(~0u, y, owner)));
      if (box.empty()) continue;
      planes.with_mask(triangle, 0, [&](const auto& mask) {
        draw_box_with_team<kOrthographic, int64_t>(WarpTeam{}, frame.target, triangle, box,
                                                   doubled_area(triangle.x, triangle.y), mask);
      });
    }
    planes.finish();
  }
}

/// Splits the large queue into tiles, one triangle per warp.
template <bool kOrthographic, Alpha kAlpha>
__global__ void __launch_bounds__(kLargeThreads, kLargeBlocks<kAlpha>)
    split_large(const __grid_constant__ LargeFrame<kAlpha> frame) {
  const uint64_t warp = (uint64_t{blockIdx.x} * blockDim.x + threadIdx.x) / kWarpLanes;
  const uint64_t warps = uint64_t{gridDim.x} * blockDim.x / kWarpLanes;
  const uint64_t large = min_of(frame.queues.counters->large, frame.queues.large_capacity);
  for (uint64_t i = frame.drawn->large + warp; i < large; i += warps)
    split_triangle<kOrthographic>(frame, static_cast<uint32_t>(i));
}

/// Larger boxes of the medium queue are drawn in this many parts.
inline constexpr uint32_t kMediumParts = 4;
inline constexpr int64_t kWholeBox = 512;  // pixels

/// Draws one part of a triangle of the medium queue, or the whole triangle if its box is small. `maker`: the lane that
/// made its plane.
template <bool kOrthographic, Alpha kAlpha>
__device__ inline void draw_medium_part(const LargeFrame<kAlpha>& frame, const Triangle& triangle, uint32_t part,
                                        WarpPlanes<kOrthographic, kAlpha>& planes, uint32_t maker) {
  const PixelBox whole = pixel_box(triangle.x, triangle.y, frame.view);
  const int32_t rows = (whole.y1 - whole.y0) / static_cast<int32_t>(kMediumParts) + 1;
  const PixelBox box = whole.pixels() > kWholeBox ? rows_of(whole, part, rows) : whole;
  if (box.empty()) return;
  const int64_t area = doubled_area(triangle.x, triangle.y);
  planes.with_mask(triangle, maker, [&](const auto& mask) {
    if (fits_narrow_edges(triangle.x, triangle.y)) {
      draw_box_with_team<kOrthographic, int32_t>(WarpTeam{}, frame.target, triangle, box, area, mask);
    } else {
      draw_box_with_team<kOrthographic, int64_t>(WarpTeam{}, frame.target, triangle, box, area, mask);
    }
  });
}

/// Draws the medium queue, a triangle or a part of one per warp. First are whole triangles and part 0 of split ones;
/// then the remaining parts, spread over the warps, so that no warp draws all parts of a triangle. Few triangles are
/// split, so the lanes of a warp test 32 candidates at a time.
template <bool kOrthographic, Alpha kAlpha>
__global__ void __launch_bounds__(kLargeThreads, kMediumBlocks<kAlpha>)
    raster_medium(const __grid_constant__ LargeFrame<kAlpha> frame) {
  const uint32_t lane = threadIdx.x % kWarpLanes;
  const uint64_t warp = (uint64_t{blockIdx.x} * blockDim.x + threadIdx.x) / kWarpLanes;
  const uint64_t warps = uint64_t{gridDim.x} * blockDim.x / kWarpLanes;
  const uint64_t from = min_of(frame.drawn->medium, frame.queues.medium_capacity);
  const uint64_t medium = min_of(frame.queues.counters->medium, frame.queues.medium_capacity) - from;
  const Triangle* const triangles = frame.queues.medium + from;
  uint64_t first = warp;  // the next triangle whose part 0 is drawn
  uint64_t next = warp;   // the next of the remaining parts, which are numbered across triangles
  uint64_t found = 0;     // by this lane
  uint32_t left = 0;      // lanes that found a part
  uint32_t maker = kWarpLanes - 1;
  WarpPlanes<kOrthographic, kAlpha> planes{frame};
  for (;;) {
    uint64_t number = first;
    uint32_t part = 0;
    if (first < medium) {
      maker = (maker + 1) % kWarpLanes;
      if (kAlpha != Alpha::kOpaque && maker == 0)
        planes.make(first + lane * warps < medium ? triangles + first + lane * warps : nullptr);
      first += warps;
    } else {
      for (; left == 0 && next < medium * (kMediumParts - 1); next += warps * kWarpLanes) {
        found = medium + next + lane * warps;
        const bool inside = found < medium * kMediumParts;
        const Triangle& looked_at = triangles[inside ? found % medium : 0];
        left = __ballot_sync(~0u, inside && pixel_box(looked_at.x, looked_at.y, frame.view).pixels() > kWholeBox);
        if (kAlpha != Alpha::kOpaque && left != 0) planes.make((left >> lane & 1) != 0 ? &looked_at : nullptr);
      }
      if (left == 0) break;
      maker = static_cast<uint32_t>(__ffs(static_cast<int>(left)) - 1);
      number = __shfl_sync(~0u, found, maker);
      left &= left - 1;
      for (; number >= medium; number -= medium) ++part;
    }
    draw_medium_part<kOrthographic>(frame, triangles[number], part, planes, maker);
  }
  planes.finish();
}

/// The edge functions of a strip's pixels by 32-bit additions. A step of one pixel changes them by a multiple of 256,
/// and corners lie within 2^23 sub-pixels of the image's centre. So the bits above bit 7 change by less than 2^31 from
/// one end of a strip to the other.
struct StripEdges {
  int32_t high[3];     // at the strip's first pixel: bits 24 and up
  int32_t low[3];      // bits 8 to 23
  uint32_t lowest[3];  // bits 0 to 7, the same at all pixels
  int32_t right[3];    // change of `low` per pixel to the right
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

  /// Bits 24 and up of edge `e` at a pixel whose `low` is `moved`; negative outside.
  __device__ int32_t high_at(int e, int32_t moved) const { return high[e] + (moved >> 16); }

  /// The edge value there plus `more` (0 or 1), rounded once to float. `kHuge`: it may be 2^48 or larger.
  template <bool kHuge>
  __device__ float value_at(int e, int32_t moved, uint32_t more) const {
    const int32_t above = high_at(e, moved);
    const uint32_t rest = __byte_perm(static_cast<uint32_t>(moved), lowest[e], 0x7104) + more;
    if constexpr (kHuge) return static_cast<float>((int64_t{above} << 24) + static_cast<int64_t>(rest));
    // Both are exact as floats, and so is the product. Only the sum is rounded, once.
    return fused(static_cast<float>(above), 16777216.0f, static_cast<float>(rest));
  }
};

/// Draws the pixels of a strip of a tile: `rows` (one bit each) in columns `x0` to `x1`. A lane has two columns, and
/// starts loading their samples before it computes their depths.
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
      uint64_t drawn = kBackground;
      if (seen[y] != 0) {
        const float weight1 = strip.value_at<kHuge>(1, moved[1], exclusive1) * plane.inverse_area;
        const float weight2 = strip.value_at<kHuge>(2, moved[2], exclusive2) * plane.inverse_area;
        drawn = pack_sample(depth_code<kOrthographic>(depth_of_weights(plane, weight1, weight2)), id);
        if (!Mask::kTests && drawn < seen[y]) WarpTeam::atomic_min(samples + static_cast<uint32_t>(y) * stride, drawn);
      }
      if constexpr (Mask::kTests)
        mask.draw(WarpTeam{}, target, drawn < seen[y], samples + static_cast<uint32_t>(y) * stride, drawn, x,
                  first_y + y);
      moved[1] += strip.down[1];
      moved[2] += strip.down[2];
    }
  }
}

/// Draws the tiles, one strip per warp.
template <bool kOrthographic, Alpha kAlpha>
__global__ void __launch_bounds__(kLargeThreads, kLargeBlocks<kAlpha>)
    raster_large(const __grid_constant__ LargeFrame<kAlpha> frame) {
  const uint64_t warp = (uint64_t{blockIdx.x} * blockDim.x + threadIdx.x) / kWarpLanes;
  const uint64_t warps = uint64_t{gridDim.x} * blockDim.x / kWarpLanes;
  const uint64_t strips = min_of(frame.queues.counters->tiles, frame.queues.tile_capacity) * kStrips;
  uint32_t maker = kWarpLanes - 1;
  WarpPlanes<kOrthographic, kAlpha> planes{frame};
  for (uint64_t i = warp; i < strips; i += warps) {
    maker = (maker + 1) % kWarpLanes;
    if (kAlpha != Alpha::kOpaque && maker == 0) {
      const uint64_t own = i + threadIdx.x % kWarpLanes * warps;
      planes.make(own < strips ? frame.queues.large + frame.queues.tiles[own / kStrips].triangle : nullptr);
    }
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
    planes.with_mask(triangle, maker, [&](const auto& mask) {
      if (area < int64_t{1} << 48) {
        draw_strip<kOrthographic, false>(frame.target, strip, plane, exclusive1, exclusive2, triangle.id, first_x,
                                         first_y, box.x0, box.x1, rows, mask);
      } else {
        draw_strip<kOrthographic, true>(frame.target, strip, plane, exclusive1, exclusive2, triangle.id, first_x,
                                        first_y, box.x0, box.x1, rows, mask);
      }
    });
  }
  planes.finish();
}

}  // namespace scree::kernels
