#include <algorithm>
#include <array>
#include <span>
#include <string>
#include <string_view>

#include "format/blocks/format.h"
#include "format/bytes.h"
#include "runtime/images/block_file.h"
#include "runtime/images/block_head.h"

namespace scree::runtime {
namespace ktx2 {
namespace {

using format::BlockFormat;

constexpr uint64_t kHeaderBytes = 80;
constexpr uint64_t kLevelBytes = 24;
constexpr std::array<unsigned char, 12> kIdentifier = {0xab, 'K',  'T',  'X',  ' ',  '2',
                                                       '0',  0xbb, '\r', '\n', 0x1a, '\n'};
constexpr uint32_t kBasisLzScheme = 1;
constexpr uint32_t kMaxKeyValueBytes = 1 << 20;  // only two keys are used

/// Colour models of the data format descriptor.
enum Model : uint32_t {
  kRgb = 1,
  kBc1Model = 128,
  kBc2Model = 129,
  kBc3Model = 130,
  kBc4Model = 131,
  kBc5Model = 132,
  kBc7Model = 134,
  kEtc1s = 163,
  kUastc = 166,
};

struct Format {
  uint32_t number;  // VkFormat, for UNORM and SRGB
  uint32_t srgb_number;
  BlockFormat format;
  uint16_t swizzle;
  Model model;
  BlockFile::Coding coding = BlockFile::Coding::kBlocks;
};

constexpr Format kFormats[] = {
    {9, 15, BlockFormat::kR8, format::kPlainSwizzle, kRgb},
    {16, 22, BlockFormat::kRg8, format::kPlainSwizzle, kRgb},
    {23, 29, BlockFormat::kRgba8, format::kPlainSwizzle, kRgb, BlockFile::Coding::kRgb8},
    {30, 36, BlockFormat::kRgba8, kReversedSwizzle, kRgb, BlockFile::Coding::kRgb8},
    {37, 43, BlockFormat::kRgba8, format::kPlainSwizzle, kRgb},
    {44, 50, BlockFormat::kRgba8, kReversedSwizzle, kRgb},
    {131, 132, BlockFormat::kBc1, format::kOpaqueSwizzle, kBc1Model},
    {133, 134, BlockFormat::kBc1, format::kPlainSwizzle, kBc1Model},
    {135, 136, BlockFormat::kBc2, format::kPlainSwizzle, kBc2Model},
    {137, 138, BlockFormat::kBc3, format::kPlainSwizzle, kBc3Model},
    {139, 139, BlockFormat::kBc4, format::kPlainSwizzle, kBc4Model},
    {141, 141, BlockFormat::kBc5, format::kPlainSwizzle, kBc5Model},
    {145, 146, BlockFormat::kBc7, format::kPlainSwizzle, kBc7Model},
};

/// The formats without a VkFormat. Their samples give the swizzle.
constexpr Format kUastcFormat{0, 0, BlockFormat::kRgba8, 0, kUastc, BlockFile::Coding::kUastc};
constexpr Format kEtc1sFormat{0, 0, BlockFormat::kRgba8, 0, kEtc1s, BlockFile::Coding::kBasisLz};

struct ChannelsSwizzle {
  uint32_t first;  // channel of the first sample
  uint32_t second;
  uint16_t swizzle;  // of the decoded RGBA
};
constexpr uint32_t kNoSample = 16;
constexpr uint16_t red_and(format::ChannelSource green) {
  using enum format::ChannelSource;
  return format::make_swizzle(kRed, green, kZero, kOne);
}
constexpr ChannelsSwizzle kUastcChannels[] = {{0, kNoSample, format::kOpaqueSwizzle},                   // RGB
                                              {3, kNoSample, format::kPlainSwizzle},                    // RGBA
                                              {4, kNoSample, red_and(format::ChannelSource::kZero)},    // RRR
                                              {5, kNoSample, red_and(format::ChannelSource::kAlpha)},   // RRRG
                                              {6, kNoSample, red_and(format::ChannelSource::kGreen)}};  // RG
constexpr ChannelsSwizzle kEtc1sChannels[] = {{0, kNoSample, format::kOpaqueSwizzle},                   // RGB
                                              {0, 15, format::kPlainSwizzle},                           // RGB, AAA
                                              {3, kNoSample, red_and(format::ChannelSource::kZero)},    // RRR
                                              {3, 4, red_and(format::ChannelSource::kAlpha)}};          // RRR, GGG

constexpr BlockHeadErrors kErrors{"KTX2",
                                  "which scree does not read: make it again as BC1 to BC5, BC7, BasisLZ, UASTC or 8 "
                                  "bits per channel (KTX-Software: ktx create)"};

Error fail(ErrorCode code, const std::string& what) {
  return kErrors.fail(code, what);
}

Error not_read(const std::string& what) {
  return kErrors.not_read(what);
}

class Reader {
 public:
  explicit Reader(ImageFile& file) : file_(file) {}

