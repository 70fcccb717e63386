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
#include "runtime/images/image.h"
#include "runtime/textures/texture.h"

namespace scree::runtime {

/// The levels of one image, opened. They refer to the container's file, or to memory of this object for compressed
/// pages.
class JpegImage {
 public:
  /// Opens image `image` of `container`, whose codec is kIndexedJpeg. Checks its pages' checksums, and each level
  /// against the record. Errors of Container::load_page and format::open_jpeg_index, kRange (size or number of
  /// components differ from the record), each with the level.
  static Result<JpegImage> open(const format::Container& container, uint32_t image);

  /// Level 0 and the stored levels below it.
  const std::vector<format::JpegIndex>& levels() const { return levels_; }

  /// Decodes all levels. Levels below the last stored one are made from it. Errors kFormat. Throws std::bad_alloc.
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
};

/// An image in the form that kernels use: the last stored level and all below it are decoded; finer levels stay JPEGs.
class JpegTexture {
 public:
  /// Errors and throws as JpegImage::decode_tail.
  static Result<JpegTexture> make(JpegImage image, TexelCoding coding = TexelCoding::kColor);

  /// The bytes of a level: data, anchor blocks and anchors, contiguous as in the file, from JpegView::data on.
  std::span<const std::byte> level_bytes(size_t level) const;
  const format::JpegIndex& index(size_t level) const { return image_.levels()[level]; }
  std::span<const uint32_t> factors(size_t level) const { return factors_[level]; }

  /// Numbers the JPEG levels from `number` on, and their groups from groups.count on. Adds them to both.
  void number_levels(uint32_t& number, kernels::JpegGroups& groups);

  /// Valid as long as this, which may be moved.
  kernels::TextureView view(const format::TextureRecord& record) const;

  std::span<const kernels::JpegLevel> jpeg_levels() const { return levels_; }
  uint64_t decoded_bytes() const { return tail_.texels.size(); }
  uint64_t jpeg_bytes() const;  // of the levels that stay JPEGs: data, index and tables

 private:
  JpegImage image_;
  std::vector<std::vector<uint32_t>> factors_;
  std::vector<kernels::JpegLevel> levels_;
  MipChain tail_;
};

/// Opens one level and checks that it has `width` x `height` pixels and `channels` components. Errors as
/// JpegImage::open.
Result<format::JpegIndex> open_jpeg_level(std::span<const std::byte> bytes, uint32_t width, uint32_t height,
                                          uint32_t channels);

/// A level as a picture. Errors kFormat, kRange (more than kMaxImagePixels). Throws std::bad_alloc.
Result<Image> decode_jpeg_level(const format::JpegIndex& level);

}  // namespace scree::runtime
