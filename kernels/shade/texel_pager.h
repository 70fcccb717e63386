// Pages of block images that are in memory only while pixels sample them. A picture is shaded in rounds: a pixel that
// lacks a page asks for it and is left, and between two rounds the pages are brought. So the picture does not depend on
// how many pages there is room for.
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
  const uint8_t* const* blocks;  // a page's raw bytes; null where it is not there
  uint64_t* wanted;              // the last round that wanted it
  uint64_t round;                // the current one
};

/// Which pages are there, and which of them a round wants.
class TexelPager {
 public:
  virtual ~TexelPager() = default;

  /// Until the next round begins.
  const TexelPages& pages() const { return pages_; }
  void begin_round() { ++pages_.round; }
  /// Brings the pages that the round wants, and keeps those that are there; shading has ended. Returns false, and
  /// brings nothing, where they exceed the room for pages; if `must` is set, that is an error. Errors of reading and
  /// checking pages; kMemory; kDevice.
  virtual Result<bool> bring(bool must) = 0;

  /// Held by whoever shades, as one picture's rounds would change another's pages.
  std::mutex& mutex() { return mutex_; }

 protected:
  TexelPages pages_{};

 private:
  std::mutex mutex_;
};

/// Shades all pixels of a picture of `tile_count` tiles. `shade(tiles, left)` shades the pixels of `tiles` (none: all
/// pixels of all tiles), lists those that lacked texels in `left`, which has room for as many, and returns their
/// number. If the pages of all tiles exceed the room, fewer tiles are shaded at a time, down to one pixel. Errors of
/// `shade` and TexelPager::bring. Throws std::bad_alloc.
Result<void> shade_in_rounds(
    TexelPager& pager, uint32_t tile_count,
    const std::function<Result<uint32_t>(std::span<const UnfinishedTile>, UnfinishedTile*)>& shade);

}  // namespace scree::kernels
