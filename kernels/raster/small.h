// Stage 1 of a triangle: projects it, draws it if it is small, and queues it otherwise.
#pragma once

#include "kernels/raster/clip.h"
#include "kernels/raster/mask.h"
#include "kernels/raster/queues.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

/// Draws all covered pixels of `box`, for a team of one lane. `mask`: as for draw_box_with_team().
template <bool kOrthographic, class Int, class Team, class Mask = NoMask>
SCREE_HD inline void draw_box(Team team, const Target& target, const Triangle& triangle, const PixelBox& box,
                              int64_t area, const Mask& mask = {}) {
  const Edges<Int> edges = make_edges<Int>(triangle, box.x0, box.y0);
  const DepthPlane plane = make_depth_plane(triangle, area);
  Int row0 = edges.value[0];
  Int row1 = edges.value[1];
  Int row2 = edges.value[2];
  for (int32_t y = box.y0; y <= box.y1; ++y) {
    uint64_t* samples = target.row(y);
    Int value0 = row0;
    Int value1 = row1;
    Int value2 = row2;
    for (int32_t x = box.x0; x <= box.x1; ++x) {
      if ((value0 | value1 | value2) >= 0) {
        const float depth = depth_at<Int>(plane, value1 + edges.exclusive[1], value2 + edges.exclusive[2]);
        const uint64_t sample = pack_sample(depth_code<kOrthographic>(depth), triangle.id);
        if constexpr (Mask::kTests) {
          mask.draw(team, target, sample < team.load_relaxed(samples + x), samples + x, sample, x, y);
        } else {
          team.update_min(samples + x, sample);
        }
      }
      value0 += edges.step_x[0];
      value1 += edges.step_x[1];
      value2 += edges.step_x[2];
    }
    row0 += edges.step_y[0];
    row1 += edges.step_y[1];
    row2 += edges.step_y[2];
  }
}

/// Projects each vertex when a triangle needs it.
template <bool kOrthographic>
struct DirectVertices {
  const ChunkReader* reader;
  const Transform* transform;
  const FrameView* view;

  SCREE_HD ScreenVertex operator()(uint32_t vertex) const {
    float d[3];
    reader->relative(vertex, d);
    return project<kOrthographic>(*transform, *view, d[0], d[1], d[2]);
  }
};

/// The mask of the chunk that is drawn, and the data by which its planes are made. Empty in builds without tests.
template <bool kMasked>
struct MaskedChunk {};
template <>
struct MaskedChunk<true> {
  const MaskView* mask = nullptr;  // null: the chunk's triangles are opaque
  const format::MeshRecord* mesh = nullptr;
  const format::ChunkRecord* chunk = nullptr;
  const std::byte* page = nullptr;

  MaskedChunk() = default;
  SCREE_HD MaskedChunk(const SceneView& scene, const format::MeshRecord& of, const format::ChunkRecord& drawn)
      : mask(mask_of(scene, of)), mesh(&of), chunk(&drawn), page(scene.pages[drawn.page]) {}
};

template <bool kOrthographic, bool kMasked>
struct RasterSmall {
  SceneView scene;
  FrameView view;
  Target target;
  Queues queues;

  struct Context {
    const ChunkReader* reader;
    const Transform* transform;
    bool double_sided;
    uint64_t first_id;
    int64_t small_box = kSmallBox;  // pixels; larger boxes go to stage 2
    [[no_unique_address]] MaskedChunk<kMasked> masked = {};
    uint64_t small = 0;
    uint64_t clipped = 0;
  };

  /// Draws `count` triangles of the chunk that context.reader reads.
  template <class Team>
  SCREE_HD inline void draw_run(Team team, Context& context, const format::ChunkRecord& chunk, uint32_t first_triangle,
                                uint32_t count) const {
    if constexpr (Team::kCachesVertices) {
      if (team.with_projected_vertices(*this, context, chunk, first_triangle, count)) return;
    }
    const DirectVertices<kOrthographic> vertices{context.reader, context.transform, &view};
    for (uint32_t i = team.rank(); i < count; i += team.size()) {
      uint32_t v[3];
      context.reader->triangle(first_triangle + i, v);
      draw(team, context, first_triangle + i, v, vertices(v[0]), vertices(v[1]), vertices(v[2]));
    }
  }

