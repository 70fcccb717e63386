#include "runtime/textures/jpeg_image.h"

#include <algorithm>
#include <cstring>
#include <string>
#include <utility>

#include "format/bytes.h"
#include "format/jpeg/picture.h"
#include "runtime/textures/block_image.h"
#include "runtime/textures/block_pager.h"

namespace scree::runtime {
namespace {

constexpr uint64_t kHeadAlignment = 16;

/// The place of a stored level: its page, and its bytes there.
struct Place {
  uint32_t page;
  uint64_t offset;
  uint64_t bytes;
};

Place place_of(const format::Container& container, uint32_t image, uint32_t level) {
  const format::ImageRecord& record = container.images()[image];
  if (level == 0) return {record.page, 0, container.pages()[record.page].raw_bytes};
  const format::MipLevelRecord& stored = container.mip_levels()[record.first_level + level - 1];
  return {stored.page, stored.offset, stored.bytes};
}

/// Opens a stored level out of its page's raw bytes.
Result<format::JpegIndex> open_level(const format::Container& container, uint32_t image, uint32_t level,
                                     std::span<const std::byte> raw) {
  const format::ImageRecord& record = container.images()[image];
  const Place place = place_of(container, image, level);
  return open_jpeg_level(raw.subspan(place.offset, place.bytes), std::max(1u, record.width >> level),
                         std::max(1u, record.height >> level), record.channels);
}

/// The number of levels that stay in the file. The last stored level never does.
uint32_t paged_levels_of(const format::Container& container, uint32_t image, bool paged) {
  const uint32_t last = container.images()[image].level_count;
  uint32_t count = 0;
  while (paged && count < last &&
         container.pages()[place_of(container, image, count).page].raw_bytes > kLeastPagedBytes)
    ++count;
  return count;
}

// The tables of a level: at most one of each kind per component.
constexpr uint32_t kFactorBytes = 64 * sizeof(uint32_t);
constexpr uint64_t kPictureBytes = format::align_up(sizeof(format::JpegPicture), kHeadAlignment);

uint64_t head_bytes(uint32_t channels) {
  const uint64_t tables = channels * (kFactorBytes + 2 * sizeof(format::JpegHuffmanTable));
  return format::align_up(kPictureBytes + tables, kHeadAlignment);
}

}  // namespace

Result<format::JpegIndex> open_jpeg_level(std::span<const std::byte> bytes, uint32_t width, uint32_t height,
                                          uint32_t channels) {
  format::JpegIndex index = SCREE_TRY(format::open_jpeg_index(bytes));
  if (index.width != width || index.height != height || index.component_count != channels) {
    const auto shape = [](uint32_t w, uint32_t h, uint32_t c) {
      return std::to_string(w) + " x " + std::to_string(h) + " x " + std::to_string(c);
    };
    return Error{ErrorCode::kRange, "indexed JPEG: is " + shape(index.width, index.height, index.component_count) +
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
  Image image{.width = level.width, .height = level.height};
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

Result<JpegImage> JpegImage::open(const format::Container& container, uint32_t image, uint32_t first) {
  JpegImage opened;
  const format::ImageRecord& record = container.images()[image];
  const auto page_bytes = [&](uint32_t number) -> Result<std::span<const std::byte>> {
    const auto [entry, is_new] = opened.pages_.try_emplace(number);
    Page& page = entry->second;
    if (!is_new) return page.bytes;
    const auto loaded = SCREE_TRY(container.load_page(number, page.unpacked));
    return page.bytes = loaded;
  };
  for (uint32_t l = first; l <= record.level_count; ++l) {
    const std::string place = "level " + std::to_string(l);
    const auto bytes = SCREE_TRY_AT(place, page_bytes(place_of(container, image, l).page));
    auto index = SCREE_TRY_AT(place, open_level(container, image, l, bytes));
    opened.levels_.push_back(std::move(index));
  }
  opened.first_ = first;
  return opened;
}

Result<MipChain> JpegImage::decode_tail(TexelCoding coding) const {
  Image last = SCREE_TRY_AT("level " + std::to_string(first_ + levels_.size() - 1), decode_jpeg_level(levels_.back()));
  return make_mips(std::move(last), coding);
}

Result<MipChain> JpegImage::decode(TexelCoding coding) const {
  const MipChain tail = SCREE_TRY(decode_tail(coding));
  MipChain chain{.width = levels_.front().width, .height = levels_.front().height};
  const auto stored = static_cast<uint32_t>(levels_.size()) - 1;  // levels before the tail
  for (uint32_t l = 0; l < stored; ++l) {
    const Image image = SCREE_TRY_AT("level " + std::to_string(l), decode_jpeg_level(levels_[l]));
    chain.level_offset[l] = chain.texels.size() / 4;
    chain.texels.insert(chain.texels.end(), image.rgba.begin(), image.rgba.end());
  }
  for (uint32_t l = 0; l < tail.level_count; ++l)
    chain.level_offset[stored + l] = chain.texels.size() / 4 + tail.level_offset[l];
  chain.level_count = stored + tail.level_count;
  chain.texels.insert(chain.texels.end(), tail.texels.begin(), tail.texels.end());
  return chain;
}

Result<JpegTexture> JpegTexture::load(const format::Container& container, uint32_t image, TexelCoding coding,
                                      bool paged) {
  JpegTexture texture;
  texture.width_ = container.images()[image].width;
  texture.height_ = container.images()[image].height;
  const uint32_t first = texture.paged_levels_ = paged_levels_of(container, image, paged);
  texture.image_ = SCREE_TRY(JpegImage::open(container, image, first));
  texture.tail_ = SCREE_TRY(texture.image_.decode_tail(coding));
  const std::vector<format::JpegIndex>& levels = texture.image_.levels();
  texture.levels_.resize(first);
  for (size_t l = 0; l + 1 < levels.size(); ++l) {
    texture.factors_.push_back(format::jpeg_factors(levels[l]));
    texture.levels_.push_back({format::jpeg_picture(levels[l], texture.factors_.back().data()), 0});
  }
  return texture;
}

void JpegTexture::add_ranges(const format::Container& container, uint32_t image, bool paged, ReadAhead& ahead) {
  uint32_t last = format::kNone;
  const uint32_t count = container.images()[image].level_count;
  for (uint32_t level = paged_levels_of(container, image, paged); level <= count; ++level) {
    const uint32_t page = place_of(container, image, level).page;
    if (page != last) ahead.add(container.pages()[page].offset, container.pages()[page].stored_bytes);
    last = page;
  }
}

void JpegTexture::add_pages(const format::Container& container, uint32_t image, HostBlockPager& pager) {
  const uint32_t channels = container.images()[image].channels;
  for (uint32_t first = 0; first < paged_levels_;) {
    const uint32_t page = place_of(container, image, first).page;
    uint32_t last = first;
    while (last < paged_levels_ && place_of(container, image, last).page == page) ++last;
    for (uint32_t level = first; level < last; ++level) {
      levels_[level].page = static_cast<uint32_t>(pager.size());
      levels_[level].place = jpeg_head_place(container.pages()[page].raw_bytes, channels, level - first);
    }
    pager.add(page, {image, first, last - first});
    first = last;
  }
}

format::JpegPicture JpegTexture::picture_of(size_t level) const {
  return level < paged_levels_ ? format::jpeg_picture(image_.levels().back(), nullptr) : levels_[level].picture;
}

uint32_t JpegTexture::group_bytes() const {
  uint32_t bytes = 0;
  for (size_t l = 0; l < levels_.size(); ++l) bytes = std::max(bytes, format::jpeg_group_bytes(picture_of(l)));
  return bytes;
}

void JpegTexture::number_levels(uint32_t& number, kernels::JpegGroups& groups) {
  for (uint32_t l = 0; l < levels_.size(); ++l) {
    const format::JpegPicture picture = picture_of(l);
    const uint32_t across = (std::max(1u, width_ >> l) - 1) / picture.mcu_width + 1;
    const uint32_t down = (std::max(1u, height_ >> l) - 1) / picture.mcu_height + 1;
    levels_[l].number = number++;
    levels_[l].first_group = groups.count;
    levels_[l].group_count = (across * down - 1) / picture.view.group_mcus + 1;
    groups.count += levels_[l].group_count;
    groups.pixels = std::max(groups.pixels, format::jpeg_group_pixels(picture));
  }
}

kernels::TextureView JpegTexture::view(const format::TextureRecord& record) const {
  kernels::TextureView view = texture_view(tail_, record);
  const auto stored = static_cast<uint32_t>(levels_.size());
  // The tail's level l is level `stored` + l of the view.
  std::copy_backward(view.level_offset, view.level_offset + view.level_count,
                     view.level_offset + stored + view.level_count);
  for (uint32_t l = 0; l < stored; ++l) view.level_offset[l] = levels_[l].first_group;
  view.level_count += stored;
  view.width = width_;
  view.height = height_;
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
  for (size_t l = paged_levels_; l < levels_.size(); ++l) {
    const format::JpegIndex& level = index(l);
    bytes += level.data.size() + level.index_bytes() + level.tables.size() * sizeof(format::JpegHuffmanTable);
  }
  return bytes;
}

uint64_t jpeg_head_place(uint64_t raw_bytes, uint32_t channels, uint32_t place) {
  return format::align_up(raw_bytes, kHeadAlignment) + place * head_bytes(channels);
}

Result<void> write_jpeg_heads(const format::Container& container, const JpegLevels& levels, std::byte* memory,
                              uint64_t raw_bytes, const std::byte* address) {
  const uint32_t channels = container.images()[levels.image].channels;
  const auto moved = [&](const void* part) { return address + (static_cast<const std::byte*>(part) - memory); };
  for (uint32_t i = 0; i < levels.count; ++i) {
    const auto index =
        SCREE_TRY_AT("image " + std::to_string(levels.image) + ": level " + std::to_string(levels.first + i),
                     open_level(container, levels.image, levels.first + i, {memory, raw_bytes}));
    std::byte* const head = memory + jpeg_head_place(raw_bytes, channels, i);
    std::byte* const factors = head + kPictureBytes;
    std::byte* const tables = factors + channels * kFactorBytes;
    const std::vector<uint32_t> made = format::jpeg_factors(index);
    format::JpegPicture picture = format::jpeg_picture(index, reinterpret_cast<const uint32_t*>(moved(factors)));
    move_jpeg_view(picture.view, moved(picture.view.data));
    picture.view.tables = reinterpret_cast<const format::JpegHuffmanTable*>(moved(tables));
    std::memcpy(head, &picture, sizeof picture);
    std::memcpy(factors, made.data(), made.size() * sizeof made[0]);
    std::memcpy(tables, index.tables.data(), index.tables.size() * sizeof index.tables[0]);
  }
  return {};
}

void move_jpeg_view(format::JpegView& view, const std::byte* data) {
  const auto* const from = static_cast<const std::byte*>(view.data);
  view.blocks = data + (static_cast<const std::byte*>(view.blocks) - from);
  view.anchors = data + (static_cast<const std::byte*>(view.anchors) - from);
  view.data = data;
}

}  // namespace scree::runtime
