// Pages of block images that are in memory only while pixels sample them. A picture is shaded in rounds: a pixel that
// lacks a page asks for it and is left, and between two rounds the pages are brought. So the picture does not depend on
// how many pages there is room for.
#pragma once

#include <cstdint>
#include <functional>
#include <mutex>
#include <span>
#include <vector>

#include "format/result.h"

namespace scree::kernels {

/// A tile of a picture with pixels that lacked texels: one bit per pixel, row by row.
struct UnfinishedTile {
  uint32_t tile;
  uint32_t pixels;
};

/// Which pages are there, by a number that is unique in the scene, and which of them a round wants.
class TexelPager {
 public:
  virtual ~TexelPager() = default;

  /// The page's raw bytes, null where it is not there. Either way the round wants it. Thread-safe during a round.
  const uint8_t* want(uint64_t number) {
    uint8_t& wanted = wanted_[number];
    if (__atomic_load_n(&wanted, __ATOMIC_RELAXED) == 0) __atomic_store_n(&wanted, uint8_t{1}, __ATOMIC_RELAXED);
    return blocks_[number];
  }

  /// From now on no page is wanted.
  virtual void begin_round() = 0;
  /// Brings the pages that the round wants, and keeps those that are there. Returns false, and does nothing, where they
  /// exceed the room for pages; if `must` is set, that is an error. Errors of reading and checking pages; kMemory.
  virtual Result<bool> bring(bool must) = 0;

  /// Held by whoever shades, as one picture's rounds would change another's pages.
  std::mutex& mutex() { return mutex_; }

 protected:
  std::vector<const uint8_t*> blocks_;
  std::vector<uint8_t> wanted_;

 private:
  std::mutex mutex_;
};

/// Shades all pixels of `tile_count` tiles. `shade(tiles, left)` shades the pixels of `tiles`, lists those that lacked
/// texels in `left`, which has room for as many, and returns their number. If the pages of all tiles exceed the room,
/// fewer tiles are shaded at a time, down to one pixel. Errors of TexelPager::bring. Throws std::bad_alloc.
Result<void> shade_in_rounds(TexelPager& pager, uint32_t tile_count,
                             const std::function<uint32_t(std::span<const UnfinishedTile>, UnfinishedTile*)>& shade);

}  // namespace scree::kernels
