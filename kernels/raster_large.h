// Stage 3: large triangles in 64 x 64 tiles: first the tiles each may cover, then one team a tile.
#pragma once

#include "kernels/raster_medium.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

/// One team a triangle of the large queue, lanes over the tiles of its box.
struct SplitLarge {
  FrameView view;
  Queues queues;
  uint64_t first;  // queue entry of item 0

  template <class Team>
  SCREE_HD void operator()(uint32_t item, Team team) const {
    const Triangle& triangle = queues.large[first + item];
    const PixelBox box = pixel_box(triangle.x, triangle.y, view);
    const uint32_t first_x = static_cast<uint32_t>(box.x0) / kTileSide;
    const uint32_t first_y = static_cast<uint32_t>(box.y0) / kTileSide;
    const uint32_t columns = static_cast<uint32_t>(box.x1) / kTileSide - first_x + 1;
    const uint32_t rows = static_cast<uint32_t>(box.y1) / kTileSide - first_y + 1;
    for (uint32_t i = team.rank(); i < columns * rows; i += team.size()) {
      const uint32_t x = first_x + i % columns;
      const uint32_t y = first_y + i / columns;
      if (!may_cover(triangle, static_cast<int32_t>(x), static_cast<int32_t>(y))) continue;
      push(team, &queues.counters->tiles, queues.tiles, queues.tile_capacity,
           TileItem{static_cast<uint32_t>(first + item), static_cast<uint16_t>(x), static_cast<uint16_t>(y)});
    }
  }

 private:
  /// False where all the tile's pixel centres lie outside one edge: each edge function is looked at in the corner where
  /// it is largest.
  SCREE_HD static bool may_cover(const Triangle& triangle, int32_t tile_x, int32_t tile_y) {
    const Edges<int64_t> edges = make_edges<int64_t>(triangle, tile_x * kTileSide, tile_y * kTileSide);
    for (int i = 0; i < 3; ++i) {
      const int64_t largest = edges.value[i] + (kTileSide - 1) * (max_of<int64_t>(edges.step_x[i], 0) +
                                                                  max_of<int64_t>(edges.step_y[i], 0));
      if (largest < 0) return false;
    }
    return true;
  }
};

template <bool kOrthographic>
struct RasterTiles {
  FrameView view;
  Target target;
  Queues queues;
  uint64_t first;  // queue entry of item 0

  template <class Team>
  SCREE_HD void operator()(uint32_t item, Team team) const {
    const TileItem tile = queues.tiles[first + item];
    const Triangle triangle = queues.large[tile.triangle];
    PixelBox box = pixel_box(triangle.x, triangle.y, view);
    box.x0 = max_of(box.x0, tile.x * kTileSide);
    box.y0 = max_of(box.y0, tile.y * kTileSide);
    box.x1 = min_of(box.x1, tile.x * kTileSide + kTileSide - 1);
    box.y1 = min_of(box.y1, tile.y * kTileSide + kTileSide - 1);
    if (box.empty()) return;
    draw_box_with_team<kOrthographic, int64_t>(team, target, triangle, box, doubled_area(triangle.x, triangle.y));
  }
};

}  // namespace SCREE_ISA
}  // namespace scree::kernels