  Result<BlockFile> open() {
    SCREE_TRY(header());
    SCREE_TRY(descriptor());
    SCREE_TRY(keys());
    SCREE_TRY(levels());
    return std::move(head_);
  }

 private:
  uint32_t word(uint64_t offset) { return word_of(file_, offset); }
  uint64_t long_word(uint64_t offset) { return word(offset) | uint64_t{word(offset + 4)} << 32; }

  uint64_t index_end() const { return kHeaderBytes + kLevelBytes * level_count_; }

  Result<void> header() {
    if (file_.size() < kHeaderBytes)
      return fail(ErrorCode::kTruncated, std::to_string(file_.size()) + " bytes, but its header takes 80");
    for (uint64_t i = 0; i < kIdentifier.size(); ++i)
      if (file_.byte(i) != kIdentifier[i])
        return fail(ErrorCode::kFormat, i == 5 ? "of another version, expected 2" : "its identifier was changed");
    head_.kind = kErrors.kind;
    head_.width = word(20);
    head_.height = word(24);
    const uint32_t depth = word(28), layers = word(32), faces = word(36), level_count = word(40);
    if (head_.width == 0) return fail(ErrorCode::kFormat, "0 pixels wide");
    if (head_.height == 0 || depth != 0 || layers > 1 || faces != 1)
      return fail(ErrorCode::kUnsupported,
                  std::string(faces == 6          ? "a cube map"
                              : faces != 1        ? "of " + std::to_string(faces) + " faces"
                              : depth != 0        ? "a picture of three dimensions"
                              : head_.height == 0 ? "a picture of one dimension"
                                                  : "an array of " + std::to_string(layers) + " pictures") +
                      ", but glTF has pictures of two dimensions");
    if (head_.width > format::kMaxBlockImageSide || head_.height > format::kMaxBlockImageSide)
      return fail(ErrorCode::kRange, std::to_string(head_.width) + " x " + std::to_string(head_.height) +
                                         " pixels, but at most " + std::to_string(format::kMaxBlockImageSide) +
                                         " per side");
    const uint32_t most = format::most_block_levels(head_.width, head_.height) + 1;
    if (level_count > most)
      return fail(ErrorCode::kRange, std::to_string(level_count) + " levels, but a picture of " +
                                         std::to_string(head_.width) + " x " + std::to_string(head_.height) +
                                         " has at most " + std::to_string(most));
    level_count_ = std::max(1u, level_count);
    if (file_.size() < index_end())
      return fail(ErrorCode::kTruncated, std::to_string(file_.size()) +
                                             " bytes, but its header and index of levels take " +
                                             std::to_string(index_end()));
    SCREE_TRY(choose_packing(word(44)));
    return choose_format(word(12), level_count);
  }

  Result<void> choose_packing(uint32_t scheme) {
    switch (scheme) {
      case 0:
        break;
      case kBasisLzScheme:
        return {};
      case 2:
        head_.packing = BlockFile::Packing::kZstd;
        break;
      case 3:
        head_.packing = BlockFile::Packing::kZlib;
        break;
      default:
        return not_read("of supercompression scheme " + std::to_string(scheme));
    }
    if (long_word(72) != 0)
      return fail(ErrorCode::kFormat, std::to_string(long_word(72)) +
                                          " bytes of global data, but supercompression scheme " +
                                          std::to_string(scheme) + " has none");
    return {};
  }

