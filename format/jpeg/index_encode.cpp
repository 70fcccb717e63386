#include <algorithm>
#include <bit>
#include <cassert>
#include <cstring>

#include "format/jpeg/index.h"
#include "format/jpeg/index_layout.h"

namespace scree::format {
namespace {

/// The tables that the components use, numbered by first use.
struct UsedTables {
  std::array<JpegComponent, 3> components;  // with the new table numbers
  std::vector<uint32_t> quant;              // numbers of the tables in the file
  std::vector<uint32_t> dc;
  std::vector<uint32_t> ac;
};

uint8_t renumber(std::vector<uint32_t>& used, uint32_t number) {
  const auto found = std::find(used.begin(), used.end(), number);
  const auto place = static_cast<uint8_t>(found - used.begin());
  if (found == used.end()) used.push_back(number);
  return place;
}

/// The parts of the indexed JPEG that follow from the header: all but the data.
struct Plan {
  UsedTables tables;
  JpegLayout layout;
  uint64_t quant_at = sizeof(JpegIndexHeader);
  uint64_t huffman_at = 0;
  uint64_t data_at = 0;
};

Result<Plan> make_plan(const JpegHeader& header) {
  const JpegVerdict verdict = judge_jpeg(header);
  if (verdict.treatment != JpegTreatment::kAsItIs) return Error{ErrorCode::kUnsupported, "JPEG: " + verdict.reason};
  Plan plan;
  const std::span<const JpegComponent> components(header.components.data(), header.component_count);
  plan.layout = SCREE_TRY(jpeg_layout(header.width, header.height, components));
  for (uint32_t i = 0; i < components.size(); ++i) {
    const JpegComponent& from = components[i];
    const auto missing = [](const char* kind, uint32_t number) {
      return Error{ErrorCode::kFormat, std::string("JPEG: no ") + kind + " table " + std::to_string(number)};
    };
    if (!header.quant_is_defined[from.quant]) return missing("quantisation", from.quant);
    if (!header.dc[from.dc].is_defined) return missing("DC", from.dc);
    if (!header.ac[from.ac].is_defined) return missing("AC", from.ac);
    JpegComponent& to = plan.tables.components[i];
    to = from;
    to.quant = renumber(plan.tables.quant, from.quant);
    to.dc = renumber(plan.tables.dc, from.dc);
    to.ac = renumber(plan.tables.ac, from.ac);
  }
  plan.huffman_at = plan.quant_at + 128 * plan.tables.quant.size();
  uint64_t huffman_bytes = 0;
  for (const uint32_t number : plan.tables.dc) huffman_bytes += 16 + header.dc[number].symbol_count();
  for (const uint32_t number : plan.tables.ac) huffman_bytes += 16 + header.ac[number].symbol_count();
  plan.data_at = plan.huffman_at + jpeg_section_bytes(huffman_bytes);
  return plan;
}

/// Entropy-coded data up to the next marker.
struct Stretch {
  uint64_t bytes = 0;   // unstuffed
  uint32_t marker = 0;  // 0: end of file
  uint64_t marker_at = 0;
  uint64_t next = 0;  // offset behind the marker
};

/// Reads the data from `at` to the next marker, at most `limit` unstuffed bytes, and writes them if `out` is not null.
/// As in libjpeg, several FF before a stuffed zero count as one FF, and all FF before a marker are fill bytes.
Stretch unstuff(std::span<const std::byte> file, uint64_t at, std::byte* out, uint64_t limit = UINT64_MAX) {
  Stretch stretch;
  while (at < file.size() && stretch.bytes < limit) {
    const auto* const found = static_cast<const std::byte*>(std::memchr(file.data() + at, 0xff, file.size() - at));
    const uint64_t end = found ? static_cast<uint64_t>(found - file.data()) : file.size();
    const uint64_t plain = std::min(end - at, limit - stretch.bytes);
    if (out != nullptr) std::memcpy(out + stretch.bytes, file.data() + at, plain);
    stretch.bytes += plain;
    at += plain;
    if (at < end || !found || stretch.bytes == limit) break;
    stretch.marker_at = at;
    while (at < file.size() && file[at] == std::byte{0xff}) ++at;
    if (at == file.size()) break;
    const auto marker = static_cast<uint32_t>(file[at++]);
    if (marker != 0) {
      stretch.marker = marker;
      stretch.next = at;
      return stretch;
    }
    if (out != nullptr) out[stretch.bytes] = std::byte{0xff};
    ++stretch.bytes;
  }
  stretch.marker_at = stretch.next = at;
  return stretch;
}

struct Anchor {
  uint64_t bit;
  std::array<int16_t, kJpegMaxComponents> dc;
};

/// Reads a scan: unstuffs it into `out` and decodes it for its anchors.
class ScanReader {
 public:
  /// `view`: all but the data and the anchors. `out`: room for the rest of the file and slack.
  ScanReader(std::span<const std::byte> file, uint64_t data_offset, const JpegView& view, std::span<std::byte> out)
      : file_(file), next_(data_offset), view_(view), out_(out) {
    view_.data = out_.data();
  }

