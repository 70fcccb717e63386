#include "runtime/textures/block_image.h"

#include <algorithm>
#include <string>
#include <utility>

#include "format/blocks/format.h"
#include "format/bytes.h"
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

}  // namespace

Result<std::span<const std::byte>> block_level(const format::Container& container, uint32_t image, uint32_t level,
                                               std::vector<std::byte>& scratch) {
  const format::ImageRecord& record = container.images()[image];
  const std::string place = "level " + std::to_string(level);
  if (level == 0) {
    const auto page = container.load_page(record.page, scratch);
    if (!page) return at(place, page.error());
    return page;
  }
  const format::MipLevelRecord& stored = container.mip_levels()[record.first_level + level - 1];
  const auto page = container.load_page(stored.page, scratch);
  if (!page) return at(place, page.error());
  return page->subspan(stored.offset, stored.bytes);
}

Result<Image> decode_block_image(const format::Container& container, uint32_t image) {
  std::vector<std::byte> scratch;
  const auto blocks = block_level(container, image, 0, scratch);
  if (!blocks) return blocks.error();
  return decode_level(container.images()[image], 0, blocks->data());
}

Result<BlockTexture> BlockTexture::load(const format::Container& container, uint32_t image, TexelCoding coding) {
  BlockTexture texture;
  const format::ImageRecord& record = texture.record_ = container.images()[image];
  std::vector<std::byte> scratch;
  for (uint32_t level = 0; level <= record.level_count; ++level) {
    const auto blocks = block_level(container, image, level, scratch);
    if (!blocks) return blocks.error();
    texture.offsets_.push_back(format::align_up(texture.blocks_.size(), format::kChunkAlignment));
    texture.blocks_.resize(texture.offsets_.back());
    texture.blocks_.insert(texture.blocks_.end(), blocks->begin(), blocks->end());
  }
  const Size last = size_of(record, record.level_count);
  if (last.width == 1 && last.height == 1) return texture;
  Result<Image> picture = decode_level(record, record.level_count, texture.blocks_.data() + texture.offsets_.back());
  if (!picture) return at("level " + std::to_string(record.level_count), picture.error());
  MipChain chain = make_mips(std::move(*picture), coding);
  // The picture itself is there as blocks.
  MipChain& made = texture.made_;
  const uint64_t before = chain.level_offset[1];
  made.level_count = chain.level_count - 1;
  for (uint32_t l = 0; l < made.level_count; ++l) made.level_offset[l] = chain.level_offset[l + 1] - before;
  made.texels.assign(chain.texels.begin() + static_cast<ptrdiff_t>(4 * before), chain.texels.end());
  return texture;
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
  view.block_format = record_.block_format;
  view.swizzle = record_.swizzle;
  if (made_.texels.empty()) view.texels = nullptr;
  return view;
}

}  // namespace scree::runtime
