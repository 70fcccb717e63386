// Triangle setup: facing, box, edges, and a pixel's depth. Every stage uses these functions of (triangle, pixel).
// Source: spec/rasterization.md, coverage and depth.
#pragma once

#include "kernels/raster/depth.h"
#include "kernels/raster/vertex.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

/// Stage 1 draws boxes of up to this many pixels, stage 2 those of fewer than kMediumBox, stage 3 all others in tiles.
/// (A GPU moves some small boxes to stage 2: spec/rasterization.md, stages.)
inline constexpr int64_t kSmallBox = 128;
inline constexpr int64_t kMediumBox = 4096;
inline constexpr int32_t kTileSide = 64;

/// A triangle ready to be drawn, as the queues hold it: snapped corners (sub-pixels from the image's top left corner)
/// in the order of positive area, the depth value of each corner, the global id.
struct Triangle {
  int32_t x[3];
  int32_t y[3];
  float depth[3];
  uint32_t is_masked;  // 1: its samples are tested (mask.h)
  uint64_t id;
};
static_assert(sizeof(Triangle) == 48);

/// Pixels; both ends belong to the box.
struct PixelBox {
  int32_t x0;
  int32_t y0;
  int32_t x1;
  int32_t y1;

  SCREE_HD bool empty() const { return (x1 < x0) | (y1 < y0); }
  SCREE_HD int64_t pixels() const { return static_cast<int64_t>(x1 - x0 + 1) * static_cast<int64_t>(y1 - y0 + 1); }
};

/// Twice the signed area in square sub-pixels; positive if the corners turn clockwise on the screen (y downward). Below
/// 2^50, because corners lie within the guard band.
SCREE_HD inline int64_t doubled_area(const int32_t x[3], const int32_t y[3]) {
  return static_cast<int64_t>(x[1] - x[0]) * static_cast<int64_t>(y[2] - y[0]) -
         static_cast<int64_t>(x[2] - x[0]) * static_cast<int64_t>(y[1] - y[0]);
}

/// The pixels of the image whose centres lie in the corners' box. A centre is at 256 * i + 128.
SCREE_HD inline PixelBox pixel_box(const int32_t x[3], const int32_t y[3], const FrameView& view) {
  const int32_t min_x = min_of(x[0], min_of(x[1], x[2]));
  const int32_t max_x = max_of(x[0], max_of(x[1], x[2]));
  const int32_t min_y = min_of(y[0], min_of(y[1], y[2]));
  const int32_t max_y = max_of(y[0], max_of(y[1], y[2]));
  PixelBox box;
  box.x0 = max_of((min_x + 127) >> 8, 0);
  box.y0 = max_of((min_y + 127) >> 8, 0);
  box.x1 = min_of((max_x - 128) >> 8, view.width - 1);
  box.y1 = min_of((max_y - 128) >> 8, view.height - 1);
  return box;
}

/// Whether every edge value fits int32, at the pixel centres of the corners' box and one step past them.
SCREE_HD inline bool fits_narrow_edges(const int32_t x[3], const int32_t y[3]) {
  const int64_t extent_x = max_of(x[0], max_of(x[1], x[2])) - min_of(x[0], min_of(x[1], x[2]));
  const int64_t extent_y = max_of(y[0], max_of(y[1], y[2])) - min_of(y[0], min_of(y[1], y[2]));
  constexpr int64_t kSide = 1 << 21;
  return extent_x < kSide && extent_y < kSide && extent_x * extent_y < (1 << 28);
}

enum class Facing { kDrawn, kCulled };

/// Brings the corners into the order of positive area, and returns whether this side of the triangle is drawn at all.
/// glTF's front faces turn counter-clockwise, unless the matrix mirrors.
SCREE_HD inline Facing orient(Triangle& triangle, int64_t& area, bool mirrored, bool double_sided) {
  area = doubled_area(triangle.x, triangle.y);
  if (area == 0) return Facing::kCulled;
  const bool front = (area < 0) != mirrored;
  if (!front && !double_sided) return Facing::kCulled;
  if (area < 0) {
    area = -area;
    const int32_t swap_x = triangle.x[1];
    const int32_t swap_y = triangle.y[1];
    const float swap_depth = triangle.depth[1];
    triangle.x[1] = triangle.x[2];
    triangle.y[1] = triangle.y[2];
    triangle.depth[1] = triangle.depth[2];
    triangle.x[2] = swap_x;
    triangle.y[2] = swap_y;
    triangle.depth[2] = swap_depth;
  }
  return Facing::kDrawn;
}