  Result<void> read() {
    for (uint32_t interval = 0; cursor_.mcu < view_.mcu_count; ++interval) {
      if (interval != 0) {
        const uint32_t expected = 0xd0 + (interval - 1) % 8;
        if (marker_ != expected) {
          return fail(marker_ == 0 ? ErrorCode::kTruncated : ErrorCode::kFormat, marker_at_,
                      (marker_ == 0 ? std::string("the file ends") : "marker " + std::to_string(marker_)) +
                          ", expected restart marker " + std::to_string(expected));
        }
      }
      SCREE_TRY(read_interval());
    }
    return check_rest();
  }

  const std::vector<Anchor>& anchors() const { return anchors_; }
  uint64_t data_bytes() const { return data_bytes_; }
  uint64_t dropped_bytes() const { return dropped_bytes_; }

 private:
  Error fail(ErrorCode code, uint64_t at, const std::string& what) const {
    return {code, "JPEG: byte " + std::to_string(at) + ": MCU " + std::to_string(cursor_.mcu) + " of " +
                      std::to_string(view_.mcu_count) + ": " + what};
  }

  Result<void> read_interval() {
    const uint64_t first = next_;
    const uint64_t before = data_bytes_;
    const Stretch stretch = unstuff(file_, first, out_.data() + before);
    const uint64_t end = before + stretch.bytes;
    std::memset(out_.data() + end, 0, kPackedSlackBytes);
    view_.data_bits = 8 * end;
    const uint32_t left = view_.mcu_count - cursor_.mcu;
    const uint32_t stop = cursor_.mcu + (view_.restart_interval == 0 ? left : std::min(view_.restart_interval, left));
    while (cursor_.mcu < stop) {
      begin_jpeg_mcu(view_, cursor_);
      if (cursor_.mcu % view_.group_mcus == 0) add_anchor();
      if (decode_jpeg_mcu_at(view_, cursor_, [](uint32_t, uint32_t, int32_t) {})) continue;
      // An invalid code near the end of the data is a cut-off code.
      if (cursor_.bit + 32 > view_.data_bits)
        return fail(ErrorCode::kTruncated, stretch.marker_at, "the data end, expected more");
      const uint64_t at = unstuff(file_, first, nullptr, cursor_.bit / 8 - before).marker_at;
      return fail(ErrorCode::kFormat, at, "no Huffman code, or a coefficient past the 63rd");
    }
    data_bytes_ = (cursor_.bit + 7) / 8;
    dropped_bytes_ += end - data_bytes_;
    next_ = stretch.next;
    marker_ = stretch.marker;
    marker_at_ = stretch.marker_at;
    return {};
  }

  void add_anchor() {
    Anchor anchor{cursor_.bit, {}};
    for (uint32_t c = 0; c < kJpegMaxComponents; ++c) anchor.dc[c] = static_cast<int16_t>(cursor_.dc[c]);
    anchors_.push_back(anchor);
  }

  /// Checks the file from the scan's end to the end marker. Only another scan is an error.
  Result<void> check_rest() const {
    for (uint64_t at = marker_at_; at < file_.size();) {
      uint32_t marker;
      at = next_jpeg_marker(file_, at, marker);
      if (marker == 0 || marker == 0xd9) break;
      if (marker == 0xda) return Error{ErrorCode::kUnsupported, "JPEG: byte " + std::to_string(at) + ": a second scan"};
      if (marker == 1 || (marker >= 0xd0 && marker <= 0xd8)) continue;
      if (file_.size() - at < 2) break;
      at += static_cast<uint64_t>(file_[at]) << 8 | static_cast<uint64_t>(file_[at + 1]);
    }
    return {};
  }

