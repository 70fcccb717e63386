// An image of a .scree file that is stored as indexed JPEGs: its base level and its stored mip levels.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <span>
#include <vector>

#include "format/container/container.h"
#include "format/jpeg/index.h"
#include "format/result.h"
#include "kernels/scene_view.h"
#include "runtime/files/read_ahead.h"
#include "runtime/images/image.h"
#include "runtime/textures/texture.h"

namespace scree::runtime {

/// Some of an image's levels.
struct JpegLevels {
  uint32_t image = 0;
  uint32_t first = 0;
  uint32_t count = 0;
};

/// The levels of one image from some level on, opened. They refer to the container's file, or to memory of this object
/// for compressed pages.
class JpegImage {
 public:
  /// Opens the levels from `first` on of image `image` of `container`, whose codec is kIndexedJpeg; at least the last.
  /// Checks the checksums of their pages, and each level against the record. Errors of Container::load_page and
  /// format::open_jpeg_index, kRange (size or number of components differ from the record), each with the level.
  static Result<JpegImage> open(const format::Container& container, uint32_t image, uint32_t first = 0);

  /// Level `first` and the stored levels below it.
  const std::vector<format::JpegIndex>& levels() const { return levels_; }

  /// Decodes all levels, if all are open. Levels below the last stored one are made from it. Errors kFormat. Throws
  /// std::bad_alloc.
  Result<MipChain> decode(TexelCoding coding = TexelCoding::kColor) const;

  /// Decodes the last stored level, which is level 0 of the result, and makes the levels below it. Errors and throws as
  /// decode().
  Result<MipChain> decode_tail(TexelCoding coding = TexelCoding::kColor) const;

 private:
  struct Page {
    std::vector<std::byte> unpacked;
    std::span<const std::byte> bytes;
  };

  std::map<uint32_t, Page> pages_;
  std::vector<format::JpegIndex> levels_;
  uint32_t first_ = 0;
};

class HostBlockPager;

/// An image in the form that kernels use: the last stored level and all below it are decoded; finer levels stay JPEGs.
class JpegTexture {
 public:
  /// Loads image `image` of `container`, whose codec is kIndexedJpeg. `paged`: levels before the last stored one stay
  /// in the file if their pages have more than kLeastPagedBytes. Errors and throws as JpegImage::open and decode_tail.
  static Result<JpegTexture> load(const format::Container& container, uint32_t image,
                                  TexelCoding coding = TexelCoding::kColor, bool paged = false);

  /// Adds the ranges of the file that load() reads to the current item of `ahead`. Throws std::bad_alloc.
  static void add_ranges(const format::Container& container, uint32_t image, bool paged, ReadAhead& ahead);

  /// Adds the pages of the levels that stay in the file. Throws std::bad_alloc.
  void add_pages(const format::Container& container, uint32_t image, HostBlockPager& pager);

  uint32_t paged_levels() const { return paged_levels_; }  // the first of jpeg_levels()
  /// The next three functions take levels that are in memory. The bytes of a level: data, anchor blocks and anchors,
  /// contiguous as in the file, from JpegView::data on.
  std::span<const std::byte> level_bytes(size_t level) const;
  const format::JpegIndex& index(size_t level) const { return image_.levels()[level - paged_levels_]; }
  std::span<const uint32_t> factors(size_t level) const { return factors_[level - paged_levels_]; }

  /// Numbers the JPEG levels from `number` on, and their groups from groups.count on. Adds them to both.
  void number_levels(uint32_t& number, kernels::JpegGroups& groups);

  /// Valid as long as this, which may be moved.
  kernels::TextureView view(const format::TextureRecord& record) const;

  std::span<const kernels::JpegLevel> jpeg_levels() const { return levels_; }
  /// Bytes of the largest group of jpeg_levels(), decoded; 0 if there are none. Paged levels count as the last stored
  /// one, which a writer codes alike.
  uint32_t group_bytes() const;
  uint64_t decoded_bytes() const { return tail_.texels.size(); }
  uint64_t jpeg_bytes() const;  // of the levels that stay JPEGs in memory: data, index and tables

 private:
  /// A level's picture. A paged level is assumed to be coded like the last stored level, because its bytes are not in
  /// memory.
  format::JpegPicture picture_of(size_t level) const;

  JpegImage image_;  // without the paged levels
  uint32_t width_ = 0;
  uint32_t height_ = 0;
  uint32_t paged_levels_ = 0;
  std::vector<std::vector<uint32_t>> factors_;
  std::vector<kernels::JpegLevel> levels_;
  MipChain tail_;
};

/// Opens one level and checks that it has `width` x `height` pixels and `channels` components. Errors as
/// JpegImage::open.
Result<format::JpegIndex> open_jpeg_level(std::span<const std::byte> bytes, uint32_t width, uint32_t height,
                                          uint32_t channels);

/// Memory for a page of JPEG levels in the form that kernels read (kernels::JpegLevel): its raw bytes, and behind them
/// a head for each level. `place`: the number of a level in the page. The number of levels gives the end of the memory.
uint64_t jpeg_head_place(uint64_t raw_bytes, uint32_t channels, uint32_t place);

/// Checks a page's levels as open_jpeg_level(), and writes their heads. `memory`: the raw bytes, and room for the
/// heads. `address`: where the memory will lie when kernels read it. Errors of open_jpeg_level, with image and level.
Result<void> write_jpeg_heads(const format::Container& container, const JpegLevels& levels, std::byte* memory,
                              uint64_t raw_bytes, const std::byte* address);

/// Makes the pointers of a view to a level's bytes point to a copy of them. `data`: the copy's JpegView::data.
void move_jpeg_view(format::JpegView& view, const std::byte* data);

/// A level as a picture. Errors kFormat, kRange (more than kMaxImagePixels). Throws std::bad_alloc.
Result<Image> decode_jpeg_level(const format::JpegIndex& level);

}  // namespace scree::runtime
