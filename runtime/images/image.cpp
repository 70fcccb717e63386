#include "runtime/images/image.h"

#include <algorithm>
#include <cassert>
#include <cstdio>
#include <cstring>
#include <new>
#include <string>
#include <string_view>
#include <utility>

#include "format/blocks/format.h"
#include "format/container/part_file.h"
#include "runtime/images/block_file.h"
#include "runtime/images/codecs.h"

namespace scree::runtime {
namespace {

constexpr uint64_t kWebpPixelBytes = 10;  // the picture, libwebp's copy, and its alpha

std::string size_text(const ImageInfo& info) {
  return std::to_string(info.width) + " x " + std::to_string(info.height) + " pixels";
}

Error out_of_memory(const ImageInfo& info) {
  return {ErrorCode::kMemory, size_text(info) + ": out of memory"};
}

Result<ImageInfo> probe_blocks(ImageFile& file) {
  const BlockFile head = SCREE_TRY(open_block_file(file));
  return ImageInfo{.codec = format::ImageCodec::kBlocks,
                   .width = head.width,
                   .height = head.height,
                   .channels = format::block_channels(head.format),
                   .block_bytes = format::block_level_bytes(head.format, head.width, head.height),
                   .is_decoded = head.coding == BlockFile::Coding::kUastc || head.coding == BlockFile::Coding::kBasisLz,
                   .codebook_bytes = head.basis_lz.memory()};
}

/// Decodes level 0 of a block image in bands.
Result<void> decode_block_rows(ImageFile& file, const std::function<bool(const Image&)>& take) {
  constexpr uint32_t kRows = 64;  // a multiple of every block's side
  BlockFile head = SCREE_TRY(open_block_file(file));
  const std::vector<std::byte> blocks = SCREE_TRY(read_block_level(file, head, 0));
  const std::byte* from = blocks.data();
  for (uint32_t y = 0; y < head.height; y += kRows) {
    const uint32_t rows = std::min(kRows, head.height - y);
    if (!take(decode_block_level(head.format, head.swizzle, head.width, rows, from))) break;
    from += format::block_level_bytes(head.format, head.width, rows);
  }
  return {};
}

Result<Image> decode_blocks(ImageFile& file) {
  BlockFile head = SCREE_TRY(open_block_file(file));
  const std::vector<std::byte> blocks = SCREE_TRY(read_block_level(file, head, 0));
  return decode_block_level(head.format, head.swizzle, head.width, head.height, blocks.data());
}

/// Unpacks every level, and decodes those of UASTC and BasisLZ. The content of blocks is never an error.
Result<std::string> check_blocks(ImageFile& file) {
  BlockFile head = SCREE_TRY(open_block_file(file));
  for (uint32_t level = 0; level < head.levels.size(); ++level) SCREE_TRY(read_block_level(file, head, level));
  return std::string();
}

bool is_webp_file(ImageFile& file) {
  constexpr std::string_view kSignature = "RIFF....WEBP";  // four bytes of size
  for (uint64_t i = 0; i < kSignature.size(); ++i)
    if (kSignature[i] != '.' && file.byte(i) != static_cast<unsigned char>(kSignature[i])) return false;
  return true;
}

Result<ImageInfo> probe_by_signature(ImageFile& file) {
  const auto byte = [&](uint64_t i) { return file.byte(i); };
  if (byte(0) == 0xff && byte(1) == 0xd8) return probe_jpeg(file);
  if (byte(0) == 0x89 && byte(1) == 'P' && byte(2) == 'N' && byte(3) == 'G') return probe_png(file);
  if (is_webp_file(file)) return probe_webp(file);
  if (is_block_file(file)) return probe_blocks(file);
  if (file.size() == 0) return Error{ErrorCode::kTruncated, "image is empty, expected PNG, JPEG, WebP, KTX2 or DDS"};
  char text[80];
  std::snprintf(text, sizeof text, "no PNG, JPEG, WebP, KTX2 or DDS: begins with %02x %02x %02x %02x", byte(0), byte(1),
                byte(2), byte(3));
  return Error{ErrorCode::kFormat, text};
}

Result<ImageInfo> probe(ImageFile& file) {
  Result<ImageInfo> info = probe_by_signature(file);
  if (file.error()) return *file.error();
  return info;
}

Result<ImageInfo> probe_within_limits(ImageFile& file) {
  ImageInfo info = SCREE_TRY(probe(file));
  if (info.width > kMaxDecodedSide || info.height > kMaxDecodedSide)
    return Error{ErrorCode::kRange, size_text(info) + ", but at most " + std::to_string(kMaxDecodedSide) + " per side"};
  if (uint64_t{info.width} * info.height > kMaxImagePixels)
    return Error{ErrorCode::kRange, size_text(info) + ", but at most " + std::to_string(kMaxImagePixels) + " in all"};
  if (!may_hold_pixels(uint64_t{info.width} * info.height, file.size()))
    return Error{ErrorCode::kTruncated, size_text(info) + " in " + std::to_string(file.size()) + " bytes"};
  return info;
}

}  // namespace

std::span<const std::byte> ImageFile::from(uint64_t offset) {
  if (offset >= size_ || error_) return {};
  if (read_ && (offset < first_ || offset - first_ >= window_.size())) {
    buffer_.resize(static_cast<size_t>(std::min(window_bytes_, size_ - offset)));
    window_ = buffer_;
    first_ = offset;
    if (const Result<void> read = read_(offset, buffer_); !read) {
      error_ = read.error();
      return {};
    }
  }
  return window_.subspan(static_cast<size_t>(offset - first_));
}

Result<void> ImageFile::copy(uint64_t offset, std::span<std::byte> out) {
  while (!out.empty()) {
    const std::span<const std::byte> bytes = from(offset);
    if (error_) return *error_;
    if (bytes.empty()) return Error{ErrorCode::kTruncated, "ends before its data do"};
    const size_t part = std::min(out.size(), bytes.size());
    std::memcpy(out.data(), bytes.data(), part);
    out = out.subspan(part);
    offset += part;
  }
  return {};
}

Result<ImageInfo> probe_image(ImageFile file) {
  return probe(file);
}

Result<ImageInfo> probe_decodable(ImageFile file) {
  return probe_within_limits(file);
}

Result<Image> decode_image(ImageFile file) {
  const ImageInfo info = SCREE_TRY(probe_within_limits(file));
  try {
    if (info.codec == format::ImageCodec::kBlocks) return decode_blocks(file);
    if (info.is_webp) return decode_webp(file, info);
    return info.codec == format::ImageCodec::kPng ? decode_png(file, info) : decode_jpeg(file, info);
  } catch (const std::bad_alloc&) {
    return out_of_memory(info);
  }
}

Result<ImageInfo> decode_rows(ImageFile file, const std::function<bool(const Image& rows)>& take) {
  const ImageInfo info = SCREE_TRY(probe_within_limits(file));
  if (info.codec != format::ImageCodec::kBlocks) {
    const Image image = SCREE_TRY(decode_image(std::move(file)));
    take(image);
    return info;
  }
  try {
    SCREE_TRY(decode_block_rows(file, take));
  } catch (const std::bad_alloc&) {
    return out_of_memory(info);
  }
  return info;
}

Result<std::string> check_image(ImageFile file) {
  const ImageInfo info = SCREE_TRY(probe_within_limits(file));
  try {
    if (info.codec == format::ImageCodec::kBlocks) return check_blocks(file);
    if (info.is_webp) {
      SCREE_TRY(decode_webp(file, info));
      return std::string();
    }
    return info.codec == format::ImageCodec::kPng ? check_png(file, info) : check_jpeg(file, info);
  } catch (const std::bad_alloc&) {
    return out_of_memory(info);
  }
}

uint64_t image_check_bytes(const ImageInfo& info, uint64_t file_bytes) {
  if (info.is_webp) return file_bytes + kWebpPixelBytes * info.width * info.height;
  if (info.codec == format::ImageCodec::kBlocks)
    return ImageFile::kWindowBytes + 2 * info.block_bytes + info.codebook_bytes;
  // A row of blocks takes 16 bytes per sample. Up to 12 block rows are held, and as many rows of samples and of pixels.
  const uint64_t rows = uint64_t{256} * info.width * info.channels;
  if (info.codec == format::ImageCodec::kPng) return ImageFile::kWindowBytes + rows / 8;
  return ImageFile::kWindowBytes + rows + uint64_t{info.width + 32} * (info.height + 32) * info.channels / 8;
}

Result<void> write_pfm(const std::string& path, uint32_t width, uint32_t height, std::span<const float> values,
                       format::Existing existing) {
  const uint64_t pixels = uint64_t{width} * height;
  assert(values.size() == pixels || values.size() == 3 * pixels);
  const bool is_grey = values.size() == pixels;
  const uint64_t in_row = is_grey ? width : uint64_t{3} * width;
  const std::string head =
      (is_grey ? "Pf\n" : "PF\n") + std::to_string(width) + " " + std::to_string(height) + "\n-1.0\n";
  format::PartFile file = SCREE_TRY(format::PartFile::create(path, format::PartFile::Content::kEmpty, existing));
  Result<void> done = file.write_at(0, std::as_bytes(std::span(head)));
  uint64_t end = head.size();
  for (uint64_t row = height; row-- > 0 && done; end += sizeof(float) * in_row) {
    done = file.write_at(end, std::as_bytes(values.subspan(row * in_row, in_row)));
  }
  if (done) done = file.commit();
  return done;
}

Result<void> write_visibility(const std::string& path, std::span<const uint64_t> samples, format::Existing existing) {
  format::PartFile file = SCREE_TRY(format::PartFile::create(path, format::PartFile::Content::kEmpty, existing));
  SCREE_TRY(file.write_at(0, std::as_bytes(samples)));
  return file.commit();
}

}  // namespace scree::runtime
