#include "runtime/textures/block_image.h"

#include <algorithm>
#include <string>
#include <utility>

#include "format/blocks/format.h"
#include "format/bytes.h"
#include "format/container/mip_levels.h"
#include "runtime/images/block_file.h"
#include "runtime/textures/mip_rows.h"

namespace scree::runtime {
namespace {

struct Size {
  uint32_t width;
  uint32_t height;
};

Size size_of(const format::ImageRecord& record, uint32_t level) {
  return {std::max(1u, record.width >> level), std::max(1u, record.height >> level)};
}

Result<Image> decode_level(const format::ImageRecord& record, uint32_t level, const std::byte* blocks) {
  const Size size = size_of(record, level);
  if (uint64_t{size.width} * size.height > kMaxImagePixels)
    return Error{ErrorCode::kRange, std::to_string(size.width) + " x " + std::to_string(size.height) +
                                        " pixels, but at most " + std::to_string(kMaxImagePixels) + " in all"};
  return decode_block_level(record.block_format, record.swizzle, size.width, size.height, blocks);
}

/// Whether the level has pages of its own that are worth leaving in the file.
bool may_be_paged(const format::Container& container, uint32_t image, uint32_t level) {
  const LevelPlace place = block_level_place(container, image, level);
  return place.rows.bytes() > kLeastPagedBytes &&
         (place.rows.pages() > 1 || container.pages()[place.page].raw_bytes == place.rows.bytes());
}

/// The number of levels that stay in the file.
uint32_t paged_levels(const format::Container& container, uint32_t image, bool paged) {
  uint32_t count = 0;
  while (paged && count <= container.images()[image].level_count && may_be_paged(container, image, count)) ++count;
  return count;
}

}  // namespace

Result<void> load_page_into(const format::Container& container, uint32_t page, std::span<std::byte> raw) {
  SCREE_TRY(container.check_page(page, container.padded_page(page)));
  const std::span<const std::byte> stored = container.stored_page(page);
  if (container.pages()[page].codec != format::PageCodec::kRaw) return container.unpack_page(page, stored, raw);
  std::copy(stored.begin(), stored.end(), raw.begin());
  return {};
}

LevelPlace block_level_place(const format::Container& container, uint32_t image, uint32_t level) {
  const format::ImageRecord& record = container.images()[image];
  if (level == 0) return {record.page, 0, format::block_rows(record, 0)};
  const format::MipLevelRecord& stored = container.mip_levels()[record.first_level + level - 1];
  return {stored.page, stored.offset, format::block_rows(record, level)};
}

Result<void> BlockLevels::read(uint32_t image, uint32_t level, std::span<std::byte> out) {
  const auto [first, offset, rows] = block_level_place(container_, image, level);
  const std::string place = "level " + std::to_string(level);
  if (container_.pages()[first].raw_bytes != rows.page_bytes(0)) {  // the page holds more
    if (shared_page_ != first) {
      shared_page_ = format::kNone;
      shared_ = SCREE_TRY_AT(place, container_.load_page(first, unpacked_));
      shared_page_ = first;
    }
    std::copy_n(shared_.begin() + static_cast<ptrdiff_t>(offset), out.size(), out.begin());
    return {};
  }
  for (uint32_t i = 0; i < rows.pages(); ++i) {
    SCREE_TRY_AT(place, load_page_into(container_, first + i, out.first(rows.page_bytes(i))));
    out = out.subspan(rows.page_bytes(i));
  }
  return {};
}

Result<Image> decode_block_image(const format::Container& container, uint32_t image) {
  const format::ImageRecord& record = container.images()[image];
  std::vector<std::byte> blocks(format::block_rows(record, 0).bytes());
  SCREE_TRY(BlockLevels(container).read(image, 0, blocks));
  return decode_level(record, 0, blocks.data());
}

Result<BlockTexture> BlockTexture::load(const format::Container& container, uint32_t image, TexelCoding coding,
                                        bool paged) {
  BlockTexture texture;
  const format::ImageRecord& record = texture.record_ = container.images()[image];
  const uint32_t first = texture.paged_levels_ = paged_levels(container, image, paged);
  texture.offsets_.resize(first);
  uint64_t bytes = 0;
  for (uint32_t level = first; level <= record.level_count; ++level) {
    texture.offsets_.push_back(bytes);
    bytes += format::align_up(format::block_rows(record, level).bytes(), format::kChunkAlignment);
  }
  texture.blocks_.resize(bytes);
  BlockLevels levels(container);
  for (uint32_t level = first; level <= record.level_count; ++level) {
    const std::span<std::byte> out =
        std::span(texture.blocks_).subspan(texture.offsets_[level], format::block_rows(record, level).bytes());
    SCREE_TRY(levels.read(image, level, out));
  }
  const Size last = size_of(record, record.level_count);
  if (last.width == 1 && last.height == 1) return texture;
  std::vector<std::byte> of_last;
  if (first > record.level_count) {
    of_last.resize(format::block_rows(record, record.level_count).bytes());
    SCREE_TRY(levels.read(image, record.level_count, of_last));
  }
  Image picture =
      SCREE_TRY_AT("level " + std::to_string(record.level_count),
                   decode_level(record, record.level_count,
                                of_last.empty() ? texture.blocks_.data() + texture.offsets_.back() : of_last.data()));
  MipChain chain = make_mips(std::move(picture), coding);
  // The picture itself is there as blocks.
  MipChain& made = texture.made_;
  const uint64_t before = chain.level_offset[1];
  made.level_count = chain.level_count - 1;
  for (uint32_t l = 0; l < made.level_count; ++l) made.level_offset[l] = chain.level_offset[l + 1] - before;
  made.texels.assign(chain.texels.begin() + static_cast<ptrdiff_t>(4 * before), chain.texels.end());
  return texture;
}

void BlockTexture::add_ranges(const format::Container& container, uint32_t image, bool paged, ReadAhead& ahead) {
  // The last stored level is read in any case, for the levels below it.
  const uint32_t last = container.images()[image].level_count;
  uint32_t next = 0;  // levels may share a page
  for (uint32_t level = std::min(paged_levels(container, image, paged), last); level <= last; ++level) {
    const LevelPlace place = block_level_place(container, image, level);
    for (uint32_t page = std::max(next, place.page); page < place.page + place.rows.pages(); ++page)
      ahead.add(container.pages()[page].offset, container.pages()[page].stored_bytes);
    next = std::max(next, place.page + place.rows.pages());
  }
}

void BlockTexture::add_pages(const format::Container& container, uint32_t image, HostBlockPager& pager) {
  for (uint32_t level = 0; level < paged_levels_; ++level) {
    const LevelPlace place = block_level_place(container, image, level);
    offsets_[level] = pager.size();
    for (uint32_t i = 0; i < place.rows.pages(); ++i) pager.add(place.page + i);
  }
}

kernels::TextureView BlockTexture::view(const format::TextureRecord& record) const {
  kernels::TextureView view = texture_view(made_, record);
  const uint32_t stored = record_.level_count + 1;
  std::copy_backward(view.level_offset, view.level_offset + view.level_count,
                     view.level_offset + stored + view.level_count);
  std::copy(offsets_.begin(), offsets_.end(), view.level_offset);
  view.width = record_.width;
  view.height = record_.height;
  view.level_count += stored;
  view.blocks = reinterpret_cast<const uint8_t*>(blocks_.data());
  view.block_level_count = stored;
  view.paged_level_count = paged_levels_;
  view.block_format = record_.block_format;
  view.swizzle = record_.swizzle;
  if (made_.texels.empty()) view.texels = nullptr;
  return view;
}

}  // namespace scree::runtime