  Result<void> choose_format(uint32_t number, uint32_t level_count) {
    if (number == 0) {
      const uint32_t offset = word(48);
      const uint32_t model = offset >= index_end() && offset < file_.size() ? file_.byte(offset + 12u) : 0;
      format_ = model == kEtc1s ? &kEtc1sFormat : model == kUastc ? &kUastcFormat : nullptr;
      if (format_ == nullptr) return not_read("of no Vulkan format and colour model " + std::to_string(model));
    } else {
      const auto fits = [&](const Format& format) { return number == format.number || number == format.srgb_number; };
      format_ = std::ranges::find_if(kFormats, fits);
      if (format_ == std::end(kFormats)) return not_read("of Vulkan format " + std::to_string(number));
    }
    head_.format = format_->format;
    head_.swizzle = format_->swizzle;
    head_.coding = format_->coding;
    if ((word(44) == kBasisLzScheme) != (format_->model == kEtc1s))
      return fail(ErrorCode::kFormat, "colour model " + std::to_string(format_->model) +
                                          " and supercompression scheme " + std::to_string(word(44)) +
                                          ", but BasisLZ and ETC1S belong together");
    if (level_count == 0 && (format_->number == 0 || format::block_side(format_->format) > 1))
      return fail(ErrorCode::kFormat, "0 levels, but compressed blocks have at least one");
    if (word(16) != 1) return fail(ErrorCode::kFormat, "typeSize is " + std::to_string(word(16)) + ", expected 1");
    return {};
  }

  /// Checks that the data format descriptor is present, consists of blocks that fill it, and belongs to the format.
  /// Colour spaces are not checked, because glTF defines them. Samples of compressed blocks are not checked either,
  /// because the format already defines the blocks.
  Result<void> descriptor() {
    const uint64_t offset = word(48), bytes = word(52);
    if (offset != index_end() || bytes < 28 || !format::range_within(offset, bytes, file_.size()))
      return fail(ErrorCode::kFormat, "data format descriptor of " + std::to_string(bytes) + " bytes at byte " +
                                          std::to_string(offset) + ", expected one at byte " +
                                          std::to_string(index_end()));
    const uint32_t block_bytes = word(offset + 8) >> 16;
    if (word(offset) != bytes || (word(offset + 4) != 0) || (word(offset + 8) & 0xffff) > 2 || block_bytes < 24 ||
        block_bytes > bytes - 4 || (block_bytes - 24) % 16 != 0)
      return fail(ErrorCode::kFormat, "data format descriptor is malformed");
    const uint32_t model = file_.byte(offset + 12);
    if (model != format_->model)
      return fail(ErrorCode::kFormat, "data format descriptor is of colour model " + std::to_string(model) + ", but " +
                                          format::block_format_name(head_.format) + " has model " +
                                          std::to_string(format_->model));
    for (uint64_t at = 4; at < bytes;) {
      const uint64_t size = bytes - at < 8 ? 0 : word(offset + at + 4) >> 16;
      if (size < 8 || size > bytes - at)
        return fail(ErrorCode::kFormat, "data format descriptor has " + std::to_string(bytes - at) +
                                            " bytes left, but its next block takes " + std::to_string(size));
      at += size;
    }
    if (model != kEtc1s && (word(offset + 20) >> 8 != 0 || word(offset + 24) != 0))
      return fail(ErrorCode::kUnsupported, "pixels of several planes");
    const uint32_t sample_count = (block_bytes - 24) / 16;
    if (model == kRgb) return samples(offset + 28, sample_count);
    if (model == kUastc) return choose_swizzle(offset + 28, sample_count, kUastcChannels);
    if (model == kEtc1s) return choose_swizzle(offset + 28, sample_count, kEtc1sChannels);
    return {};
  }

  /// The channels of UASTC and ETC1S, and whether ETC1S has a second slice. Textures of KHR_texture_basisu are RGB or
  /// RGBA. Other textures have one or two channels, which become red and green.
  Result<void> choose_swizzle(uint64_t begin, uint32_t count, std::span<const ChannelsSwizzle> known) {
    const auto channel = [&](uint32_t i) { return i < count ? file_.byte(begin + 16 * i + 3) & 15 : kNoSample; };
    for (const ChannelsSwizzle& one : known) {
      if (count > 2 || channel(0) != one.first || channel(1) != one.second) continue;
      head_.swizzle = one.swizzle;
      has_second_slice_ = count == 2;
      return {};
    }
    return fail(ErrorCode::kFormat, "data format descriptor has other samples than " +
                                        std::string(format_->model == kUastc ? "UASTC" : "ETC1S") + " may have");
  }

