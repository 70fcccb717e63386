// An image of a .scree file that is stored as blocks. Stored levels stay blocks; the levels below them are computed.
// Large levels may stay in the file until their pages are sampled (block_pager.h).
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "format/blocks/format.h"
#include "format/container/container.h"
#include "format/result.h"
#include "kernels/scene_view.h"
#include "runtime/files/read_ahead.h"
#include "runtime/images/image.h"
#include "runtime/textures/block_pager.h"
#include "runtime/textures/texture.h"

namespace scree::runtime {

/// Levels of at most this many bytes are always in memory, because looking up a paged level takes longer.
inline constexpr uint64_t kLeastPagedBytes = uint64_t{1} << 14;

class BlockTexture {
 public:
  /// Loads image `image` of `container`, whose codec is kBlocks. Checks its pages' checksums. Levels below the last
  /// stored one are made from it by make_mips(). `paged`: the first levels stay in the file if they have pages of their
  /// own and more than kLeastPagedBytes. Errors of Container::load_page, with the level; kRange (the last stored level
  /// has more than kMaxImagePixels, and levels below). Throws std::bad_alloc.
  static Result<BlockTexture> load(const format::Container& container, uint32_t image, TexelCoding coding, bool paged);

  /// Adds the ranges of the file that load() reads to the current item of `ahead`. Throws std::bad_alloc.
  static void add_ranges(const format::Container& container, uint32_t image, bool paged, ReadAhead& ahead);

  /// Adds the pages of the levels that stay in the file. Throws std::bad_alloc.
  void add_pages(const format::Container& container, uint32_t image, HostBlockPager& pager);

  /// Valid as long as this, which may be moved.
  kernels::TextureView view(const format::TextureRecord& record) const;

  bool empty() const { return offsets_.empty(); }
  std::span<const std::byte> blocks() const { return blocks_; }  // of the levels that are in memory
  uint64_t bytes() const { return blocks_.size() + made_.texels.size(); }

 private:
  format::ImageRecord record_{};
  std::vector<std::byte> blocks_;  // of the stored levels that are not paged, each at a multiple of 16
  std::vector<uint64_t> offsets_;  // by level: in blocks_, or the number of its first page
  uint32_t paged_levels_ = 0;
  MipChain made_;  // the levels below; its level 0 is the first of them
};

/// The place of a stored level of a block image: rows.pages() pages from `page` on. If it is one page, the page may
/// hold other levels too, and the level begins at `offset`.
struct LevelPlace {
  uint32_t page;
  uint64_t offset;
  format::BlockRows rows;
};
LevelPlace block_level_place(const format::Container& container, uint32_t image, uint32_t level);

/// Checks a page and unpacks it to `raw`, which has raw_bytes. Errors as Container::load_page.
Result<void> load_page_into(const format::Container& container, uint32_t page, std::span<std::byte> raw);

/// Reads stored levels of block images. `container` must outlive this.
class BlockLevels {
 public:
  explicit BlockLevels(const format::Container& container) : container_(container) {}

  /// The blocks of a level: BlockRows::bytes() of them. A page that holds several levels is checked and unpacked once
  /// if these are read one after the other. Errors as Container::load_page, with the level.
  Result<void> read(uint32_t image, uint32_t level, std::span<std::byte> out);

 private:
  const format::Container& container_;
  uint32_t shared_page_ = format::kNone;  // the last page that held several levels
  std::span<const std::byte> shared_;     // its bytes, in the file's map or unpacked_
  std::vector<std::byte> unpacked_;
};

/// Level 0 as a picture. Errors as BlockTexture::load; kRange: more than kMaxImagePixels. Throws std::bad_alloc.
Result<Image> decode_block_image(const format::Container& container, uint32_t image);

}  // namespace scree::runtime
