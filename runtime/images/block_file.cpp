#include "runtime/images/block_file.h"

#include <zlib.h>
#include <zstd.h>

#include <algorithm>
#include <cstring>
#include <memory>
#include <span>
#include <string>

#include "format/blocks/pixels.h"

namespace scree::runtime {
namespace {

/// Unpacks `packed` to `out`. Returns whether the result has exactly the size of `out`.
bool unpack(BlockFile::Packing packing, std::span<const std::byte> packed, std::span<std::byte> out) {
  if (packing == BlockFile::Packing::kZstd)
    return ZSTD_decompress(out.data(), out.size(), packed.data(), packed.size()) == out.size();
  uLongf size = out.size();
  uLong taken = packed.size();
  return uncompress2(reinterpret_cast<Bytef*>(out.data()), &size, reinterpret_cast<const Bytef*>(packed.data()),
                     &taken) == Z_OK &&
         size == out.size();
}

}  // namespace

bool is_block_file(ImageFile& file) {
  const auto starts = [&](const char* text) {
    for (uint64_t i = 0; i < 4; ++i)
      if (file.byte(i) != static_cast<unsigned char>(text[i])) return false;
    return true;
  };
  return starts("\xabKTX") || starts("DDS ");
}

Result<BlockFile> open_block_file(ImageFile& file) {
  Result<BlockFile> head = file.byte(0) == 'D' ? open_dds(file) : open_ktx2(file);
  if (file.error()) return *file.error();
  return head;
}

Result<std::vector<std::byte>> read_block_level(ImageFile& file, const BlockFile& head, uint32_t level) {
  const uint32_t width = std::max(1u, head.width >> level), height = std::max(1u, head.height >> level);
  const uint64_t pixels = uint64_t{width} * height;
  const uint64_t bytes = format::block_level_bytes(head.format, width, height);
  const BlockFile::Level& place = head.levels[level];
  const std::string name = std::string(head.kind) + ": level " + std::to_string(level);
  std::vector<std::byte> packed(place.bytes);
  if (auto read = file.copy(place.offset, packed); !read) return at(name, read.error());
  if (head.packing != BlockFile::Packing::kNone) {
    std::vector<std::byte> raw(head.is_widened ? 3 * pixels : bytes);
    if (!unpack(head.packing, packed, raw))
      return Error{ErrorCode::kFormat, name + ": its " + std::to_string(packed.size()) + " bytes are no " +
                                           (head.packing == BlockFile::Packing::kZstd ? "zstd" : "zlib") + " data of " +
                                           std::to_string(raw.size())};
    packed = std::move(raw);
  }
  if (!head.is_widened) return packed;
  std::vector<std::byte> wide(bytes);
  for (uint64_t i = 0; i < pixels; ++i) {
    std::memcpy(wide.data() + 4 * i, packed.data() + 3 * i, 3);
    wide[4 * i + 3] = std::byte{255};
  }
  return wide;
}

Image decode_block_level(format::BlockFormat format, uint16_t swizzle, uint32_t width, uint32_t height,
                         const std::byte* blocks) {
  Image image;
  image.width = width;
  image.height = height;
  image.rgba.resize(uint64_t{4} * width * height);
  uint8_t* out = image.rgba.data();
  for (uint32_t y = 0; y < height; ++y)
    for (uint32_t x = 0; x < width; ++x, out += 4) {
      const uint32_t rgba =
          format::block_image_pixel(format, swizzle, reinterpret_cast<const uint8_t*>(blocks), width, x, y);
      std::memcpy(out, &rgba, sizeof(rgba));
    }
  return image;
}

}  // namespace scree::runtime
