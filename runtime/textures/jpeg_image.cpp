#include "runtime/textures/jpeg_image.h"

#include <algorithm>
#include <string>
#include <utility>

#include "format/jpeg/picture.h"

namespace scree::runtime {

Result<format::JpegIndex> open_jpeg_level(std::span<const std::byte> bytes, uint32_t width, uint32_t height,
                                          uint32_t channels) {
  Result<format::JpegIndex> index = format::open_jpeg_index(bytes);
  if (!index) return index;
  if (index->width != width || index->height != height || index->component_count != channels) {
    const auto shape = [](uint32_t w, uint32_t h, uint32_t c) {
      return std::to_string(w) + " x " + std::to_string(h) + " x " + std::to_string(c);
    };
    return Error{ErrorCode::kRange, "indexed JPEG: is " + shape(index->width, index->height, index->component_count) +
                                        ", expected " + shape(width, height, channels)};
  }
  return index;
}

Result<Image> decode_jpeg_level(const format::JpegIndex& level) {
  const uint64_t pixels = uint64_t{level.width} * level.height;
  if (pixels > kMaxImagePixels) {
    return Error{ErrorCode::kRange,
                 std::to_string(pixels) + " pixels, but at most " + std::to_string(kMaxImagePixels) + " in all"};
  }
  Image image;
  image.width = level.width;
  image.height = level.height;
  image.rgba.resize(4 * pixels);
  uint8_t* out = image.rgba.data();
  const auto decoded = format::decode_jpeg_rows(level, [&](uint32_t, std::span<const uint8_t> rgb) {
    for (size_t i = 0; i < rgb.size(); i += 3, out += 4) {
      std::copy_n(rgb.data() + i, 3, out);
      out[3] = 255;
    }
  });
  if (!decoded) return decoded.error();
  return image;
}

Result<JpegImage> JpegImage::open(const format::Container& container, uint32_t image) {
  JpegImage opened;
  const format::ImageRecord& record = container.images()[image];
  const auto page_bytes = [&](uint32_t number) -> Result<std::span<const std::byte>> {
    const auto [entry, is_new] = opened.pages_.try_emplace(number);
    Page& page = entry->second;
    if (!is_new) return page.bytes;
    const auto loaded = container.load_page(number, page.unpacked);
    if (!loaded) return loaded;
    return page.bytes = *loaded;
  };
  for (uint32_t l = 0; l <= record.level_count; ++l) {
    const std::string place = "level " + std::to_string(l);
    auto bytes = page_bytes(l == 0 ? record.page : container.mip_levels()[record.first_level + l - 1].page);
    if (!bytes) return at(place, bytes.error());
    if (l != 0) {
      const format::MipLevelRecord& level = container.mip_levels()[record.first_level + l - 1];
      bytes = bytes->subspan(level.offset, level.bytes);
    }
    auto index =
        open_jpeg_level(*bytes, std::max(1u, record.width >> l), std::max(1u, record.height >> l), record.channels);
    if (!index) return at(place, index.error());
    opened.levels_.push_back(std::move(*index));
  }
  return opened;
}

Result<MipChain> JpegImage::decode_tail(TexelCoding coding) const {
  Result<Image> last = decode_jpeg_level(levels_.back());
  if (!last) return at("level " + std::to_string(levels_.size() - 1), last.error());
  return make_mips(std::move(*last), coding);
}

Result<MipChain> JpegImage::decode(TexelCoding coding) const {
  const Result<MipChain> tail = decode_tail(coding);
  if (!tail) return tail.error();
  MipChain chain;
  chain.width = levels_.front().width;
  chain.height = levels_.front().height;
  const auto stored = static_cast<uint32_t>(levels_.size()) - 1;  // levels before the tail
  for (uint32_t l = 0; l < stored; ++l) {
    const Result<Image> image = decode_jpeg_level(levels_[l]);
    if (!image) return at("level " + std::to_string(l), image.error());
    chain.level_offset[l] = chain.texels.size() / 4;
    chain.texels.insert(chain.texels.end(), image->rgba.begin(), image->rgba.end());
  }
  for (uint32_t l = 0; l < tail->level_count; ++l)
    chain.level_offset[stored + l] = chain.texels.size() / 4 + tail->level_offset[l];
  chain.level_count = stored + tail->level_count;
  chain.texels.insert(chain.texels.end(), tail->texels.begin(), tail->texels.end());
  return chain;
}

Result<JpegTexture> JpegTexture::make(JpegImage image, TexelCoding coding) {
  JpegTexture texture;
  texture.image_ = std::move(image);
  Result<MipChain> tail = texture.image_.decode_tail(coding);
  if (!tail) return tail.error();
  texture.tail_ = std::move(*tail);
  const std::vector<format::JpegIndex>& levels = texture.image_.levels();
  for (size_t l = 0; l + 1 < levels.size(); ++l) {
    texture.factors_.push_back(format::jpeg_factors(levels[l]));
    texture.levels_.push_back({format::jpeg_picture(levels[l], texture.factors_.back().data()), 0});
  }
  return texture;
}

void JpegTexture::number_levels(uint32_t& number, kernels::JpegGroups& groups) {
  for (kernels::JpegLevel& level : levels_) {
    const format::JpegPicture& picture = level.picture;
    level.number = number++;
    level.first_group = groups.count;
    groups.count += (picture.view.mcu_count - 1) / picture.view.group_mcus + 1;
    groups.pixels = std::max(groups.pixels, picture.mcu_width * picture.mcu_height * picture.view.group_mcus);
  }
}

kernels::TextureView JpegTexture::view(const format::TextureRecord& record) const {
  kernels::TextureView view = texture_view(tail_, record);
  const auto stored = static_cast<uint32_t>(levels_.size());
  // The tail's level l is level `stored` + l of the view.
  std::copy_backward(view.level_offset, view.level_offset + view.level_count,
                     view.level_offset + stored + view.level_count);
  view.level_count += stored;
  view.width = image_.levels().front().width;
  view.height = image_.levels().front().height;
  view.jpeg = levels_.data();
  view.jpeg_level_count = stored;
  return view;
}

std::span<const std::byte> JpegTexture::level_bytes(size_t level) const {
  const format::JpegIndex& from = index(level);
  return {from.data.data(), from.anchors.data() + from.anchors.size()};
}

uint64_t JpegTexture::jpeg_bytes() const {
  uint64_t bytes = 0;
  for (size_t l = 0; l < levels_.size(); ++l) {
    const format::JpegIndex& level = image_.levels()[l];
    bytes += level.data.size() + level.index_bytes() + level.tables.size() * sizeof(format::JpegHuffmanTable);
  }
  return bytes;
}

}  // namespace scree::runtime
