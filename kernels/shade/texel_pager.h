// Pages of block images, which come to memory when pixels sample them. A picture is shaded in rounds. A pixel that
// lacks a page marks it as wanted and waits; between two rounds the wanted pages are read. So the picture does not
// depend on the room for pages.
#pragma once

#include <cstdint>
#include <functional>
#include <mutex>
#include <span>

#include "format/result.h"

namespace scree::kernels {

/// A tile of a picture with pixels that lacked texels: one bit per pixel, row by row.
struct UnfinishedTile {
  uint32_t tile;
  uint32_t pixels;
};

/// The pages as shading reads them, by a number that is unique in the scene: pointers to memory of the CPU or the GPU
/// that shades.
struct TexelPages {
  const uint8_t* const* blocks;  // a page's raw bytes; null if it is absent
  uint64_t* wanted;              // the last round that wanted the page
  uint64_t round;                // the current one
};

/// Keeps track of the pages that are present and of the pages that a round wants.
class TexelPager {
 public:
  virtual ~TexelPager() = default;

  /// Until the next round begins.
  const TexelPages& pages() const { return pages_; }
  void begin_round() { ++pages_.round; }
  /// Called when a round's shading has ended: reads the wanted pages that are absent, and keeps the ones that are
  /// present. If they exceed the room for pages, reads nothing and returns false; with `must` that is an error. Errors
  /// of reading and checking pages; kMemory; kDevice.
  virtual Result<bool> bring(bool must) = 0;

  /// Held while a picture is shaded, because its rounds would change another picture's pages.
  std::mutex& mutex() { return mutex_; }

 protected:
  TexelPages pages_{};

 private:
  std::mutex mutex_;
};

/// Shades all pixels of a picture of `tile_count` tiles. `shade(tiles, left)` shades the pixels of `tiles` (empty: all
/// pixels of all tiles). It lists the tiles with pixels that lacked texels in `left`, which has room for as many, and
/// returns their number. If the pages of all tiles exceed the room, fewer tiles are shaded at a time, down to one
/// pixel. Errors of `shade` and TexelPager::bring. Throws std::bad_alloc.
Result<void> shade_in_rounds(
    TexelPager& pager, uint32_t tile_count,
    const std::function<Result<uint32_t>(std::span<const UnfinishedTile>, UnfinishedTile*)>& shade);

}  // namespace scree::kernels
