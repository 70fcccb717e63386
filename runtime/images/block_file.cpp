#include "runtime/images/block_file.h"

#include <zlib.h>
#include <zstd.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <memory>
#include <span>
#include <string>

#include "format/blocks/bc7_block.h"
#include "format/blocks/pixels.h"
#include "runtime/images/basis/uastc.h"

namespace scree::runtime {
namespace {

/// Unpacks `packed` to `out`. Returns whether the result has exactly the size of `out`.
bool unpack(BlockFile::Packing packing, std::span<const std::byte> packed, std::span<std::byte> out) {
  if (packing == BlockFile::Packing::kZstd) {
    struct Free {
      void operator()(ZSTD_DCtx* context) const { ZSTD_freeDCtx(context); }
    };
    // A context takes 160 KB. It is kept per thread, because many levels are smaller than that.
    thread_local std::unique_ptr<ZSTD_DCtx, Free> context;
    if (!context) context.reset(ZSTD_createDCtx());
    return context &&
           ZSTD_decompressDCtx(context.get(), out.data(), out.size(), packed.data(), packed.size()) == out.size();
  }
  uLongf size = out.size();
  uLong taken = packed.size();
  return uncompress2(reinterpret_cast<Bytef*>(out.data()), &size, reinterpret_cast<const Bytef*>(packed.data()),
                     &taken) == Z_OK &&
         size == out.size();
}

std::vector<std::byte> widen(std::span<const std::byte> rgb, uint64_t pixels) {
  std::vector<std::byte> wide(4 * pixels);
  for (uint64_t i = 0; i < pixels; ++i) {
    std::memcpy(wide.data() + 4 * i, rgb.data() + 3 * i, 3);
    wide[4 * i + 3] = std::byte{255};
  }
  return wide;
}

std::vector<std::byte> decode_uastc(const std::byte* blocks, uint32_t width, uint32_t height) {
  std::vector<std::byte> pixels(uint64_t{4} * width * height);
  for (uint32_t y = 0; y < height; y += 4)
    for (uint32_t x = 0; x < width; x += 4, blocks += kUastcBlockBytes) {
      std::array<uint32_t, 16> texels;
      decode_uastc_block(blocks, texels);
      for (uint32_t j = 0; j < std::min(4u, height - y); ++j)
        std::memcpy(pixels.data() + 4 * (uint64_t{width} * (y + j) + x), texels.data() + 4 * j,
                    4 * std::min(4u, width - x));
    }
  return pixels;
}

/// Decodes a level of a BasisLZ file. The first one decodes the codebooks too, which all share.
Result<std::vector<std::byte>> decode_basis_lz(ImageFile& file, BlockFile& head, const BlockFile::Level& level,
                                               uint32_t width, uint32_t height) {
  std::vector<std::byte> bytes;
  const auto read = [&](uint64_t offset, uint64_t size) {
    bytes.resize(size);
    return file.copy(offset, bytes);
  };
  if (!head.codebooks) {
    const BasisLzHead& parts = head.basis_lz;
    SCREE_TRY(read(head.basis_lz_offset, parts.part_bytes()));
    auto opened = SCREE_TRY(BasisLz::open(parts, bytes));
    head.codebooks = std::make_shared<const BasisLz>(std::move(opened));
  }
  std::vector<std::byte> pixels(uint64_t{4} * width * height);
  for (const bool is_alpha : {false, true}) {
    const uint64_t size = is_alpha ? level.alpha_bytes : level.bytes;
    if (size == 0) continue;
    SCREE_TRY(read(is_alpha ? level.alpha_offset : level.offset, size));
    SCREE_TRY(head.codebooks->decode(bytes, is_alpha, width, height, pixels));
  }
  return pixels;
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

uint64_t BlockFile::unpacked_bytes(uint32_t level_width, uint32_t level_height) const {
  if (coding == Coding::kRgb8) return uint64_t{3} * level_width * level_height;
  return format::block_level_bytes(coding == Coding::kUastc ? format::BlockFormat::kBc7 : format, level_width,
                                   level_height);  // UASTC's blocks have the size of those of BC7
}

Result<std::vector<std::byte>> read_block_level(ImageFile& file, BlockFile& head, uint32_t level) {
  const uint32_t width = std::max(1u, head.width >> level), height = std::max(1u, head.height >> level);
  const BlockFile::Level& place = head.levels[level];
  const std::string name = std::string(head.kind) + ": level " + std::to_string(level);
  if (head.coding == BlockFile::Coding::kBasisLz) {
    auto pixels = decode_basis_lz(file, head, place, width, height);
    return pixels ? std::move(pixels) : at(name, pixels.error());
  }
  std::vector<std::byte> raw;
  std::span<const std::byte> packed = file.from(place.offset);
  if (packed.size() >= place.bytes && head.packing != BlockFile::Packing::kNone) {
    packed = packed.first(place.bytes);  // in memory, as usual
  } else {
    raw.resize(place.bytes);
    SCREE_TRY_AT(name, file.copy(place.offset, raw));
    packed = raw;
  }
  if (head.packing != BlockFile::Packing::kNone) {
    std::vector<std::byte> unpacked(head.unpacked_bytes(width, height));
    if (!unpack(head.packing, packed, unpacked))
      return Error{ErrorCode::kFormat, name + ": its " + std::to_string(packed.size()) + " bytes are no " +
                                           (head.packing == BlockFile::Packing::kZstd ? "zstd" : "zlib") + " data of " +
                                           std::to_string(unpacked.size())};
    raw = std::move(unpacked);
  }
  if (head.coding == BlockFile::Coding::kRgb8) return widen(raw, uint64_t{width} * height);
  if (head.coding == BlockFile::Coding::kUastc) return decode_uastc(raw.data(), width, height);
  return raw;
}

Image decode_block_level(format::BlockFormat format, uint16_t swizzle, uint32_t width, uint32_t height,
                         const std::byte* blocks) {
  Image image{.width = width, .height = height};
  image.rgba.resize(uint64_t{4} * width * height);
  const auto put = [&](uint32_t x, uint32_t y, uint32_t rgba) {
    std::memcpy(image.rgba.data() + 4 * (uint64_t{y} * width + x), &rgba, sizeof(rgba));
  };
  const auto* const bytes = reinterpret_cast<const uint8_t*>(blocks);
  if (format == format::BlockFormat::kBc7) {
    std::array<uint32_t, 16> pixels;
    const uint8_t* block = bytes;
    for (uint32_t top = 0; top < height; top += 4)
      for (uint32_t left = 0; left < width; left += 4, block += 16) {
        format::bc7_pixels({format::load_eight(block), format::load_eight(block + 8)}, pixels.data());
        for (uint32_t y = top; y < std::min(top + 4, height); ++y)
          for (uint32_t x = left; x < std::min(left + 4, width); ++x)
            put(x, y, format::swizzled(pixels[(y & 3) * 4 + (x & 3)], swizzle));
      }
    return image;
  }
  for (uint32_t y = 0; y < height; ++y)
    for (uint32_t x = 0; x < width; ++x) put(x, y, format::block_image_pixel(format, swizzle, bytes, width, x, y));
  return image;
}

}  // namespace scree::runtime
