// The passes of a frame in their order, for a backend that looks at the queues between them: the CPU's. On a GPU a
// frame is one submission, and cuda_frame.cu has the order.
//
// A backend has
//   for_each(uint64_t count, const Pass&)     runs pass(item, team) for items 0 to count - 1, count <= 2^32
//   T* allocate<T>(uint64_t count)            memory of the passes; null when none is left
//   void release(T*)
//   Counters read_counters()                  of queues.counters, between passes
//   void write_counters(const Counters&)
//   Counters* counters()                      the place itself, for the passes
#pragma once

#include "kernels/cull.h"
#include "kernels/raster_large.h"
#include "kernels/raster_medium.h"
#include "kernels/raster_small.h"

namespace scree::kernels {

/// First capacities of the queues, and how much is drawn between two looks at their counters.
struct QueueSizes {
  uint64_t blocks = 1u << 14;
  uint64_t medium = 1u << 15;
  uint64_t large = 1u << 13;
  uint64_t tiles = 1u << 17;
  uint64_t instances_at_a_time = 1u << 20;
  uint64_t blocks_at_a_time = 1u << 12;
  uint32_t block_triangles = 65536;  // of a draw block
};

inline namespace SCREE_ISA {

/// Sets every sample of one row to the background.
struct Clear {
  Target target;

  template <class Team>
  SCREE_HD void operator()(uint32_t item, Team team) const {
    uint64_t* row = target.row(static_cast<int32_t>(item));
    for (uint32_t x = team.rank(); x < static_cast<uint32_t>(target.width); x += team.size()) row[x] = kBackground;
  }
};

/// Draws into a picture that was cleared, or holds what chunks that have gone since drew. `draw()` returns false when
/// memory ran out.
template <class Backend, bool kOrthographic>
class FrameDrawer {
 public:
  FrameDrawer(Backend& backend, const SceneView& scene, const FrameView& view, uint64_t* samples,
              const QueueSizes& sizes)
      : backend_(backend), scene_(scene), view_(view), target_{samples, view.width}, sizes_(sizes) {
    queues_ = Queues{};
    queues_.counters = backend.counters();
  }
  FrameDrawer(const FrameDrawer&) = delete;
  FrameDrawer& operator=(const FrameDrawer&) = delete;
  ~FrameDrawer() {
    backend_.release(queues_.blocks);
    backend_.release(queues_.medium);
    backend_.release(queues_.large);
    backend_.release(queues_.tiles);
  }

  bool draw(FrameStats& stats) {
    stats = FrameStats{};
    // A large triangle must find room for all its tiles at once.
    const uint64_t image_tiles = tiles_of(view_.width) * tiles_of(view_.height);
    if (!grow(queues_.blocks, queues_.block_capacity, sizes_.blocks) ||
        !grow(queues_.medium, queues_.medium_capacity, sizes_.medium) ||
        !grow(queues_.large, queues_.large_capacity, sizes_.large) ||
        !grow(queues_.tiles, queues_.tile_capacity, max_of(sizes_.tiles, image_tiles))) {
      return false;
    }
    uint64_t share = max_of<uint64_t>(sizes_.instances_at_a_time, 1);
    for (uint64_t first = 0; first < scene_.instance_count;) {
      const uint64_t count = min_of(share, scene_.instance_count - first);
      backend_.write_counters(Counters{});
      backend_.for_each(count, Cull{scene_, view_, queues_, first, max_of(sizes_.block_triangles, 1u)});
      const Counters culled = backend_.read_counters();
      if (culled.blocks > queues_.block_capacity) {
        if (count > 1 && culled.blocks > kMostBlocks) {
          share = count / 2;
        } else if (!grow(queues_.blocks, queues_.block_capacity, culled.blocks)) {
          return false;
        }
        continue;
      }
      stats.instances_drawn += culled.instances_drawn;
      stats.draws += culled.draws;
      if (!draw_blocks(culled.blocks, stats)) return false;
      first += count;
    }
    return true;
  }

 private:
  static constexpr uint64_t kMostBlocks = 1u << 22;     // 96 MiB; beyond, fewer instances at a time
  static constexpr uint64_t kMostTriangles = 1u << 21;  // 96 MiB a queue; beyond, fewer blocks at a time

  static uint64_t tiles_of(int32_t side) { return (static_cast<uint64_t>(side) + kTileSide - 1) / kTileSide; }

  /// The queues' contents are not kept.
  template <class T>
  bool grow(T*& items, uint64_t& capacity, uint64_t needed) {
    needed = max_of<uint64_t>(needed, 1);
    if (needed <= capacity) return true;
    backend_.release(items);
    capacity = 0;
    items = backend_.template allocate<T>(needed);
    if (items == nullptr) return false;
    capacity = needed;
    return true;
  }

  bool draw_blocks(uint64_t total, FrameStats& stats) {
    uint64_t share = max_of<uint64_t>(sizes_.blocks_at_a_time, 1);
    for (uint64_t first = 0; first < total;) {
      const uint64_t count = min_of(share, total - first);
      backend_.write_counters(Counters{});
      backend_.for_each(count, RasterSmall<kOrthographic>{scene_, view_, target_, queues_, first});
      const Counters drawn = backend_.read_counters();
      if (drawn.medium > queues_.medium_capacity || drawn.large > queues_.large_capacity) {
        if (count > 1 && max_of(drawn.medium, drawn.large) > kMostTriangles) {
          share = count / 2;
        } else if (!grow(queues_.medium, queues_.medium_capacity, drawn.medium) ||
                   !grow(queues_.large, queues_.large_capacity, drawn.large)) {
          return false;
        }
        continue;
      }
      if (drawn.medium != 0) {
        backend_.for_each(drawn.medium, RasterMedium<kOrthographic>{view_, target_, queues_, 0});
      }
      draw_large(drawn.large);
      stats.triangles += drawn.triangles;
      stats.triangles_small += drawn.triangles_small;
      stats.triangles_medium += drawn.medium;
      stats.triangles_large += drawn.large;
      stats.triangles_clipped += drawn.triangles_clipped;
      first += count;
    }
    return true;
  }

  /// A triangle can have 65,536 tiles, so the queue of tiles does not grow: fewer triangles go at a time.
  void draw_large(uint64_t total) {
    uint64_t share = max_of<uint64_t>(total, 1);
    for (uint64_t first = 0; first < total;) {
      const uint64_t count = min_of(share, total - first);
      backend_.write_counters(Counters{});
      backend_.for_each(count, SplitLarge{view_, queues_, first});
      const uint64_t tiles = backend_.read_counters().tiles;
      if (tiles > queues_.tile_capacity) {
        share = max_of<uint64_t>(count / 2, 1);
        continue;
      }
      backend_.for_each(tiles, RasterTiles<kOrthographic>{view_, target_, queues_, 0});
      first += count;
    }
  }

  Backend& backend_;
  SceneView scene_;
  FrameView view_;
  Target target_;
  QueueSizes sizes_;
  Queues queues_;
};

template <class Backend>
void clear_frame(Backend& backend, const FrameView& view, uint64_t* samples) {
  backend.for_each(static_cast<uint64_t>(view.height), Clear{{samples, view.width}});
}

template <class Backend>
bool draw_frame(Backend& backend, const SceneView& scene, const FrameView& view, uint64_t* samples,
                const QueueSizes& sizes, FrameStats& stats) {
  if (view.orthographic) return FrameDrawer<Backend, true>(backend, scene, view, samples, sizes).draw(stats);
  return FrameDrawer<Backend, false>(backend, scene, view, samples, sizes).draw(stats);
}

}  // namespace SCREE_ISA
}  // namespace scree::kernels