  /// Checks that uncompressed pixels match the format: the same channels in the same order, one unsigned byte each.
  Result<void> samples(uint64_t begin, uint32_t count) {
    const uint32_t channels = head_.coding == BlockFile::Coding::kRgb8 ? 3 : format::block_channels(head_.format);
    bool fits = count == channels;
    for (uint32_t i = 0; fits && i < count; ++i) {
      constexpr uint32_t kLinear = 0x10, kBitsLessOne = 7, kAlphaChannel = 15;
      const uint32_t channel = i == 3 ? kAlphaChannel : format_->swizzle == kReversedSwizzle ? 2 - i : i;
      const uint32_t stated = word(begin + 16 * i) & ~(kLinear << 24);
      fits = stated == (8 * i | kBitsLessOne << 16 | channel << 24) && word(begin + 16 * i + 4) == 0;
    }
    if (fits) return {};
    return fail(ErrorCode::kFormat, "data format descriptor has other samples than Vulkan format " +
                                        std::to_string(format_->number) + ", " + std::to_string(channels) +
                                        " unsigned bytes");
  }

  /// Reads the keys and values: applies KTXswizzle, and requires glTF's KTXorientation.
  Result<void> keys() {
    const uint64_t begin = word(56), bytes = word(60);
    if (bytes == 0) return {};
    if (begin != uint64_t{word(48)} + word(52) || !format::range_within(begin, bytes, file_.size()) ||
        bytes > kMaxKeyValueBytes)
      return fail(ErrorCode::kFormat, std::to_string(bytes) + " bytes of keys and values at byte " +
                                          std::to_string(begin) + ", expected at most " +
                                          std::to_string(kMaxKeyValueBytes) + " at byte " +
                                          std::to_string(uint64_t{word(48)} + word(52)));
    std::string all(bytes, '\0');
    for (uint64_t i = 0; i < bytes; ++i) all[i] = static_cast<char>(file_.byte(begin + i));
    for (uint64_t at = 0; at < bytes;) {
      uint32_t length = 0;
      if (bytes - at >= 4) length = format::load<uint32_t>(reinterpret_cast<const std::byte*>(all.data() + at));
      const std::string_view entry = std::string_view(all).substr(std::min(at + 4, bytes));
      if (length < 2 || length > entry.size() || entry.substr(0, length).find('\0') - 1 >= length - 1)
        return fail(ErrorCode::kFormat, "key and value at byte " + std::to_string(begin + at) + " are malformed");
      const std::string_view key = entry.substr(0, entry.find('\0'));
      std::string_view value = entry.substr(0, length).substr(key.size() + 1);
      while (value.ends_with('\0')) value.remove_suffix(1);
      SCREE_TRY(take_key(key, value));
      at += format::align_up(uint64_t{4} + length, 4);
    }
    return {};
  }

  Result<void> take_key(std::string_view key, std::string_view value) {
    if (key == "KTXorientation" && value != "rd")
      return fail(ErrorCode::kUnsupported,
                  "KTXorientation is \"" + printable(value) + "\", but glTF has pictures of \"rd\", right and down");
    if (key == "KTXcubemapIncomplete")
      return fail(ErrorCode::kUnsupported, "a part of a cube map, but glTF has pictures of two dimensions");
    if (key != "KTXswizzle") return {};
    constexpr std::string_view kLetters = "rgba01";
    uint32_t swizzle = 0;
    for (uint32_t i = 0; i < 4 && i < value.size(); ++i)
      swizzle |= static_cast<uint32_t>(std::min(kLetters.find(value[i]), size_t{7})) << 3 * i;
    if (value.size() != 4 || !format::is_swizzle(static_cast<uint16_t>(swizzle)))
      return fail(ErrorCode::kFormat,
                  "KTXswizzle is \"" + printable(value) + "\", expected four of r, g, b, a, 0 and 1");
    head_.swizzle = format::swizzle_of_swizzle(head_.swizzle, static_cast<uint16_t>(swizzle));
    return {};
  }

  static std::string printable(std::string_view value) {
    std::string text;
    for (const char c : value.substr(0, 20)) text += c >= ' ' && c <= '~' ? c : '?';
    return text;
  }