  std::span<const std::byte> file_;
  uint64_t next_;
  JpegView view_;
  std::span<std::byte> out_;
  JpegCursor cursor_{};
  std::vector<Anchor> anchors_;
  uint64_t data_bytes_ = 0;
  uint64_t dropped_bytes_ = 0;
  uint32_t marker_ = 0;
  uint64_t marker_at_ = 0;
};

/// The tightest ranges of a block's groups. `word` stays unset.
JpegAnchorBlock block_of(std::span<const Anchor> anchors) {
  JpegAnchorBlock block{};
  block.bit = anchors.front().bit;
  block.bit_bits = static_cast<uint8_t>(std::bit_width(anchors.back().bit - block.bit));
  for (uint32_t c = 0; c < kJpegMaxComponents; ++c) {
    int32_t smallest = anchors[0].dc[c];
    int32_t largest = smallest;
    for (const Anchor& anchor : anchors) {
      smallest = std::min<int32_t>(smallest, anchor.dc[c]);
      largest = std::max<int32_t>(largest, anchor.dc[c]);
    }
    block.dc_min[c] = static_cast<int16_t>(smallest);
    block.dc_bits[c] = static_cast<uint8_t>(std::bit_width(static_cast<uint32_t>(largest - smallest)));
  }
  return block;
}

/// Appends codes of up to 32 bits to zeroed bytes, lowest bit first.
class BitWriter {
 public:
  explicit BitWriter(std::byte* at) : at_(at) {}

  void put(uint32_t code, uint32_t bits) {
    pending_ |= uint64_t{code} << fill_;
    fill_ += bits;
    if (fill_ >= 32) flush();
  }
  /// Fills up to the end of a 32-bit word with zeros.
  void align() {
    if (fill_ != 0) flush();
  }

 private:
  void flush() {
    store(at_, static_cast<uint32_t>(pending_));
    at_ += sizeof(uint32_t);
    pending_ >>= 32;
    fill_ = fill_ > 32 ? fill_ - 32 : 0;
  }

