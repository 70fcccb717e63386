#include "format/jpeg/parse.h"

#include <algorithm>
#include <cstring>

#include "format/jpeg/huffman.h"

namespace scree::format {
namespace {

constexpr uint32_t kSoi = 0xd8;
constexpr uint32_t kEoi = 0xd9;
constexpr uint32_t kSos = 0xda;

Error bad(ErrorCode code, uint64_t at, const std::string& what) {
  return {code, "JPEG: byte " + std::to_string(at) + ": " + what};
}

/// The bytes of a segment behind its length field.
struct Segment {
  std::span<const std::byte> bytes;
  uint64_t offset;  // in the file

  uint64_t size() const { return bytes.size(); }
  uint32_t byte(uint64_t i) const { return static_cast<uint32_t>(bytes[i]); }
  uint16_t word(uint64_t i) const { return static_cast<uint16_t>(byte(i) << 8 | byte(i + 1)); }
  bool starts_with(const char* text, size_t size_of_text) const {
    return bytes.size() >= size_of_text && std::memcmp(bytes.data(), text, size_of_text) == 0;
  }
};

/// The markers that determine the colour, together with the components.
struct ColourMarkers {
  bool has_jfif = false;
  bool has_adobe = false;
  uint32_t adobe_transform = 0;
};

JpegColour colour_of(const JpegHeader& header, const ColourMarkers& markers) {
  if (header.component_count == 1) return JpegColour::kGrey;
  if (header.component_count != 3) return JpegColour::kOther;
  if (markers.has_jfif) return JpegColour::kYcbcr;
  if (markers.has_adobe) return markers.adobe_transform == 0 ? JpegColour::kRgb : JpegColour::kYcbcr;
  const auto& c = header.components;
  const bool says_rgb = c[0].id == 'R' && c[1].id == 'G' && c[2].id == 'B';
  return says_rgb ? JpegColour::kRgb : JpegColour::kYcbcr;
}

Result<void> read_quant(JpegHeader& header, const Segment& segment) {
  for (uint64_t at = 0; at < segment.size();) {
    const uint64_t where = segment.offset + at;
    const uint32_t number = segment.byte(at) & 15;
    const bool is_wide = segment.byte(at) >> 4 != 0;
    ++at;
    if (number > 3) return bad(ErrorCode::kRange, where, "quantisation table " + std::to_string(number));
    if (segment.size() - at < (is_wide ? 128u : 64u))
      return bad(ErrorCode::kFormat, where, "half a quantisation table");
    for (uint16_t& value : header.quant[number]) {
      value = is_wide ? segment.word(at) : static_cast<uint16_t>(segment.byte(at));
      at += is_wide ? 2 : 1;
    }
    header.quant_is_defined[number] = true;
  }
  return {};
}

Result<void> read_huffman(JpegHeader& header, const Segment& segment) {
  for (uint64_t at = 0; at < segment.size();) {
    const uint64_t where = segment.offset + at;
    const uint32_t number = segment.byte(at) & 15;
    const uint32_t is_ac = segment.byte(at) >> 4;
    ++at;
    if (number > 3 || is_ac > 1) return bad(ErrorCode::kRange, where, "Huffman table " + std::to_string(number));
    if (segment.size() - at < 16) return bad(ErrorCode::kFormat, where, "half a Huffman table");
    JpegHuffmanSpec table;
    for (uint8_t& count : table.counts) count = static_cast<uint8_t>(segment.byte(at++));
    const uint32_t symbols = table.symbol_count();
    if (symbols > 256)
      return bad(ErrorCode::kFormat, where, std::to_string(symbols) + " Huffman codes, expected at most 256");
    if (segment.size() - at < symbols) return bad(ErrorCode::kFormat, where, "half a Huffman table");
    for (uint32_t i = 0; i < symbols; ++i) table.symbols[i] = static_cast<uint8_t>(segment.byte(at++));
    table.is_defined = true;
    (is_ac ? header.ac : header.dc)[number] = table;
  }
  return {};
}

Result<void> read_frame(JpegHeader& header, const Segment& segment, uint32_t marker) {
  if (header.component_count != 0) return bad(ErrorCode::kFormat, segment.offset, "a second frame header");
  if (segment.size() < 6) return bad(ErrorCode::kFormat, segment.offset, "half a frame header");
  const uint32_t type = marker - 0xc0;
  header.is_arithmetic = type >= 8;
  header.process = type % 8 >= 5   ? JpegProcess::kHierarchical
                   : type % 4 == 3 ? JpegProcess::kLossless
                   : type % 4 == 2 ? JpegProcess::kProgressive
                   : type == 0     ? JpegProcess::kBaseline
                                   : JpegProcess::kExtended;
  header.precision = static_cast<uint8_t>(segment.byte(0));
  header.height = segment.word(1);
  header.width = segment.word(3);
  header.component_count = segment.byte(5);
  if (header.width == 0) return bad(ErrorCode::kFormat, segment.offset, "width 0");
  if (header.height == 0)
    return bad(ErrorCode::kUnsupported, segment.offset, "height 0 (given after the data, by a DNL marker)");
  if (header.component_count == 0) return bad(ErrorCode::kFormat, segment.offset, "no components");
  if (segment.size() != 6 + 3 * header.component_count)
    return bad(ErrorCode::kFormat, segment.offset,
               "a frame header of " + std::to_string(segment.size()) + " bytes for " +
                   std::to_string(header.component_count) + " components");
  for (uint32_t i = 0; i < std::min(header.component_count, 4u); ++i) {
    JpegComponent& component = header.components[i];
    component.id = static_cast<uint8_t>(segment.byte(6 + 3 * i));
    component.h = static_cast<uint8_t>(segment.byte(7 + 3 * i) >> 4);
    component.v = static_cast<uint8_t>(segment.byte(7 + 3 * i) & 15);
    component.quant = static_cast<uint8_t>(segment.byte(8 + 3 * i));
    if (component.h < 1 || component.h > 4 || component.v < 1 || component.v > 4)
      return bad(ErrorCode::kRange, segment.offset + 7 + 3 * i,
                 "sampling factors " + std::to_string(component.h) + " x " + std::to_string(component.v));
    if (component.quant > 3)
      return bad(ErrorCode::kRange, segment.offset + 8 + 3 * i,
                 "quantisation table " + std::to_string(component.quant));
  }
  // A scan of one component is not interleaved: its MCU is one block, regardless of its factors.
  if (header.component_count == 1) header.components[0].h = header.components[0].v = 1;
  return {};
}

Result<void> read_scan(JpegHeader& header, const Segment& segment) {
  if (header.component_count == 0) return bad(ErrorCode::kFormat, segment.offset, "a scan before the frame header");
  if (segment.size() < 1) return bad(ErrorCode::kFormat, segment.offset, "half a scan header");
  const uint32_t count = segment.byte(0);
  if (count < 1 || count > 4 || segment.size() != 4 + 2 * count)
    return bad(
        ErrorCode::kFormat, segment.offset,
        "a scan header of " + std::to_string(segment.size()) + " bytes for " + std::to_string(count) + " components");
  header.scan_is_whole = count == header.component_count;
  for (uint32_t i = 0; i < count && header.scan_is_whole; ++i) {
    JpegComponent& component = header.components[i];
    header.scan_is_whole = segment.byte(1 + 2 * i) == component.id;
    component.dc = static_cast<uint8_t>(segment.byte(2 + 2 * i) >> 4);
    component.ac = static_cast<uint8_t>(segment.byte(2 + 2 * i) & 15);
    if (component.dc > 3 || component.ac > 3)
      return bad(ErrorCode::kRange, segment.offset + 2 + 2 * i, "a Huffman table past number 3");
  }
  return {};
}

void fill_standard_tables(JpegHeader& header) {
  for (uint32_t number = 0; number < 2; ++number) {
    if (!header.dc[number].is_defined) header.dc[number] = standard_jpeg_table(false, number);
    if (!header.ac[number].is_defined) header.ac[number] = standard_jpeg_table(true, number);
  }
}

bool is_frame_marker(uint32_t marker) {
  return marker >= 0xc0 && marker <= 0xcf && marker != 0xc4 && marker != 0xc8 && marker != 0xcc;
}

}  // namespace

uint64_t next_jpeg_marker(std::span<const std::byte> file, uint64_t at, uint32_t& marker) {
  constexpr std::byte kFill{0xff};
  for (;;) {
    while (at < file.size() && file[at] != kFill) ++at;
    while (at < file.size() && file[at] == kFill) ++at;
    if (at >= file.size()) {
      marker = 0;
      return file.size();
    }
    marker = static_cast<uint32_t>(file[at++]);
    if (marker != 0) return at;
  }
}

Result<JpegHeader> parse_jpeg(std::span<const std::byte> file) {
  if (file.size() < 2 || file[0] != std::byte{0xff} || file[1] != std::byte{kSoi}) {
    if (file.size() < 2) return bad(ErrorCode::kTruncated, 0, "the file ends, expected a JPEG");
    return bad(ErrorCode::kFormat, 0, "no start marker");
  }
  JpegHeader header;
  ColourMarkers markers;
  for (uint64_t at = 2;;) {
    uint32_t marker;
    at = next_jpeg_marker(file, at, marker);
    if (marker == 0) return bad(ErrorCode::kTruncated, file.size(), "the file ends before its first scan");
    if (marker == 1 || (marker >= 0xd0 && marker <= 0xd7)) continue;  // markers without a segment
    if (marker == kSoi) return bad(ErrorCode::kFormat, at - 2, "a second start marker");
    if (marker == kEoi) return bad(ErrorCode::kFormat, at - 2, "the end marker before a scan");
    if (file.size() - at < 2) return bad(ErrorCode::kTruncated, file.size(), "the file ends before its first scan");
    const uint64_t length = static_cast<uint64_t>(file[at]) << 8 | static_cast<uint64_t>(file[at + 1]);
    if (length < 2) return bad(ErrorCode::kFormat, at, "a segment of " + std::to_string(length) + " bytes");
    if (length > file.size() - at)
      return bad(ErrorCode::kTruncated, file.size(), "the file ends before its first scan");
    const Segment segment{file.subspan(at + 2, length - 2), at + 2};
    Result<void> read;
    if (is_frame_marker(marker)) {
      read = read_frame(header, segment, marker);
    } else if (marker == 0xc4) {
      read = read_huffman(header, segment);
    } else if (marker == 0xdb) {
      read = read_quant(header, segment);
    } else if (marker == 0xdd) {
      if (segment.size() != 2) return bad(ErrorCode::kFormat, at, "a restart interval that is not 2 bytes");
      header.restart_interval = segment.word(0);
    } else if (marker == 0xe0 && segment.size() >= 14 && segment.starts_with("JFIF", 5)) {
      markers.has_jfif = true;
    } else if (marker == 0xee && segment.size() >= 12 && segment.starts_with("Adobe", 5)) {
      markers.has_adobe = true;
      markers.adobe_transform = segment.byte(11);
    } else if (marker == kSos) {
      read = read_scan(header, segment);
    }
    if (!read) return read.error();
    at += length;
    if (marker != kSos) continue;
    header.data_offset = at;
    header.colour = colour_of(header, markers);
    fill_standard_tables(header);
    return header;
  }
}

JpegVerdict judge_jpeg(const JpegHeader& header) {
  if (header.process == JpegProcess::kLossless) return {JpegTreatment::kRefuse, "lossless"};
  if (header.process == JpegProcess::kHierarchical) return {JpegTreatment::kRefuse, "hierarchical"};
  if (header.precision != 8)
    return {JpegTreatment::kRefuse, std::to_string(uint32_t{header.precision}) + " bits per sample"};
  if (header.colour == JpegColour::kOther)
    return {JpegTreatment::kReencode,
            std::to_string(header.component_count) + " components" + (header.component_count == 4 ? " (CMYK)" : "")};
  if (header.process == JpegProcess::kProgressive) return {JpegTreatment::kTranscode, "progressive"};
  if (header.is_arithmetic) return {JpegTreatment::kTranscode, "arithmetic coding"};
  if (!header.scan_is_whole) return {JpegTreatment::kTranscode, "several scans"};
  return {JpegTreatment::kAsItIs, {}};
}

}  // namespace scree::format
