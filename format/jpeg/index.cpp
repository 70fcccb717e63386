#include "format/jpeg/index.h"

#include <algorithm>
#include <cstring>
#include <new>

#include "format/jpeg/index_layout.h"

namespace scree::format {
namespace {

Error bad(ErrorCode code, const std::string& what) {
  return {code, "indexed JPEG: " + what};
}

uint32_t ceil_div(uint32_t a, uint32_t b) {
  return (a + b - 1) / b;
}

/// Splits `bytes` into sections, one after the other.
class Sections {
 public:
  explicit Sections(std::span<const std::byte> bytes) : bytes_(bytes) {}

  /// The next `size` bytes. The bytes after them, up to `whole` in all, must be zero.
  Result<std::span<const std::byte>> take(const char* what, uint64_t size, uint64_t whole) {
    if (bytes_.size() - at_ < whole) {
      return bad(ErrorCode::kTruncated, std::string(what) + " of " + std::to_string(whole) + " bytes at byte " +
                                            std::to_string(at_) + " of " + std::to_string(bytes_.size()));
    }
    const auto section = bytes_.subspan(at_, size);
    const auto rest = bytes_.subspan(at_ + size, whole - size);
    if (std::any_of(rest.begin(), rest.end(), [](std::byte byte) { return byte != std::byte{0}; }))
      return bad(ErrorCode::kTrailing, "a byte that is not 0 behind the " + std::string(what));
    at_ += whole;
    return section;
  }
  std::span<const std::byte> rest() const { return bytes_.subspan(at_); }