  std::byte* at_;
  uint64_t pending_ = 0;
  uint32_t fill_ = 0;  // below 32 between calls
};

/// Writes the two sections of anchors from `at` on and returns the words of the second.
uint32_t write_anchors(std::span<const Anchor> anchors, std::byte* at, uint64_t& end) {
  const uint64_t block_count = (anchors.size() + kJpegBlockGroups - 1) / kJpegBlockGroups;
  const uint64_t block_bytes = sizeof(JpegAnchorBlock) * block_count;
  std::byte* const packed = at + jpeg_section_bytes(block_bytes);
  std::memset(at + block_bytes, 0, jpeg_section_bytes(block_bytes) - block_bytes);
  BitWriter writer(packed);
  uint32_t words = 0;
  for (uint64_t i = 0; i < block_count; ++i) {
    const uint64_t first = i * kJpegBlockGroups;
    const auto groups = anchors.subspan(first, std::min<uint64_t>(kJpegBlockGroups, anchors.size() - first));
    JpegAnchorBlock block = block_of(groups);
    block.word = words;
    for (const Anchor& anchor : groups) {
      writer.put(static_cast<uint32_t>(anchor.bit - block.bit), block.bit_bits);
      for (uint32_t c = 0; c < kJpegMaxComponents; ++c)
        writer.put(static_cast<uint32_t>(anchor.dc[c] - block.dc_min[c]), block.dc_bits[c]);
    }
    writer.align();
    words += anchor_words(block, static_cast<uint32_t>(groups.size()));
    store(at + sizeof block * i, block);
  }
  const uint64_t packed_size = uint64_t{4} * words;
  std::memset(packed + packed_size, 0, jpeg_stream_bytes(packed_size) - packed_size);
  end = jpeg_section_bytes(block_bytes) + jpeg_stream_bytes(packed_size);
  return words;
}

void write_tables(std::span<std::byte> out, const Plan& plan, const JpegHeader& header) {
  std::byte* at = out.data() + plan.quant_at;
  for (const uint32_t number : plan.tables.quant) {
    std::memcpy(at, header.quant[number].data(), sizeof header.quant[number]);
    at += sizeof header.quant[number];
  }
  const auto write = [&](const JpegHuffmanSpec& spec) {
    std::memcpy(at, spec.counts.data(), spec.counts.size());
    at += spec.counts.size();
    std::memcpy(at, spec.symbols.data(), spec.symbol_count());
    at += spec.symbol_count();
  };
  for (const uint32_t number : plan.tables.dc) write(header.dc[number]);
  for (const uint32_t number : plan.tables.ac) write(header.ac[number]);
  std::memset(at, 0, static_cast<size_t>(out.data() + plan.data_at - at));
}

}  // namespace

Result<uint64_t> jpeg_index_bound(const JpegHeader& header, uint64_t file_bytes) {
  const auto plan = SCREE_TRY(make_plan(header));
  assert(header.data_offset <= file_bytes);
  const uint64_t data_bytes = file_bytes - header.data_offset;
  if (!jpeg_data_may_hold(plan.layout, data_bytes)) {
    return Error{ErrorCode::kTruncated, "JPEG: byte " + std::to_string(file_bytes) + ": the file ends after " +
                                            std::to_string(data_bytes) + " bytes of data, too few for " +
                                            std::to_string(plan.layout.mcu_count()) + " MCUs"};
  }
  const uint64_t block_count = plan.layout.anchor_block_count;
  return plan.data_at + jpeg_stream_bytes(data_bytes) + jpeg_section_bytes(sizeof(JpegAnchorBlock) * block_count) +
         jpeg_stream_bytes(4 * kMaxAnchorBits * block_count);
}

Result<JpegEncoded> encode_jpeg_index(std::span<std::byte> out, const JpegHeader& header,
                                      std::span<const std::byte> file) {
  [[maybe_unused]] const auto bound = SCREE_TRY(jpeg_index_bound(header, file.size()));
  assert(out.size() >= bound);
  const auto plan = SCREE_TRY(make_plan(header));

  JpegIndex index;  // only for its view
  index.restart_interval = header.restart_interval;
  index.component_count = header.component_count;
  index.components = plan.tables.components;
  index.layout = plan.layout;
  const auto add_table = [&](const JpegHuffmanSpec& spec, bool is_dc) -> Result<void> {
    const auto table = SCREE_TRY_AT("JPEG", make_jpeg_table(spec, is_dc));
    index.tables.push_back(table);
    (is_dc ? index.dc : index.ac).push_back(spec);
    return {};
  };
  for (const uint32_t number : plan.tables.dc) SCREE_TRY(add_table(header.dc[number], true));
  for (const uint32_t number : plan.tables.ac) SCREE_TRY(add_table(header.ac[number], false));

  ScanReader reader(file, header.data_offset, index.view(), out.subspan(plan.data_at));
  SCREE_TRY(reader.read());
  const uint64_t data_bytes = reader.data_bytes();
  std::memset(out.data() + plan.data_at + data_bytes, 0, jpeg_stream_bytes(data_bytes) - data_bytes);

  write_tables(out, plan, header);
  JpegEncoded encoded;
  encoded.dropped_bytes = reader.dropped_bytes();
  encoded.bytes = plan.data_at + jpeg_stream_bytes(data_bytes);
  uint64_t anchor_bytes;
  const uint32_t words = write_anchors(reader.anchors(), out.data() + encoded.bytes, anchor_bytes);
  encoded.bytes += anchor_bytes;

  JpegIndexHeader record{};
  std::memcpy(record.magic, kJpegIndexMagic, sizeof record.magic);
  record.version = kJpegIndexVersion;
  record.component_count = static_cast<uint8_t>(header.component_count);
  record.colour = static_cast<uint8_t>(header.colour);
  record.width = header.width;
  record.height = header.height;
  record.restart_interval = header.restart_interval;
  record.quant_count = static_cast<uint8_t>(plan.tables.quant.size());
  record.dc_count = static_cast<uint8_t>(plan.tables.dc.size());
  record.ac_count = static_cast<uint8_t>(plan.tables.ac.size());
  for (uint32_t i = 0; i < header.component_count; ++i) {
    const JpegComponent& from = plan.tables.components[i];
    record.components[i] = {from.h, from.v, from.quant, from.dc, from.ac, {}};
  }
  record.data_bytes = data_bytes;
  record.anchor_words = words;
  store(out.data(), record);
  return encoded;
}

}  // namespace scree::format
