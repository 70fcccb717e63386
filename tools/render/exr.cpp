#include "tools/render/exr.h"

#include <algorithm>
#include <cmath>
#include <exception>
#include <new>
#include <optional>
#include <vector>

#include <ImfChannelList.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfIO.h>
#include <ImfOutputFile.h>
#include <half.h>

namespace scree::tools {
namespace {

/// A stream through which OpenEXR writes to a PartFile. OpenEXR reports errors by exceptions, so the Error itself is
/// kept in `error`.
class PartStream : public Imf::OStream {
 public:
  explicit PartStream(format::PartFile& file) : Imf::OStream(file.part_path().c_str()), file_(file) {}

  void write(const char* bytes, int count) override {
    const Result<void> done = file_.write_at(place_, std::as_bytes(std::span(bytes, static_cast<size_t>(count))));
    if (!done) {
      error = done.error();
      throw std::exception();
    }
    if (place_ < end_) table = std::min(table, place_);
    place_ += static_cast<uint64_t>(count);
    end_ = std::max(end_, place_);
  }
  uint64_t tellp() override { return place_; }
  void seekp(uint64_t place) override { place_ = place; }

  std::optional<Error> error;
  uint64_t table = UINT64_MAX;  // offset of the table of line offsets, the only bytes that are overwritten

 private:
  format::PartFile& file_;
  uint64_t place_ = 0;
  uint64_t end_ = 0;
};

/// The nearest half. A larger number becomes the largest half, because other programs spread an infinite pixel.
half half_of(float value) {
  constexpr auto kMost = static_cast<float>(HALF_MAX);
  return half(std::isfinite(value) ? std::clamp(value, -kMost, kMost) : value);
}

/// The part of write_exr() that may throw.
void write_channels(PartStream& stream, uint32_t width, uint32_t height, std::span<const ExrChannel> channels) {
  const uint64_t pixels = uint64_t{width} * height;
  Imf::Header header(static_cast<int>(width), static_cast<int>(height));
  header.compression() = Imf::ZIP_COMPRESSION;
  Imf::FrameBuffer buffer;
  std::vector<std::vector<half>> halves;
  for (const ExrChannel& channel : channels) {
    Imf::PixelType type = channel.type == ExrType::kUint ? Imf::UINT : Imf::FLOAT;
    const char* data = static_cast<const char*>(channel.data);
    size_t step = 4 * size_t{channel.stride};
    if (channel.type == ExrType::kHalf) {
      std::vector<half>& made = halves.emplace_back(pixels);
      const auto* const values = static_cast<const float*>(channel.data);
      for (uint64_t i = 0; i < pixels; ++i) made[i] = half_of(values[i * channel.stride]);
      type = Imf::HALF;
      data = reinterpret_cast<const char*>(made.data());
      step = sizeof(half);
    }
    header.channels().insert(channel.name, Imf::Channel(type));
    buffer.insert(channel.name, Imf::Slice(type, const_cast<char*>(data), step, step * width));
  }
  // Uses no threads of the library: they wait forever if memory runs out in one of them.
  Imf::OutputFile file(stream, header, 0);
  file.setFrameBuffer(buffer);
  file.writePixels(static_cast<int>(height));
}

/// Checks the table of line offsets. If memory runs out, OpenEXR may omit rows, or the table, without an error. The
/// table has 8 bytes per 16 rows; OpenEXR first writes zeros and overwrites them at the end.
Result<void> check_whole(const format::PartFile& file, uint64_t table, uint32_t height) {
  const Error missing{ErrorCode::kMemory, file.path() + ": no memory left to write all rows"};
  if (table == UINT64_MAX) return missing;
  for (uint64_t i = 0; i < (uint64_t{height} + 15) / 16; ++i) {
    uint64_t offset = 0;
    SCREE_TRY(file.read_at(table + 8 * i, std::as_writable_bytes(std::span(&offset, 1))));
    if (offset == 0) return missing;
  }
  return {};
}

}  // namespace

Result<void> check_exr_support() {
  return {};
}

Result<void> write_exr(const std::string& path, uint32_t width, uint32_t height, std::span<const ExrChannel> channels,
                       format::Existing existing) {
  format::PartFile file = SCREE_TRY(format::PartFile::create(path, format::PartFile::Content::kEmpty, existing));
  PartStream stream(file);
  try {
    write_channels(stream, width, height, channels);
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::kMemory, path + ": no memory left to write it"};
  } catch (const std::exception& error) {
    return stream.error ? *stream.error : Error{ErrorCode::kFile, path + ": " + error.what()};
  }
  if (stream.error) return *stream.error;
  SCREE_TRY(check_whole(file, stream.table, height));
  return file.commit();
}

}  // namespace scree::tools
