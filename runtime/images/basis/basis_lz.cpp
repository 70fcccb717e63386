#include "runtime/images/basis/basis_lz.h"

#include <algorithm>
#include <cstring>
#include <string>
#include <utility>

namespace scree::runtime {
namespace {

constexpr uint32_t kMaxCodeBits = 16;

/// Bits of a stream, lowest first. Past the end they are 0, and the stream has failed.
class BitReader {
 public:
  explicit BitReader(std::span<const std::byte> bytes) : bytes_(bytes) {}

  /// `count`: at most 32.
  uint32_t take(uint32_t count) {
    while (held_ < count) {
      if (next_ < bytes_.size())
        buffer_ |= uint64_t{static_cast<uint8_t>(bytes_[next_++])} << held_;
      else
        has_failed_ = true;
      held_ += 8;
    }
    const uint64_t taken = buffer_ & ((uint64_t{1} << count) - 1);
    buffer_ >>= count;
    held_ -= count;
    return static_cast<uint32_t>(taken);
  }

  /// A symbol; fails if no code matches the next bits.
  uint32_t take(const HuffmanCode& code) {
    int32_t value = 0, first = 0, index = 0;
    for (uint32_t length = 1; length <= kMaxCodeBits; ++length) {
      value |= static_cast<int32_t>(take(1));
      const int32_t count = code.counts[length];
      if (value - first < count) return code.symbols[static_cast<size_t>(index + value - first)];
      index += count;
      first = (first + count) << 1;
      value <<= 1;
    }
    has_failed_ = true;
    return 0;
  }

  /// A number in groups of `bits` bits, lowest first, each followed by a bit that is 1 if another group follows.
  uint32_t take_groups(uint32_t bits) {
    uint64_t number = 0;
    for (uint32_t shift = 0; shift < 32; shift += bits) {
      const uint32_t group = take(bits + 1);
      number |= uint64_t{group & ((1u << bits) - 1)} << shift;
      if (group >> bits == 0) return static_cast<uint32_t>(std::min<uint64_t>(number, 0xffffff00));
    }
    has_failed_ = true;
    return 0;
  }

  void fail() { has_failed_ = true; }
  bool has_failed() const { return has_failed_; }

