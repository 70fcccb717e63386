#include <algorithm>
#include <array>
#include <optional>
#include <string>

#include "format/blocks/format.h"
#include "format/bytes.h"
#include "runtime/images/block_file.h"
#include "runtime/images/block_head.h"

namespace scree::runtime {
namespace dds {
namespace {

using format::BlockFormat;
using format::ChannelSource;

constexpr uint64_t kHeaderBytes = 128;  // including the four of "DDS "
constexpr uint64_t kDx10Bytes = 20;
constexpr uint32_t kHasLevels = 0x20000;
constexpr uint32_t kIsCube = 0x200, kIsVolume = 0x200000;
constexpr uint32_t kHasAlpha = 1, kIsAlpha = 2, kHasFourCc = 4, kIsRgb = 0x40, kIsLuminance = 0x20000;

constexpr uint16_t kReversedOpaque =
    format::make_swizzle(ChannelSource::kBlue, ChannelSource::kGreen, ChannelSource::kRed, ChannelSource::kOne);
constexpr uint16_t kGrey =
    format::make_swizzle(ChannelSource::kRed, ChannelSource::kRed, ChannelSource::kRed, ChannelSource::kOne);
constexpr uint16_t kGreyAlpha =
    format::make_swizzle(ChannelSource::kRed, ChannelSource::kRed, ChannelSource::kRed, ChannelSource::kGreen);

struct Format {
  BlockFormat format;
  uint16_t swizzle;
  bool is_widened = false;
};

constexpr uint32_t four_cc(const char (&text)[5]) {
  uint32_t code = 0;
  for (uint32_t i = 0; i < 4; ++i) code |= uint32_t{static_cast<unsigned char>(text[i])} << 8 * i;
  return code;
}

std::optional<Format> by_four_cc(uint32_t code) {
  if (code == four_cc("DXT1")) return Format{BlockFormat::kBc1, format::kPlainSwizzle};
  if (code == four_cc("DXT3")) return Format{BlockFormat::kBc2, format::kPlainSwizzle};
  if (code == four_cc("DXT5")) return Format{BlockFormat::kBc3, format::kPlainSwizzle};
  if (code == four_cc("ATI1") || code == four_cc("BC4U")) return Format{BlockFormat::kBc4, format::kPlainSwizzle};
  if (code == four_cc("ATI2") || code == four_cc("BC5U")) return Format{BlockFormat::kBc5, format::kPlainSwizzle};
  return std::nullopt;
}

std::optional<Format> by_dxgi(uint32_t number) {
  struct Known {
    uint32_t linear, srgb;  // numbers of the format
    Format format;
  };
  constexpr Known kKnown[] = {
      {28, 29, {BlockFormat::kRgba8, format::kPlainSwizzle}}, {49, 49, {BlockFormat::kRg8, format::kPlainSwizzle}},
      {61, 61, {BlockFormat::kR8, format::kPlainSwizzle}},    {71, 72, {BlockFormat::kBc1, format::kPlainSwizzle}},
      {74, 75, {BlockFormat::kBc2, format::kPlainSwizzle}},   {77, 78, {BlockFormat::kBc3, format::kPlainSwizzle}},
      {80, 80, {BlockFormat::kBc4, format::kPlainSwizzle}},   {83, 83, {BlockFormat::kBc5, format::kPlainSwizzle}},
      {87, 91, {BlockFormat::kRgba8, kReversedSwizzle}},      {88, 93, {BlockFormat::kRgba8, kReversedOpaque}},
      {98, 99, {BlockFormat::kBc7, format::kPlainSwizzle}}};
  for (const Known& known : kKnown)
    if (number == known.linear || number == known.srgb) return known.format;
  return std::nullopt;
}

/// Formats with whole bytes per channel. `masks`: the bit masks of red, green, blue and alpha.
std::optional<Format> by_masks(uint32_t flags, uint32_t bits, const std::array<uint32_t, 4>& masks) {
  const bool has_alpha = (flags & kHasAlpha) != 0;
  const auto is = [&](uint32_t red, uint32_t green, uint32_t blue) {
    return masks[0] == red && masks[1] == green && masks[2] == blue;
  };
  if ((flags & kIsLuminance) != 0) {
    if (bits == 8 && !has_alpha) return Format{BlockFormat::kR8, kGrey};
    if (bits == 16 && has_alpha && masks[0] == 0xff) return Format{BlockFormat::kRg8, kGreyAlpha};
    return std::nullopt;
  }
  if ((flags & kIsRgb) == 0 || (has_alpha && masks[3] != 0xff000000u)) return std::nullopt;
  const bool is_forward = is(0xff, 0xff00, 0xff0000), is_reversed = is(0xff0000, 0xff00, 0xff);
  if (bits == 32 && is_forward)
    return Format{BlockFormat::kRgba8, has_alpha ? format::kPlainSwizzle : format::kOpaqueSwizzle};
  if (bits == 32 && is_reversed) return Format{BlockFormat::kRgba8, has_alpha ? kReversedSwizzle : kReversedOpaque};
  if (bits == 24 && is_forward && !has_alpha) return Format{BlockFormat::kRgba8, format::kPlainSwizzle, true};
  if (bits == 24 && is_reversed && !has_alpha) return Format{BlockFormat::kRgba8, kReversedSwizzle, true};
  if (bits == 16 && is(0xff, 0xff00, 0) && !has_alpha) return Format{BlockFormat::kRg8, format::kPlainSwizzle};
  if (bits == 8 && is(0xff, 0, 0) && !has_alpha) return Format{BlockFormat::kR8, format::kPlainSwizzle};
  return std::nullopt;
}

constexpr BlockHeadErrors kErrors{"DDS", "expected BC1 to BC5, BC7 or 8 bits per channel: convert it first"};

}  // namespace
}  // namespace dds

Result<BlockFile> open_dds(ImageFile& file) {
  using namespace dds;
  const auto word = [&](uint64_t offset) { return word_of(file, offset); };
  const auto fail = [](ErrorCode code, const std::string& what) { return kErrors.fail(code, what); };
  const auto not_read = [](const std::string& what) { return kErrors.not_read(what); };
  if (file.size() < kHeaderBytes)
    return fail(ErrorCode::kTruncated, std::to_string(file.size()) + " bytes, but its header takes 128");
  if (word(4) != 124 || word(76) != 32) return fail(ErrorCode::kFormat, "its header's sizes are not 124 and 32");
  BlockFile head;
  head.kind = kErrors.kind;
  head.height = word(12);
  head.width = word(16);
  if ((word(112) & kIsCube) != 0) return fail(ErrorCode::kUnsupported, "a cube map, but glTF has single pictures");
  if ((word(112) & kIsVolume) != 0)
    return fail(ErrorCode::kUnsupported, "a picture of three dimensions, but glTF has two");

  const uint32_t flags = word(80), code = word(84);
  uint64_t data = kHeaderBytes;
  std::optional<Format> format;
  if ((flags & kHasFourCc) != 0 && code == four_cc("DX10")) {
    data += kDx10Bytes;
    if (file.size() < data) return fail(ErrorCode::kTruncated, "ends in its header");
    const uint32_t number = word(128), dimension = word(132), is_cube = word(136) & 4, count = word(140);
    if (dimension != 3 || is_cube != 0 || count > 1)
      return fail(ErrorCode::kUnsupported, is_cube != 0     ? "a cube map, but glTF has single pictures"
                                           : dimension != 3 ? "a picture of one or three dimensions, but glTF has two"
                                                            : "an array of " + std::to_string(count) +
                                                                  " pictures, but glTF has single pictures");
    format = by_dxgi(number);
    if (!format) return not_read("of DXGI format " + std::to_string(number));
  } else if ((flags & kHasFourCc) != 0) {
    format = by_four_cc(code);
    std::string text;
    for (uint32_t i = 0; i < 4; ++i) {
      const char c = static_cast<char>(code >> 8 * i & 255);
      text += c >= ' ' && c <= '~' ? c : '?';
    }
    if (!format) return not_read("of format \"" + text + "\"");
  } else {
    format = by_masks(flags, word(88), {word(92), word(96), word(100), word(104)});
    if (!format) return not_read("of " + std::to_string(word(88)) + " bits per pixel in another order");
  }
  head.format = format->format;
  head.swizzle = format->swizzle;
  if (format->is_widened) head.coding = BlockFile::Coding::kRgb8;

  if (head.width == 0 || head.height == 0) return fail(ErrorCode::kFormat, "a side of 0 pixels");
  const std::string size = std::to_string(head.width) + " x " + std::to_string(head.height) + " pixels";
  if (head.width > format::kMaxBlockImageSide || head.height > format::kMaxBlockImageSide)
    return fail(ErrorCode::kRange, size + ", but at most " + std::to_string(format::kMaxBlockImageSide) + " per side");
  const uint32_t stated = (word(8) & kHasLevels) != 0 ? word(28) : 0;
  const uint32_t most = format::most_block_levels(head.width, head.height) + 1;
  if (stated > most)
    return fail(ErrorCode::kRange,
                std::to_string(stated) + " levels, but a picture of " + size + " has at most " + std::to_string(most));
  for (uint32_t l = 0; l < std::max(1u, stated); ++l) {
    const uint32_t width = std::max(1u, head.width >> l), height = std::max(1u, head.height >> l);
    const uint64_t bytes = head.unpacked_bytes(width, height);
    if (!format::range_within(data, bytes, file.size()))
      return fail(ErrorCode::kTruncated, "level " + std::to_string(l) + " ends at byte " +
                                             std::to_string(data + bytes) + " of a file of " +
                                             std::to_string(file.size()));
    head.levels.push_back({data, bytes});
    data += bytes;
  }
  return head;
}

}  // namespace scree::runtime