  Result<void> levels() {
    const uint64_t data = std::max<uint64_t>(uint64_t{word(48)} + word(52), uint64_t{word(56)} + word(60));
    for (uint32_t l = 0; l < level_count_; ++l) {
      const uint64_t entry = kHeaderBytes + kLevelBytes * l;
      const BlockFile::Level level{long_word(entry), long_word(entry + 8)};
      const uint64_t stated = long_word(entry + 16);
      const uint32_t width = std::max(1u, head_.width >> l), height = std::max(1u, head_.height >> l);
      const std::string name = "level " + std::to_string(l) + ": ";
      if (level.offset < data || !format::range_within(level.offset, level.bytes, file_.size()))
        return fail(ErrorCode::kTruncated, name + std::to_string(level.bytes) + " bytes at byte " +
                                               std::to_string(level.offset) + " of a file of " +
                                               std::to_string(file_.size()));
      if (head_.coding == BlockFile::Coding::kBasisLz) {
        if (stated != 0)
          return fail(ErrorCode::kFormat, name + std::to_string(stated) + " bytes unpacked, but BasisLZ states 0");
        head_.levels.push_back(level);
        continue;
      }
      const uint64_t expected = head_.unpacked_bytes(width, height);
      if (stated != expected || (head_.packing == BlockFile::Packing::kNone && level.bytes != expected))
        return fail(ErrorCode::kFormat, name + std::to_string(stated != expected ? stated : level.bytes) +
                                            " bytes, but " + std::to_string(width) + " x " + std::to_string(height) +
                                            " pixels take " + std::to_string(expected));
      // zstd and zlib never need more. A level with more has skippable frames, which take memory and hold no pixels.
      if (const uint64_t most = expected + expected / 8 + 1024; level.bytes > most)
        return fail(ErrorCode::kFormat, name + std::to_string(level.bytes) + " packed bytes of " +
                                            std::to_string(expected) + ", expected at most " + std::to_string(most));
      head_.levels.push_back(level);
    }
    return head_.coding == BlockFile::Coding::kBasisLz ? slices() : Result<void>();
  }

  /// Reads BasisLZ's global data: the places of its parts, and of each level's slices.
  Result<void> slices() {
    constexpr uint32_t kPartBytes = 20, kImageBytes = 20;
    const uint64_t begin = long_word(64), bytes = long_word(72);
    const uint64_t images_end = kPartBytes + kImageBytes * uint64_t{level_count_};
    if (!format::range_within(begin, bytes, file_.size()) || bytes < images_end)
      return fail(ErrorCode::kTruncated, std::to_string(bytes) + " bytes of global data at byte " +
                                             std::to_string(begin) + " of a file of " + std::to_string(file_.size()));
    BasisLzHead& parts = head_.basis_lz;
    parts = {word(begin) & 0xffff, word(begin) >> 16, word(begin + 4), word(begin + 8), word(begin + 12)};
    head_.basis_lz_offset = begin + images_end;
    const uint64_t expected = images_end + parts.part_bytes();
    if (bytes != expected || word(begin + 16) != 0)
      return fail(ErrorCode::kFormat, std::to_string(bytes) + " bytes of global data, but its parts take " +
                                          std::to_string(expected + word(begin + 16)));
    if (!may_hold_pixels(uint64_t{head_.width} * head_.height, file_.size()))
      return fail(ErrorCode::kTruncated, std::to_string(head_.width) + " x " + std::to_string(head_.height) +
                                             " pixels in " + std::to_string(file_.size()) + " bytes");
    for (uint32_t l = 0; l < level_count_; ++l) {
      const uint64_t entry = begin + kPartBytes + kImageBytes * l;
      BlockFile::Level& level = head_.levels[l];
      const BlockFile::Level slice{word(entry + 4), word(entry + 8), word(entry + 12), word(entry + 16)};
      // The codes and counts of a block take at most 16 bytes.
      const uint64_t most = 64 + format::block_level_bytes(BlockFormat::kBc7, std::max(1u, head_.width >> l),
                                                           std::max(1u, head_.height >> l));
      if (word(entry) != 0 || slice.bytes == 0 || std::max(slice.bytes, slice.alpha_bytes) > most ||
          !format::range_within(slice.offset, slice.bytes, level.bytes) ||
          (slice.alpha_bytes != 0) != has_second_slice_ ||
          !format::range_within(slice.alpha_offset, slice.alpha_bytes, level.bytes))
        return fail(ErrorCode::kFormat, "level " + std::to_string(l) + ": its slices are malformed");
      level = {level.offset + slice.offset, slice.bytes, level.offset + slice.alpha_offset, slice.alpha_bytes};
    }
    return {};
  }

  ImageFile& file_;
  BlockFile head_;
  const Format* format_ = nullptr;
  uint32_t level_count_ = 0;
  bool has_second_slice_ = false;  // of ETC1S
};

}  // namespace
}  // namespace ktx2

Result<BlockFile> open_ktx2(ImageFile& file) {
  return ktx2::Reader(file).open();
}

}  // namespace scree::runtime