 private:
  std::span<const std::byte> bytes_;
  size_t next_ = 0;
  uint64_t buffer_ = 0;
  uint32_t held_ = 0;
  bool has_failed_ = false;
};

/// The code with these lengths per symbol; 0: the symbol is not used. Fails if there are more codes than lengths allow.
HuffmanCode make_code(std::span<const uint8_t> lengths, BitReader& bits) {
  HuffmanCode code;
  for (const uint8_t length : lengths) ++code.counts[length];
  code.counts[0] = 0;
  std::array<uint32_t, kMaxCodeBits + 2> places{};
  int32_t left = 1;
  for (uint32_t length = 1; length <= kMaxCodeBits; ++length) {
    left = 2 * left - code.counts[length];
    if (left < 0) {
      bits.fail();
      return {};
    }
    places[length + 1] = places[length] + code.counts[length];
  }
  code.symbols.resize(places[kMaxCodeBits + 1]);
  for (size_t symbol = 0; symbol < lengths.size(); ++symbol)
    if (lengths[symbol] != 0) code.symbols[places[lengths[symbol]]++] = static_cast<uint16_t>(symbol);
  return code;
}

/// Reads a code from the stream: its lengths, which are coded by another code.
HuffmanCode take_code(BitReader& bits) {
  constexpr uint8_t kOrder[] = {17, 18, 19, 20, 0, 8, 7, 9, 6, 10, 5, 11, 4, 12, 3, 13, 2, 14, 1, 15, 16};
  enum : uint32_t { kShortZeros = 17, kLongZeros, kShortRepeat, kLongRepeat };
  std::vector<uint8_t> lengths(bits.take(14));
  if (lengths.empty()) return {};  // the code is not used
  const uint32_t count = bits.take(5);
  std::array<uint8_t, std::size(kOrder)> small{};
  if (count > small.size()) bits.fail();
  for (uint32_t i = 0; i < count && !bits.has_failed(); ++i) small[kOrder[i]] = static_cast<uint8_t>(bits.take(3));
  const HuffmanCode code = make_code(small, bits);
  for (size_t i = 0; i < lengths.size() && !bits.has_failed();) {
    const uint32_t symbol = bits.take(code);
    if (symbol < kShortZeros) {
      lengths[i++] = static_cast<uint8_t>(symbol);
      continue;
    }
    const uint32_t run = symbol == kShortZeros    ? 3 + bits.take(3)
                         : symbol == kLongZeros   ? 11 + bits.take(7)
                         : symbol == kShortRepeat ? 3 + bits.take(2)
                                                  : 7 + bits.take(7);
    const bool repeats = symbol >= kShortRepeat;
    if (run > lengths.size() - i || (repeats && (i == 0 || lengths[i - 1] == 0))) {
      bits.fail();
      break;
    }
    std::fill_n(lengths.begin() + static_cast<ptrdiff_t>(i), run, repeats ? lengths[i - 1] : uint8_t{0});
    i += run;
  }
  return bits.has_failed() ? HuffmanCode{} : make_code(lengths, bits);
}

/// The four colours of an ETC1S block: a base colour of 5 bits per channel plus a modifier, clamped.
std::array<uint32_t, 4> block_colors(const std::array<uint32_t, 3>& base, uint32_t table) {
  constexpr int32_t kNear[] = {2, 5, 9, 13, 18, 24, 33, 47}, kFar[] = {8, 17, 29, 42, 60, 80, 106, 183};
  const int32_t modifiers[] = {-kFar[table], -kNear[table], kNear[table], kFar[table]};
  std::array<uint32_t, 4> colors{};
  for (uint32_t i = 0; i < 4; ++i) {
    colors[i] = 0xff000000;
    for (uint32_t c = 0; c < 3; ++c) {
      const auto wide = static_cast<int32_t>(base[c] << 3 | base[c] >> 2);
      colors[i] |= static_cast<uint32_t>(std::clamp(wide + modifiers[i], 0, 255)) << 8 * c;
    }
  }
  return colors;
}

std::vector<std::array<uint32_t, 4>> take_colors(uint32_t count, BitReader& bits) {
  std::array<HuffmanCode, 3> deltas;  // for previous values of 0 to 9, 10 to 21, 22 to 31
  for (HuffmanCode& code : deltas) code = take_code(bits);
  const HuffmanCode tables = take_code(bits);
  const bool is_grey = bits.take(1) != 0;
  std::vector<std::array<uint32_t, 4>> colors;
  std::array<uint32_t, 3> base{16, 16, 16};
  uint32_t table = 0;
  while (colors.size() < count && !bits.has_failed()) {
    table = (table + bits.take(tables)) & 7;
    for (uint32_t c = 0; c < (is_grey ? 1 : 3); ++c)
      base[c] = (base[c] + bits.take(deltas[base[c] < 10 ? 0 : base[c] < 22 ? 1 : 2])) & 31;
    if (is_grey) base[1] = base[2] = base[0];
    colors.push_back(block_colors(base, table));
  }
  return colors;
}

std::vector<uint32_t> take_selectors(uint32_t count, BitReader& bits) {
  std::vector<uint32_t> selectors;
  if (bits.take(2) != 0) bits.fail();  // reserved
  const bool is_plain = bits.take(1) != 0;
  const HuffmanCode deltas = is_plain ? HuffmanCode{} : take_code(bits);
  while (selectors.size() < count && !bits.has_failed()) {
    uint32_t selector = 0;
    if (is_plain || selectors.empty()) {
      selector = bits.take(32);
    } else {
      for (uint32_t row = 0; row < 4; ++row) selector |= (bits.take(deltas) & 255) << 8 * row;
      selector ^= selectors.back();
    }
    selectors.push_back(selector);
  }
  return selectors;
}

/// Selectors that were used lately; frequent ones move to the front.
class History {
 public:
  explicit History(uint32_t size) : values_(size), next_(size / 2) {}

  void add(uint32_t value) {
    if (values_.empty()) return;
    values_[next_] = value;
    if (++next_ == values_.size()) next_ = values_.size() / 2;
  }
  /// `index`: below the size.
  uint32_t use(uint32_t index) {
    const uint32_t value = values_[index];
    std::swap(values_[index], values_[index / 2]);
    return value;
  }