/// Makes the triangle of three projected corners ready to be drawn; false if there is nothing to draw.
SCREE_HD inline bool set_up(const FrameView& view, const ScreenVertex& a, const ScreenVertex& b, const ScreenVertex& c,
                            uint64_t id, bool mirrored, bool double_sided, Triangle& triangle, PixelBox& box,
                            int64_t& area) {
  triangle = {{a.x, b.x, c.x}, {a.y, b.y, c.y}, {a.depth, b.depth, c.depth}, 0, id};
  box = pixel_box(triangle.x, triangle.y, view);
  return !box.empty() && orient(triangle, area, mirrored, double_sided) == Facing::kDrawn;
}

/// The three edge functions at pixel centres, in Int arithmetic (int32_t if fits_narrow_edges()). Value i is the
/// doubled area of the triangle of the pixel and the edge opposite corner i, minus `exclusive`. So a pixel is covered
/// if all three values are >= 0.
template <class Int>
struct Edges {
  Int value[3];      // at the pixel given to make_edges()
  Int step_x[3];     // to the next pixel to the right
  Int step_y[3];     // to the next pixel down
  Int exclusive[3];  // 0 on a top or left edge, else 1: a centre on the edge belongs to the neighbour
};

template <class Int>
SCREE_HD inline Edges<Int> make_edges(const Triangle& triangle, int32_t pixel_x, int32_t pixel_y) {
  Edges<Int> edges;
  const int32_t center_x = pixel_x * kSubpixels + kSubpixels / 2;
  const int32_t center_y = pixel_y * kSubpixels + kSubpixels / 2;
  for (int i = 0; i < 3; ++i) {
    const int from = i == 2 ? 0 : i + 1;
    const int to = from == 2 ? 0 : from + 1;
    const Int dx = static_cast<Int>(triangle.x[to] - triangle.x[from]);
    const Int dy = static_cast<Int>(triangle.y[to] - triangle.y[from]);
    edges.exclusive[i] = (dy < 0) | ((dy == 0) & (dx > 0)) ? Int{0} : Int{1};
    edges.value[i] = dx * static_cast<Int>(center_y - triangle.y[from]) -
                     dy * static_cast<Int>(center_x - triangle.x[from]) - edges.exclusive[i];
    edges.step_x[i] = -dy * kSubpixels;
    edges.step_y[i] = dx * kSubpixels;
  }
  return edges;
}

/// The depth of a triangle's pixels as a function of their weights.
struct DepthPlane {
  float inverse_area;
  float origin;  // of corner 0
  float slope1;  // corner 1 minus corner 0
  float slope2;
  float nearest;  // the range of the corners' values
  float farthest;
};

SCREE_HD inline DepthPlane make_depth_plane(const Triangle& triangle, int64_t area) {
  DepthPlane plane;
  plane.inverse_area = 1.0f / static_cast<float>(area);
  plane.origin = triangle.depth[0];
  plane.slope1 = triangle.depth[1] - triangle.depth[0];
  plane.slope2 = triangle.depth[2] - triangle.depth[0];
  plane.farthest = min_of(triangle.depth[0], min_of(triangle.depth[1], triangle.depth[2]));
  plane.nearest = max_of(triangle.depth[0], max_of(triangle.depth[1], triangle.depth[2]));
  return plane;
}

/// The depth value from the weights of corners 1 and 2.
SCREE_HD inline float depth_of_weights(const DepthPlane& plane, float weight1, float weight2) {
  const float depth = fused(weight1, plane.slope1, fused(weight2, plane.slope2, plane.origin));
  return min_of(max_of(depth, plane.farthest), plane.nearest);
}

/// The depth value at a pixel from its true edge values (`exclusive` added back) opposite corners 1 and 2. They are
/// exact integers and each is rounded once to float, so int32 and int64 edges give the same.
template <class Int>
SCREE_HD inline float depth_at(const DepthPlane& plane, Int edge1, Int edge2) {
  return depth_of_weights(plane, static_cast<float>(edge1) * plane.inverse_area,
                          static_cast<float>(edge2) * plane.inverse_area);
}

}  // namespace SCREE_ISA
}  // namespace scree::kernels
