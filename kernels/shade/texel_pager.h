// Pages of block images and JPEGs, which are read when pixels sample them. A picture is shaded in rounds. A pixel that
// lacks a page marks it as wanted and waits; between two rounds the wanted pages are read. So the picture does not
// depend on the room for pages. A picture that must not wait takes coarser levels instead (set_patience()).
#pragma once

#include <cstdint>
#include <functional>
#include <mutex>
#include <span>
#include <utility>

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
  const uint8_t* const* blocks;  // a page's raw bytes (of JPEGs, with JpegLevel::picture behind); null if it is absent
  uint64_t* wanted;              // the last round that wanted the page
  uint64_t round;                // the current one
  bool takes_coarser;            // where a page is absent, the next coarser level that is present is sampled
};

/// Keeps track of the pages that are present and of the pages that a round wants.
class TexelPager {
 public:
  virtual ~TexelPager() = default;

  /// Until the next round begins.
  const TexelPages& pages() const { return pages_; }
  void begin_round() { ++pages_.round; }
  void take_coarser(bool takes) { pages_.takes_coarser = takes; }
  /// Called when a round's shading has ended: reads the wanted pages that are absent, and keeps the ones that are
  /// present. If they exceed the room for pages, reads none and returns false; with `must` that is an error. With a
  /// patience, it may read a part of them. Errors of reading and checking pages; kMemory; kDevice.
  virtual Result<bool> bring(bool must) = 0;

  /// From now on, pictures wait for their pages only until `is_over` returns true, at least for some of them. Pixels
  /// that still lack pages are then shaded with coarser levels, and missing_bytes() counts these pages. An empty
  /// function: pictures wait for all pages. Sets missing_bytes() to 0.
  void set_patience(std::function<bool()> is_over) {
    is_over_ = std::move(is_over);
    missing_bytes_ = 0;
  }
  bool is_over() const { return has_patience() && is_over_(); }
  uint64_t missing_bytes() const { return missing_bytes_; }
  /// Adds absent pages that were wanted in round `first` or later to missing_bytes(). Errors kDevice.
  Result<void> count_missing(uint64_t first) {
    missing_bytes_ += SCREE_TRY(missing_since(first));
    return {};
  }

  /// Held while a picture is shaded, because its rounds would change another picture's pages.
  std::mutex& mutex() { return mutex_; }

 protected:
  /// Bytes of the absent pages that were wanted in round `first` or later.
  virtual Result<uint64_t> missing_since(uint64_t first) = 0;

  bool has_patience() const { return static_cast<bool>(is_over_); }

  TexelPages pages_{};

 private:
  std::mutex mutex_;
  std::function<bool()> is_over_;
  uint64_t missing_bytes_ = 0;
};

/// Shades all pixels of a picture of `tile_count` tiles. `shade(tiles, left)` shades the pixels of `tiles` (empty: all
/// pixels of all tiles). It lists the tiles with pixels that lacked texels in `left`, which has room for as many, and
/// returns their number. If the pages of all tiles exceed the room, fewer tiles are shaded at a time, down to one
/// pixel. If the pager's patience ends, all that is left is shaded with coarser levels. Errors of `shade` and
/// TexelPager::bring. Throws std::bad_alloc.
Result<void> shade_in_rounds(
    TexelPager& pager, uint32_t tile_count,
    const std::function<Result<uint32_t>(std::span<const UnfinishedTile>, UnfinishedTile*)>& shade);

}  // namespace scree::kernels
