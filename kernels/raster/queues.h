// The queues between passes. A counter may run past its queue's capacity; nothing is written there. The CPU's driver
// (passes.h) then enlarges the queue or takes a smaller share, and runs the pass again. On a GPU (cuda/frame.cu) the
// queue is enlarged and the frame drawn again, except that tiles without room are drawn at once. Drawing twice changes
// nothing.
#pragma once

#include "kernels/raster/setup.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

/// Up to QueueSizes::block_triangles triangles of one chunk, drawn for one instance. A team takes one block at a time.
struct DrawBlock {
  uint64_t instance;
  uint64_t chunk;
  uint32_t first_triangle;  // number in the chunk
  uint32_t triangle_count;
  float nearest;  // nearness() of the chunk
};

/// One 64 x 64 tile of the image under one triangle of the large queue.
struct TileItem {
  uint32_t triangle;  // index in the large queue
  uint16_t x;         // in tiles
  uint16_t y;
};

/// Queue counters (the number of requested entries, which may exceed the capacity) and statistics.
struct Counters {
  uint64_t blocks;
  uint64_t medium;
  uint64_t large;
  uint64_t tiles;
  uint64_t instances_drawn;
  uint64_t draws;
  uint64_t triangles;
  uint64_t triangles_small;
  uint64_t triangles_clipped;
};

struct Queues {
  DrawBlock* blocks;
  Triangle* medium;
  Triangle* large;
  TileItem* tiles;
  uint64_t block_capacity;
  uint64_t medium_capacity;
  uint64_t large_capacity;  // at most 2^32
  uint64_t tile_capacity;   // on a CPU at least the tiles of one image
  Counters* counters;
};

/// Appends if there is room; counts in any case.
template <class Team, class T>
SCREE_HD inline void push(Team team, uint64_t* counter, T* items, uint64_t capacity, const T& item) {
  const uint64_t slot = team.add(counter, 1);
  if (slot < capacity) items[slot] = item;
}

/// Keeps `value` if it is among the least of a sample's `layers` words, which lie `stride` words apart, the least first
/// and the last at `last`. Each word takes the minimum and passes on the larger value, so that the result does not
/// depend on the order of drawing. A value that is there already ends at its own word. A call, because a frame's loops
/// over samples keep their values in registers.
template <class Team>
[[gnu::noinline]] SCREE_HD void keep_least(Team team, uint64_t* last, uint64_t value, uint32_t layers,
                                           uint64_t stride) {
  for (uint64_t* word = last - (layers - 1) * stride;; word += stride) {
    uint64_t seen = team.load_relaxed(word);
    if (value < seen) seen = team.exchange_min(word, value);
    if (seen == value || word == last) return;
    value = max_of(value, seen);
  }
}

/// The picture being drawn, row by row.
struct Target {
  uint64_t* samples;
  int32_t width;
  // Of layers of blended surfaces (spec/rasterization.md, blending): the layer before them, or null. What is drawn lies
  // behind that. Only where masks are tested are this and the next two read.
  const uint64_t* peeled = nullptr;
  // So many of the least words are kept per sample. `samples` are those of the last layer, which all others lie before:
  // what is behind it is not seen.
  uint32_t layers = 1;
  uint64_t stride = 0;  // words from a layer to the next

  SCREE_HD uint64_t* row(int32_t y) const { return samples + static_cast<uint64_t>(y) * static_cast<uint64_t>(width); }

  /// Whether `value` lies behind the layer before. `sample`: its place in samples.
  SCREE_HD bool is_behind_peeled(const uint64_t* sample, uint64_t value) const {
    return peeled == nullptr || value > peeled[sample - samples];
  }

  /// Draws a sample that was tested. `sample`: as above.
  template <class Team>
  SCREE_HD void keep(Team team, uint64_t* sample, uint64_t value) const {
    if (layers == 1) {
      team.atomic_min(sample, value);
    } else {
      keep_least(team, sample, value, layers, stride);
    }
  }
};

}  // namespace SCREE_ISA
}  // namespace scree::kernels
