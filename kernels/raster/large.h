// Stage 3: large triangles in tiles of 64 x 64. First the tiles of each triangle, then one team per tile.
#pragma once

#include "kernels/raster/medium.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

/// The tiles under the box of a large triangle, row by row.
struct LargeTiles {
  uint32_t first_x;
  uint32_t first_y;
  uint32_t columns;
  uint32_t rows;

  SCREE_HD LargeTiles(const Triangle& triangle, const FrameView& view) {
    const PixelBox box = pixel_box(triangle.x, triangle.y, view);
    first_x = static_cast<uint32_t>(box.x0) / kTileSide;
    first_y = static_cast<uint32_t>(box.y0) / kTileSide;
    columns = static_cast<uint32_t>(box.x1) / kTileSide - first_x + 1;
    rows = static_cast<uint32_t>(box.y1) / kTileSide - first_y + 1;
  }

  /// At most 2^16: an image has at most 2^14 pixels per side.
  SCREE_HD uint32_t count() const { return columns * rows; }
  SCREE_HD void tile(uint32_t number, uint32_t& x, uint32_t& y) const {
    x = first_x + number % columns;
    y = first_y + number / columns;
  }
};

/// Tests which tiles a triangle may cover. Each edge function is evaluated in the tile's corner where it is largest.
struct TileTest {
  int64_t largest[3];  // in tile 0, 0
  int64_t step_x[3];   // to the next tile to the right
  int64_t step_y[3];

  SCREE_HD explicit TileTest(const Triangle& triangle) {
    const Edges<int64_t> edges = make_edges<int64_t>(triangle, 0, 0);
    for (int i = 0; i < 3; ++i) {
      step_x[i] = kTileSide * edges.step_x[i];
      step_y[i] = kTileSide * edges.step_y[i];
      largest[i] = edges.value[i] +
                   (kTileSide - 1) * (max_of<int64_t>(edges.step_x[i], 0) + max_of<int64_t>(edges.step_y[i], 0));
    }
  }

  /// False only if all the tile's pixel centres lie outside one edge.
  SCREE_HD bool may_cover(uint32_t x, uint32_t y) const {
    int64_t sign = 0;
    for (int i = 0; i < 3; ++i)
      sign |= largest[i] + static_cast<int64_t>(x) * step_x[i] + static_cast<int64_t>(y) * step_y[i];
    return sign >= 0;
  }
};

/// The part of a triangle's box that lies in a tile; may be empty.
SCREE_HD inline PixelBox tile_box(const Triangle& triangle, const FrameView& view, int32_t tile_x, int32_t tile_y) {
  PixelBox box = pixel_box(triangle.x, triangle.y, view);
  box.x0 = max_of(box.x0, tile_x * kTileSide);
  box.y0 = max_of(box.y0, tile_y * kTileSide);
  box.x1 = min_of(box.x1, tile_x * kTileSide + kTileSide - 1);
  box.y1 = min_of(box.y1, tile_y * kTileSide + kTileSide - 1);
  return box;
}

/// One team per triangle of the large queue. The lanes share the tiles of its box.
struct SplitLarge {
  FrameView view;
  Queues queues;
  uint64_t first;  // the queue entry of item 0

  template <class Team>
  SCREE_HD void operator()(uint32_t item, Team team) const {
    const Triangle& triangle = queues.large[first + item];
    const LargeTiles tiles(triangle, view);
    const TileTest test(triangle);
    for (uint32_t i = team.rank(); i < tiles.count(); i += team.size()) {
      uint32_t x;
      uint32_t y;
      tiles.tile(i, x, y);
      if (!test.may_cover(x, y)) continue;
      push(team, &queues.counters->tiles, queues.tiles, queues.tile_capacity,
           TileItem{static_cast<uint32_t>(first + item), static_cast<uint16_t>(x), static_cast<uint16_t>(y)});
    }
  }
};

template <bool kOrthographic, bool kMasked>
struct RasterTiles {
  FrameView view;
  Target target;
  Queues queues;
  uint64_t first;  // the queue entry of item 0
  MaskSource<kMasked> masks;

  template <class Team>
  SCREE_HD void operator()(uint32_t item, Team team) const {
    const TileItem tile = queues.tiles[first + item];
    const Triangle triangle = queues.large[tile.triangle];
    const PixelBox box = tile_box(triangle, view, tile.x, tile.y);
    if (box.empty()) return;
    const int64_t area = doubled_area(triangle.x, triangle.y);
    with_mask<kOrthographic>(team, masks, view, triangle, [&](const auto& mask) {
      draw_box_with_team<kOrthographic, int64_t>(team, target, triangle, box, area, mask);
    });
  }
};

}  // namespace SCREE_ISA
}  // namespace scree::kernels
