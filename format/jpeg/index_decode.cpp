#include <algorithm>
#include <cassert>
#include <cstring>

#include "format/jpeg/index.h"

namespace scree::format {
namespace {

constexpr uint64_t kMaxHeaderBytes = 4096;  // three tables of each kind take 2085, the other segments 52

class FileWriter {
 public:
  explicit FileWriter(std::span<std::byte> out) : out_(out) {}

  void byte(uint32_t value) { out_[size_++] = static_cast<std::byte>(value); }
  void word(uint32_t value) {
    byte(value >> 8);
    byte(value & 255);
  }
  void marker(uint32_t value) { word(0xff00 | value); }
  void text(std::span<const uint8_t> bytes) {
    for (const uint8_t value : bytes) byte(value);
  }
  /// Writes entropy-coded bytes, with a zero behind every FF.
  void stuffed(std::span<const std::byte> bytes) {
    while (!bytes.empty()) {
      const auto* const found = static_cast<const std::byte*>(std::memchr(bytes.data(), 0xff, bytes.size()));
      const size_t plain = found ? static_cast<size_t>(found - bytes.data()) + 1 : bytes.size();
      std::memcpy(out_.data() + size_, bytes.data(), plain);
      size_ += plain;
      if (found) byte(0);
      bytes = bytes.subspan(plain);
    }
  }
  uint64_t size() const { return size_; }

 private:
  std::span<std::byte> out_;
  uint64_t size_ = 0;
};

void write_head(FileWriter& file, const JpegIndex& index) {
  file.marker(0xd8);
  if (index.colour == JpegColour::kRgb) {
    file.marker(0xee);
    file.word(14);
    file.text(std::array<uint8_t, 12>{'A', 'd', 'o', 'b', 'e', 0, 100, 0, 0, 0, 0, 0});  // transform 0
  } else {
    file.marker(0xe0);
    file.word(16);
    file.text(std::array<uint8_t, 14>{'J', 'F', 'I', 'F', 0, 1, 1, 0, 0, 1, 0, 1, 0, 0});
  }
  bool is_extended = index.dc.size() > 2 || index.ac.size() > 2;
  for (uint32_t i = 0; i < index.quant.size(); ++i) {
    const auto& table = index.quant[i];
    const bool is_wide = std::any_of(table.begin(), table.end(), [](uint16_t value) { return value > 255; });
    is_extended |= is_wide;
    file.marker(0xdb);
    file.word(is_wide ? 131 : 67);
    file.byte(i | (is_wide ? 16 : 0));
    for (const uint16_t value : table) is_wide ? file.word(value) : file.byte(value);
  }
  file.marker(is_extended ? 0xc1 : 0xc0);
  file.word(8 + 3 * index.component_count);
  file.byte(8);
  file.word(index.height);
  file.word(index.width);
  file.byte(index.component_count);
  for (uint32_t i = 0; i < index.component_count; ++i) {
    const JpegComponent& component = index.components[i];
    file.byte(i + 1);
    file.byte(uint32_t{component.h} << 4 | component.v);
    file.byte(component.quant);
  }
  const auto write_huffman = [&](const std::vector<JpegHuffmanSpec>& specs, uint32_t kind) {
    for (uint32_t i = 0; i < specs.size(); ++i) {
      const uint32_t symbols = specs[i].symbol_count();
      file.marker(0xc4);
      file.word(19 + symbols);
      file.byte(kind << 4 | i);
      file.text(specs[i].counts);
      file.text({specs[i].symbols.data(), symbols});
    }
  };
  write_huffman(index.dc, 0);
  write_huffman(index.ac, 1);
  if (index.restart_interval != 0) {
    file.marker(0xdd);
    file.word(4);
    file.word(index.restart_interval);
  }
  file.marker(0xda);
  file.word(6 + 2 * index.component_count);
  file.byte(index.component_count);
  for (uint32_t i = 0; i < index.component_count; ++i) {
    file.byte(i + 1);
    file.byte(uint32_t{index.components[i].dc} << 4 | index.components[i].ac);
  }
  file.byte(0);
  file.byte(63);
  file.byte(0);
}

}  // namespace

uint64_t jpeg_file_bound(const JpegIndex& index) {
  // A restart interval takes at least a byte of data.
  return kMaxHeaderBytes + 4 * uint64_t{index.data.size()};
}

Result<uint64_t> decode_jpeg_index(std::span<std::byte> out, const JpegIndex& index) {
  assert(out.size() >= jpeg_file_bound(index));
  FileWriter file(out);
  write_head(file, index);
  const JpegView view = index.view();
  JpegCursor cursor{};
  uint64_t written = 0;  // of the data
  const auto fail = [&](const char* what) {
    return Error{ErrorCode::kFormat, "indexed JPEG: MCU " + std::to_string(cursor.mcu) + ": " + what};
  };
  while (cursor.mcu < view.mcu_count) {
    begin_jpeg_mcu(view, cursor);
    if (view.restart_interval != 0 && cursor.mcu != 0 && cursor.mcu % view.restart_interval == 0) {
      if (cursor.bit / 8 > index.data.size()) return fail("the data end");
      file.stuffed(index.data.subspan(written, cursor.bit / 8 - written));
      file.marker(0xd0 + (cursor.mcu / view.restart_interval - 1) % 8);
      written = cursor.bit / 8;
    }
    if (cursor.mcu % view.group_mcus == 0) {
      const JpegCursor anchor = jpeg_anchor(view, cursor.mcu / view.group_mcus);
      if (anchor.bit != cursor.bit || !std::equal(anchor.dc, anchor.dc + kJpegMaxComponents, cursor.dc))
        return fail("an anchor that is not where its group begins");
    }
    if (!decode_jpeg_mcu_at(view, cursor, [](uint32_t, uint32_t, int32_t) {}))
      return fail(cursor.bit + 32 > view.data_bits ? "the data end"
                                                   : "no Huffman code, or a coefficient past the 63rd");
  }
  if ((cursor.bit + 7) / 8 != index.data.size()) return fail("data left over");
  file.stuffed(index.data.subspan(written));
  file.marker(0xd9);
  return file.size();
}

}  // namespace scree::format