 private:
  std::vector<uint32_t> values_;
  size_t next_;
};

Error malformed(const std::string& part) {
  return {ErrorCode::kFormat, "BasisLZ: " + part};
}

}  // namespace

Result<BasisLz> BasisLz::open(const BasisLzHead& head, std::span<const std::byte> bytes) {
  BasisLz opened;
  BitReader colors(bytes.first(head.color_bytes));
  opened.colors_ = take_colors(head.colors, colors);
  if (colors.has_failed()) return malformed("its codebook of colours is malformed");
  BitReader selectors(bytes.subspan(head.color_bytes, head.selector_bytes));
  opened.selectors_ = take_selectors(head.selectors, selectors);
  if (selectors.has_failed()) return malformed("its codebook of selectors is malformed");
  BitReader tables(bytes.last(head.table_bytes));
  opened.predictions_ = take_code(tables);
  opened.color_deltas_ = take_code(tables);
  opened.selector_code_ = take_code(tables);
  opened.run_lengths_ = take_code(tables);
  opened.history_size_ = tables.take(13);
  if (tables.has_failed()) return malformed("its Huffman tables are malformed");
  return opened;
}

Result<void> BasisLz::decode(std::span<const std::byte> slice, bool is_alpha, uint32_t width, uint32_t height,
                             std::span<std::byte> pixels) const {
  enum : uint32_t { kLeft, kAbove, kAboveLeft };  // the block that gives the colours; otherwise a delta follows
  constexpr uint32_t kRepeat = 256, kLongRun = 63;
  const uint32_t columns = (width + 3) / 4, rows = (height + 3) / 4;
  const auto color_count = static_cast<uint32_t>(colors_.size());
  const auto selector_count = static_cast<uint32_t>(selectors_.size());
  BitReader bits(slice);
  History history(history_size_);
  std::vector<uint32_t> above(columns);                  // the colours of the row above, and those of this row so far
  std::vector<uint32_t> predictions((columns + 1) / 2);  // 2 bits for each of 2 x 2 blocks
  uint32_t color = 0, prediction = 0, repeats = 0, run = 0;
  for (uint32_t y = 0; y < rows; ++y) {
    uint32_t above_left = 0;
    for (uint32_t x = 0; x < columns; ++x) {
      uint32_t& four = predictions[x / 2];
      if (x % 2 == 0 && y % 2 == 0) {
        if (repeats != 0) {
          --repeats;
        } else if (const uint32_t symbol = bits.take(predictions_); symbol == kRepeat) {
          repeats = bits.take_groups(4) + 2;  // after this one
        } else {
          prediction = symbol;
        }
        four = prediction;
      }
      const uint32_t source = four >> (y % 2 * 4 + x % 2 * 2) & 3;
      bool is_valid = true;
      if (source == kLeft) {
        is_valid = x != 0;
      } else if (source == kAbove) {
        is_valid = y != 0;
        color = above[x];
      } else if (source == kAboveLeft) {
        is_valid = x != 0 && y != 0;
        color = above_left;
      } else {
        color += bits.take(color_deltas_);
        if (color >= color_count) color -= color_count;
      }
      above_left = std::exchange(above[x], color);

      uint32_t selector = selector_count;
      if (run != 0) {
        --run;
      } else if (selector = bits.take(selector_code_); selector == selector_count + history_size_) {
        run = bits.take(run_lengths_);
        run = (run == kLongRun ? bits.take_groups(7) : run) + 2;  // after this one
        selector = selector_count;
      }
      if (selector < selector_count) {
        history.add(selector);
      } else if (selector - selector_count < history_size_) {
        selector = history.use(selector - selector_count);
      }
      if (!is_valid || color >= color_count || selector >= selector_count || bits.has_failed())
        return malformed("block " + std::to_string(x) + ", " + std::to_string(y) + " of a slice is malformed");

      const std::array<uint32_t, 4>& colors = colors_[color];
      uint32_t chosen = selectors_[selector];
      const uint32_t across = std::min(4u, width - 4 * x);
      for (uint32_t j = 0; j < std::min(4u, height - 4 * y); ++j, chosen >>= 8) {
        std::byte* row = pixels.data() + 4 * (uint64_t{width} * (4 * y + j) + 4 * x);
        const uint32_t texels[] = {colors[chosen & 3], colors[chosen >> 2 & 3], colors[chosen >> 4 & 3],
                                   colors[chosen >> 6 & 3]};
        if (!is_alpha) std::memcpy(row, texels, 4 * across);
        for (uint32_t i = 0; is_alpha && i < across; ++i) row[4 * i + 3] = static_cast<std::byte>(texels[i] >> 8);
      }
    }
  }
  if (repeats != 0 || run != 0) return malformed("a run goes on after the last block of a slice");
  return {};
}

}  // namespace scree::runtime