 private:
  std::span<const std::byte> bytes_;
  uint64_t at_ = 0;
};

Result<JpegIndexHeader> read_header(std::span<const std::byte> bytes) {
  if (bytes.size() < sizeof(JpegIndexHeader))
    return bad(ErrorCode::kTruncated, std::to_string(bytes.size()) + " bytes, expected a header of 64");
  const auto header = load<JpegIndexHeader>(bytes.data());
  if (std::memcmp(header.magic, kJpegIndexMagic, sizeof header.magic) != 0)
    return bad(ErrorCode::kFormat, "does not start with SJPG");
  if (header.version != kJpegIndexVersion)
    return bad(ErrorCode::kVersion, "version " + std::to_string(header.version) + ", expected 1");
  const uint32_t count = header.component_count;
  if (count != 1 && count != 3) return bad(ErrorCode::kRange, std::to_string(count) + " components, expected 1 or 3");
  const auto colour = static_cast<JpegColour>(header.colour);
  const bool fits =
      count == 1 ? colour == JpegColour::kGrey : colour == JpegColour::kYcbcr || colour == JpegColour::kRgb;
  if (!fits) {
    return bad(ErrorCode::kRange,
               "colour " + std::to_string(uint32_t{header.colour}) + " of " + std::to_string(count) + " components");
  }
  if (header.width == 0 || header.height == 0) return bad(ErrorCode::kRange, "a side of 0 pixels");
  for (const uint32_t tables : {header.quant_count, header.dc_count, header.ac_count}) {
    if (tables < 1 || tables > count) return bad(ErrorCode::kRange, std::to_string(tables) + " tables of a kind");
  }
  const auto is_zero = [](const uint8_t* first, size_t size) {
    return std::all_of(first, first + size, [](uint8_t byte) { return byte == 0; });
  };
  if (!is_zero(header.zero, sizeof header.zero) || header.zero_end != 0)
    return bad(ErrorCode::kReserved, "a reserved byte of the header is set");
  for (uint32_t i = 0; i < kJpegMaxComponents; ++i) {
    const JpegIndexHeader::Component& component = header.components[i];
    if (!is_zero(component.zero, sizeof component.zero))
      return bad(ErrorCode::kReserved, "a reserved byte of component " + std::to_string(i) + " is set");
    if (i >= count) {
      if (!is_zero(&component.h, sizeof component))
        return bad(ErrorCode::kReserved, "component " + std::to_string(i) + " of " + std::to_string(count) + " is set");
      continue;
    }
    const uint32_t most = count == 1 ? 1 : 4;
    if (component.h < 1 || component.h > most || component.v < 1 || component.v > most)
      return bad(ErrorCode::kRange, "component " + std::to_string(i) + ": sampling factors " +
                                        std::to_string(uint32_t{component.h}) + " x " +
                                        std::to_string(uint32_t{component.v}));
    if (component.quant >= header.quant_count || component.dc >= header.dc_count || component.ac >= header.ac_count)
      return bad(ErrorCode::kRange, "component " + std::to_string(i) + ": a missing table");
  }
  return header;
}

Result<void> read_huffman(JpegIndex& index, Sections& sections, uint32_t dc_count, uint32_t table_count) {
  uint64_t size = 0;
  const std::span<const std::byte> bytes = sections.rest();
  for (uint32_t i = 0; i < table_count; ++i) {
    JpegHuffmanSpec spec;
    spec.is_defined = true;
    const Error truncated =
        bad(ErrorCode::kTruncated, "ends in Huffman table " + std::to_string(i) + " of " + std::to_string(table_count));
    if (bytes.size() - size < spec.counts.size()) return truncated;
    std::memcpy(spec.counts.data(), bytes.data() + size, spec.counts.size());
    size += spec.counts.size();
    const uint32_t symbols = spec.symbol_count();
    if (symbols > 256) return bad(ErrorCode::kFormat, std::to_string(symbols) + " Huffman codes, expected at most 256");
    if (bytes.size() - size < symbols) return truncated;
    std::memcpy(spec.symbols.data(), bytes.data() + size, symbols);
    size += symbols;
    const Result<JpegHuffmanTable> table = make_jpeg_table(spec, i < dc_count);
    if (!table) return bad(table.error().code, table.error().message);
    index.tables.push_back(*table);
    (i < dc_count ? index.dc : index.ac).push_back(spec);
  }
  SCREE_TRY(sections.take("Huffman tables", size, jpeg_section_bytes(size)));
  return {};
}

Result<void> check_blocks(const JpegIndex& index, uint32_t words) {
  uint64_t word = 0;
  for (uint32_t i = 0; i < index.layout.anchor_block_count; ++i) {
    const auto block = load<JpegAnchorBlock>(index.blocks.data() + sizeof(JpegAnchorBlock) * uint64_t{i});
    const auto refuse = [&](ErrorCode code, const char* what) {
      return bad(code, "anchor block " + std::to_string(i) + ": " + what);
    };
    if (block.zero[0] != 0 || block.zero[1] != 0) return refuse(ErrorCode::kReserved, "a reserved byte is set");
    for (uint32_t c = 0; c < kJpegMaxComponents; ++c) {
      if (block.dc_bits[c] > 16) return refuse(ErrorCode::kRange, "a width of more than 16 bits");
      if (c >= index.component_count && (block.dc_bits[c] != 0 || block.dc_min[c] != 0))
        return refuse(ErrorCode::kReserved, "predictors of a missing component");
    }
    if (block.bit_bits > 32) return refuse(ErrorCode::kRange, "a width of more than 32 bits");
    if (block.bit > 8 * index.data.size()) return refuse(ErrorCode::kRange, "begins behind the data");
    if (block.word != word) return refuse(ErrorCode::kRange, "anchors that do not follow those before");
    const uint32_t groups = std::min(kJpegBlockGroups, index.layout.group_count - i * kJpegBlockGroups);
    word += anchor_words(block, groups);
    if (word > words) return refuse(ErrorCode::kRange, "anchors past their end");
    const uint32_t used = groups * anchor_stride(block) % 32;
    if (used != 0 && load<uint32_t>(index.anchors.data() + 4 * (word - 1)) >> used != 0)
      return refuse(ErrorCode::kTrailing, "a bit set behind its anchors");
  }
  if (word != words)
    return bad(ErrorCode::kRange, std::to_string(words) + " words of anchors, expected " + std::to_string(word));
  return {};
}

}  // namespace

Result<JpegLayout> jpeg_layout(uint32_t width, uint32_t height, std::span<const JpegComponent> components) {
  JpegLayout layout;
  uint32_t h = 1;
  uint32_t v = 1;
  for (const JpegComponent& component : components) {
    h = std::max<uint32_t>(h, component.h);
    v = std::max<uint32_t>(v, component.v);
    layout.mcu_blocks += uint32_t{component.h} * component.v;
  }
  if (layout.mcu_blocks > kJpegMaxMcuBlocks) {
    return Error{ErrorCode::kUnsupported,
                 "JPEG: " + std::to_string(layout.mcu_blocks) + " blocks per MCU, expected at most 10"};
  }
  layout.mcus_across = ceil_div(width, 8 * h);
  layout.mcus_down = ceil_div(height, 8 * v);
  layout.group_mcus = ceil_div(kJpegGroupPixels, 64 * h * v);
  layout.group_count = ceil_div(layout.mcu_count(), layout.group_mcus);
  layout.anchor_block_count = ceil_div(layout.group_count, kJpegBlockGroups);
  return layout;
}

JpegView JpegIndex::view() const {
  JpegView view{};
  view.data = data.data();
  view.data_bits = 8 * uint64_t{data.size()};
  view.blocks = blocks.data();
  view.anchors = anchors.data();
  view.tables = tables.data();
  view.mcu_count = layout.mcu_count();
  view.mcus_across = layout.mcus_across;
  view.group_mcus = layout.group_mcus;
  view.restart_interval = restart_interval;
  view.component_count = component_count;
  for (uint32_t i = 0; i < component_count; ++i) {
    const JpegComponent& component = components[i];
    view.components[i] = {component.h, component.v, component.quant, component.dc,
                          static_cast<uint8_t>(dc.size() + component.ac)};
  }
  return view;
}

Result<JpegIndex> open_jpeg_index(std::span<const std::byte> bytes) try {
  const auto header = SCREE_TRY(read_header(bytes));
  JpegIndex index;
  index.width = header.width;
  index.height = header.height;
  index.colour = static_cast<JpegColour>(header.colour);
  index.restart_interval = header.restart_interval;
  index.component_count = header.component_count;
  for (uint32_t i = 0; i < index.component_count; ++i) {
    const JpegIndexHeader::Component& from = header.components[i];
    index.components[i] = {0, from.h, from.v, from.quant, from.dc, from.ac};
  }
  index.layout = SCREE_TRY(jpeg_layout(index.width, index.height, {index.components.data(), index.component_count}));

  Sections sections(bytes);
  SCREE_TRY(sections.take("header", sizeof header, sizeof header));
  const uint64_t quant_bytes = sizeof(index.quant[0]) * header.quant_count;
  const auto quant = SCREE_TRY(sections.take("quantisation tables", quant_bytes, quant_bytes));
  index.quant.resize(header.quant_count);
  std::memcpy(index.quant.data(), quant.data(), quant_bytes);
  SCREE_TRY(read_huffman(index, sections, header.dc_count, uint32_t{header.dc_count} + header.ac_count));

  if (header.data_bytes > bytes.size()) {
    return bad(ErrorCode::kTruncated,
               std::to_string(header.data_bytes) + " bytes of data, " + std::to_string(bytes.size()) + " in all");
  }
  index.data = SCREE_TRY(sections.take("data", header.data_bytes, jpeg_stream_bytes(header.data_bytes)));
  const uint64_t block_bytes = sizeof(JpegAnchorBlock) * uint64_t{index.layout.anchor_block_count};
  index.blocks = SCREE_TRY(sections.take("anchor blocks", block_bytes, jpeg_section_bytes(block_bytes)));
  const uint64_t anchor_bytes = uint64_t{4} * header.anchor_words;
  index.anchors = sections.rest();
  SCREE_TRY(sections.take("anchors", anchor_bytes, jpeg_stream_bytes(anchor_bytes)));
  if (!sections.rest().empty())
    return bad(ErrorCode::kTrailing, std::to_string(sections.rest().size()) + " bytes left over");
  if (!jpeg_data_may_hold(index.layout, index.data.size())) {
    return bad(ErrorCode::kRange, std::to_string(index.data.size()) + " bytes of data for " +
                                      std::to_string(index.layout.mcu_count()) + " MCUs");
  }
  SCREE_TRY(check_blocks(index, header.anchor_words));
  return index;
} catch (const std::bad_alloc&) {
  return Error{ErrorCode::kMemory, "out of memory for a JPEG's tables"};
}

}  // namespace scree::format
