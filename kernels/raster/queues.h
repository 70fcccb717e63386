// The queues between passes. A counter may exceed its queue's capacity; no entry is written there. The CPU's driver
// (passes.h) then enlarges the queue or takes a smaller share, and runs the pass again. On a GPU (cuda/frame/frame.cu)
// the queue is enlarged and the frame drawn again, except that tiles without room are drawn at once. Drawing twice does
// not change the picture.
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

/// Room for the fragments of blended surfaces in front of a picture, in device memory: up to `slot_count` per sample,
/// in any order. A fragment may occur twice.
struct FragmentSlots {
  uint64_t* words;   // slot by slot, sample_count each
  uint32_t* alphas;  // MaskPlane::shown() of each word
  uint32_t* counts;  // fragments per sample; if there are too many, any number above slot_count
  uint64_t sample_count;
  uint32_t slot_count;
};

/// The picture being drawn, row by row.
struct Target {
  uint64_t* samples;
  int32_t width;
  // When a layer of blended surfaces is drawn (spec/rasterization.md, blending): the layer before it, or null. Only
  // fragments behind that layer are drawn. Read only by builds that test masks.
  const uint64_t* peeled = nullptr;
  // For blended surfaces on a GPU: the slots for all fragments in front of `samples`, which then stay as they are. If
  // `counts` is null, fragments are written to the samples.
  FragmentSlots fragments = {};

  SCREE_HD uint64_t* row(int32_t y) const { return samples + static_cast<uint64_t>(y) * static_cast<uint64_t>(width); }

  /// Whether `value` lies behind the layer before, or there is none. `sample`: its place in `samples`.
  SCREE_HD bool is_behind_peeled(const uint64_t* sample, uint64_t value) const {
    return peeled == nullptr || value > peeled[sample - samples];
  }
};

}  // namespace SCREE_ISA
}  // namespace scree::kernels