  /// Draws triangle number `number` of the chunk with corners `v`.
  template <class Team>
  SCREE_HD inline void draw(Team team, Context& context, uint32_t number, const uint32_t v[3], const ScreenVertex& a,
                            const ScreenVertex& b, const ScreenVertex& c) const {
    if (((a.flags | b.flags | c.flags) & kNeedsClip) != 0) {
      if ((a.flags & b.flags & c.flags & kOutsideMask) == 0) draw_clipped(team, context, number, v, a, b, c);
      return;
    }
    draw_projected(team, context, number, a, b, c);
  }

  template <class Team>
  SCREE_HD inline void draw_projected(Team team, Context& context, uint32_t number, const ScreenVertex& a,
                                      const ScreenVertex& b, const ScreenVertex& c) const {
    Triangle triangle;
    PixelBox box;
    int64_t area;
    if (!set_up(view, a, b, c, context.first_id + number, context.transform->mirrored, context.double_sided, triangle,
                box, area)) {
      return;
    }
    if constexpr (kMasked) triangle.is_masked = is_tested(scene, view, context.masked.mask);
    const int64_t pixels = box.pixels();
    if (pixels <= context.small_box) {
      ++context.small;
      if constexpr (kMasked) {
        if (triangle.is_masked != 0) return draw_masked(team, context, number, triangle, box, area);
      }
      if (fits_narrow_edges(triangle.x, triangle.y)) {
        draw_box<kOrthographic, int32_t>(team, target, triangle, box, area);
      } else {
        draw_box<kOrthographic, int64_t>(team, target, triangle, box, area);
      }
    } else if (pixels < kMediumBox) {
      push(team, &queues.counters->medium, queues.medium, queues.medium_capacity, triangle);
    } else {
      push(team, &queues.counters->large, queues.large, queues.large_capacity, triangle);
    }
  }

  template <class Team>
  SCREE_HD inline void draw_masked(Team team, Context& context, uint32_t number, const Triangle& triangle,
                                   const PixelBox& box, int64_t area) const {
    const MaskedChunk<true>& masked = context.masked;
    MaskPlane plane;
    make_mask_plane<kOrthographic>(scene, view, *context.transform, *masked.mesh, *masked.chunk, masked.page,
                                   *context.reader, number, plane);
    const TestedTriangle tested{plane, view};
    if (fits_narrow_edges(triangle.x, triangle.y)) {
      draw_box<kOrthographic, int32_t>(team, target, triangle, box, area, tested);
    } else {
      draw_box<kOrthographic, int64_t>(team, target, triangle, box, area, tested);
    }
  }

  /// Draws a triangle that needs clipping. Out of line, because it is rare and would take registers from the common
  /// path.
  template <class Team>
  SCREE_HD [[gnu::noinline]] void draw_clipped(Team team, Context& context, uint32_t number, const uint32_t v[3],
                                               const ScreenVertex& a, const ScreenVertex& b,
                                               const ScreenVertex& c) const {
    ++context.clipped;
    const ScreenVertex* corners[3] = {&a, &b, &c};
    ClipVertex polygon[kMaxPolygon];
    for (int i = 0; i < 3; ++i) {
      double d[3];
      context.reader->exact_relative(v[i], d);
      polygon[i] = clip_vertex(*context.transform, d, *corners[i]);
    }
    const int count = clip_polygon<kOrthographic>(polygon);
    if (count < 3) return;
    const ScreenVertex hub = snap_clipped<kOrthographic>(polygon[0], view);
    ScreenVertex last = snap_clipped<kOrthographic>(polygon[1], view);
    for (int i = 2; i < count; ++i) {
      const ScreenVertex next = snap_clipped<kOrthographic>(polygon[i], view);
      draw_projected(team, context, number, hub, last, next);
      last = next;
    }
  }
};

}  // namespace SCREE_ISA
}  // namespace scree::kernels
