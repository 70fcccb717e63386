#include "runtime/image.h"

#include <cassert>
#include <cstdio>
#include <new>
#include <string>

#include "runtime/image_codecs.h"
#include "runtime/part_file.h"

namespace scree::runtime {
namespace {

std::string size_text(const ImageInfo& info) {
  return std::to_string(info.width) + " x " + std::to_string(info.height) + " pixels";
}

}  // namespace

Result<ImageInfo> probe_image(std::span<const std::byte> file) {
  const auto byte = [&](size_t i) { return i < file.size() ? static_cast<unsigned>(file[i]) : 0u; };
  if (byte(0) == 0xff && byte(1) == 0xd8) return probe_jpeg(file);
  if (byte(0) == 0x89 && byte(1) == 'P' && byte(2) == 'N' && byte(3) == 'G') return probe_png(file);
  if (file.empty()) return Error{ErrorCode::kTruncated, "image is empty, expected PNG or JPEG"};
  char text[80];
  std::snprintf(text, sizeof text, "neither PNG nor JPEG: begins with %02x %02x %02x %02x", byte(0), byte(1), byte(2),
                byte(3));
  return Error{ErrorCode::kFormat, text};
}

Result<Image> decode_image(std::span<const std::byte> file) {
  const Result<ImageInfo> info = probe_image(file);
  if (!info) return info.error();
  if (info->width > kMaxDecodedSide || info->height > kMaxDecodedSide)
    return Error{ErrorCode::kRange, size_text(*info) + ", but at most " + std::to_string(kMaxDecodedSide) + " a side"};
  if (uint64_t{info->width} * info->height > kMaxImagePixels)
    return Error{ErrorCode::kRange, size_text(*info) + ", but at most " + std::to_string(kMaxImagePixels) + " in all"};
  try {
    return info->codec == format::ImageCodec::kPng ? decode_png(file, *info) : decode_jpeg(file, *info);
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::kMemory, size_text(*info) + ": out of memory"};
  }
}

Result<void> write_pfm(const std::string& path, uint32_t width, uint32_t height, std::span<const float> values) {
  assert(values.size() == uint64_t{width} * height);
  Result<PartFile> file = PartFile::create(path);
  if (!file) return file.error();
  const std::string head = "Pf\n" + std::to_string(width) + " " + std::to_string(height) + "\n-1.0\n";
  file->write(head.data(), head.size());
  for (uint64_t row = height; row-- > 0;) file->write(values.data() + row * width, sizeof(float) * width);
  return file->commit();
}

Result<void> write_visibility(const std::string& path, std::span<const uint64_t> samples) {
  Result<PartFile> file = PartFile::create(path);
  if (!file) return file.error();
  file->write(samples.data(), samples.size_bytes());
  return file->commit();
}

}  // namespace scree::runtime
