#include "runtime/images/basis/uastc.h"

#include <algorithm>
#include <array>

#include "format/bytes.h"

namespace scree::runtime {
namespace {

constexpr uint32_t kErrorColor = 0xffff00ff;  // 255, 0, 255, 255
constexpr uint32_t kSolidMode = 8;
constexpr uint32_t kModes = 19;

/// The possible values of endpoints: `base` digits (1 none, 3 trits, 5 quints) times 2^bits.
struct Range {
  uint32_t base;
  uint32_t bits;
};
enum RangeName : uint8_t { k12, k16, k32, k40, k48, k160, k192, k256, kRanges };
constexpr Range kRangeOf[kRanges] = {{3, 2}, {1, 4}, {1, 5}, {5, 3}, {3, 4}, {5, 5}, {3, 6}, {1, 8}};

struct Mode {
  uint8_t code;  // the block's lowest bits
  uint8_t code_bits;
  uint8_t hint_bits;  // after the code, for transcoders to other formats
  uint8_t pattern_bits;
  uint8_t subsets;
  uint8_t channels;  // of the endpoints: 2 (grey and alpha), 3 or 4
  RangeName range;
  uint8_t weight_bits;
  bool is_dual;  // one channel has weights of its own
};
constexpr Mode kModeOf[kModes] = {
    {0x01, 4, 15, 0, 1, 3, k192, 4, false}, {0x35, 6, 15, 0, 1, 3, k256, 2, false},
    {0x1d, 5, 15, 5, 2, 3, k16, 3, false},  {0x03, 5, 15, 4, 3, 3, k12, 2, false},
    {0x13, 5, 15, 5, 2, 3, k40, 2, false},  {0x0b, 5, 15, 0, 1, 3, k256, 3, false},
    {0x1b, 5, 15, 0, 1, 3, k160, 2, true},  {0x07, 5, 15, 5, 2, 3, k40, 2, false},
    {0x17, 5, 0, 0, 0, 0, k256, 0, false},  {0x0f, 5, 23, 5, 2, 4, k16, 2, false},
    {0x02, 3, 17, 0, 1, 4, k48, 4, false},  {0x00, 2, 17, 0, 1, 4, k48, 2, true},
    {0x06, 3, 17, 0, 1, 4, k192, 3, false}, {0x1f, 5, 23, 0, 1, 4, k256, 1, true},
    {0x0d, 5, 23, 0, 1, 4, k256, 2, false}, {0x05, 7, 23, 0, 1, 2, k256, 4, false},
    {0x15, 6, 23, 5, 2, 2, k256, 2, false}, {0x25, 6, 23, 0, 1, 2, k256, 2, true},
    {0x09, 4, 15, 0, 1, 3, k32, 5, false},
};

/// The mode, by a block's 7 lowest bits; kModes for the reserved code.
constexpr auto kModeOfCode = [] {
  std::array<uint8_t, 128> modes{};
  modes.fill(kModes);
  for (uint32_t mode = 0; mode < kModes; ++mode)
    for (uint32_t code = kModeOf[mode].code; code < 128; code += 1u << kModeOf[mode].code_bits)
      modes[code] = static_cast<uint8_t>(mode);
  return modes;
}();

/// Endpoints of 0 to 255, by digit << bits | bits. Source: section "Endpoint Unquantization" of ASTC.
constexpr auto kEndpoint = [] {
  std::array<std::array<uint8_t, 256>, kRanges> values{};
  for (uint32_t r = 0; r < kRanges; ++r) {
    const auto [base, bits] = kRangeOf[r];
    for (uint32_t code = 0; code < base << bits; ++code) {
      if (base == 1) {
        values[r][code] = static_cast<uint8_t>((code << (8 - bits)) | code >> (bits == 8 ? 8 : 2 * bits - 8));
        continue;
      }
      const uint32_t high = (code & ((1u << bits) - 1)) >> 1, sign = code % 2 * 0x1ff;
      const uint32_t b = r == k12    ? high * 0x116
                         : r == k40  ? high << 7 | high << 1 | high >> 1
                         : r == k48  ? high << 6 | high
                         : r == k160 ? high << 5 | high >> 3
                                     : high << 4 | high >> 4;
      const uint32_t c = r == k12 ? 93 : r == k40 ? 26 : r == k48 ? 22 : r == k160 ? 6 : 5;
      values[r][code] = static_cast<uint8_t>((sign & 0x80) | ((((code >> bits) * c + b) ^ sign) >> 2));
    }
  }
  return values;
}();

/// Weights of 0 to 64, by their number of bits.
constexpr auto kWeight = [] {
  std::array<std::array<uint8_t, 32>, 6> weights{};
  for (uint32_t bits = 1; bits < 6; ++bits)
    for (uint32_t code = 0; code < 1u << bits; ++code) {
      uint32_t weight = 0;
      for (uint32_t filled = 0; filled < 6; filled += bits) weight = weight << bits | code;
      weight >>= (6 + bits - 1) / bits * bits - 6;
      weights[bits][code] = static_cast<uint8_t>(weight + (weight > 32));
    }
  return weights;
}();

/// The subset of each texel: a bit per texel, two for mode 3; texel 0 lowest. Source: the specification's partition
/// tables.
constexpr uint32_t kPatterns[30] = {0xcccc, 0x8888, 0x1111, 0xecc8, 0x377f, 0xfeec, 0x0137, 0x137f, 0xc800, 0x0013,
                                    0xfe80, 0x17ff, 0x0017, 0x00ff, 0xfff0, 0x0fff, 0xff71, 0x8eff, 0x08ce, 0x008c,
                                    0x7310, 0xceff, 0x7331, 0x088c, 0xceef, 0x6666, 0xf00f, 0x5555, 0x0f0f, 0x36c9};
constexpr uint32_t kPatterns7[19] = {0x00f0, 0x4444, 0x0133, 0xcc80, 0xf0ff, 0x2222, 0xffc8, 0xccce, 0x3c03, 0x00ee,
                                     0x7700, 0x3003, 0x00ce, 0xff80, 0x6fff, 0x1333, 0x11ff, 0x136c, 0x00ef};
constexpr uint32_t kPatterns3[11] = {0xa5a50000, 0xaa005555, 0xaa000055, 0x0000aa55, 0x25252525, 0x94949494,
                                     0x58585858, 0x56560202, 0x92929292, 0x55aa0055, 0xa05050a0};

std::span<const uint32_t> patterns_of(uint32_t mode) {
  if (mode == 3) return kPatterns3;
  if (mode == 7) return kPatterns7;
  return kPatterns;
}

/// A block's bits, lowest first.
struct Bits {
  uint64_t low;
  uint64_t high;

  /// `count`: 0 to 63.
  uint32_t take(uint32_t count) {
    const uint64_t taken = low & ((uint64_t{1} << count) - 1);
    low = low >> count | high << 1 << (63 - count);
    high >>= count;
    return static_cast<uint32_t>(taken);
  }
};

/// Four channels of 16 bits, red lowest.
using Lanes = uint64_t;
constexpr Lanes kEachLane = 0x0001000100010001;

struct Endpoints {
  Lanes low;
  Lanes high;
};

std::array<Endpoints, 3> take_endpoints(const Mode& mode, Bits& bits) {
  const uint32_t base = kRangeOf[mode.range].base, value_bits = kRangeOf[mode.range].bits;
  const uint32_t count = 2u * mode.channels * mode.subsets;
  std::array<uint8_t, 18> values{};
  if (base != 1) {  // 5 trits take 8 bits, 3 quints 7; a shorter last group takes fewer
    constexpr uint32_t kTritBits[] = {0, 2, 4, 5, 7, 8};
    const uint32_t digits = base == 3 ? 5 : 3;
    for (uint32_t i = 0; i < count; i += digits) {
      const uint32_t here = std::min(digits, count - i);
      uint32_t packed = bits.take(base == 3 ? kTritBits[here] : 7);
      for (uint32_t k = 0; k < here; ++k, packed /= base)
        values[i + k] = static_cast<uint8_t>(packed % base << value_bits);
    }
  }
  std::array<Endpoints, 3> endpoints{};
  const uint8_t* value = values.data();
  const auto next = [&]() -> Lanes { return kEndpoint[mode.range][*value++ | bits.take(value_bits)]; };
  for (uint32_t s = 0; s < mode.subsets; ++s) {
    auto& [low, high] = endpoints[s];
    if (mode.channels == 2) {
      low = next() * (kEachLane >> 16);
      high = next() * (kEachLane >> 16);
    } else {
      for (uint32_t c = 0; c < 3; ++c) {
        low |= next() << 16 * c;
        high |= next() << 16 * c;
      }
    }
    low |= (mode.channels == 3 ? 255 : next()) << 48;
    high |= (mode.channels == 3 ? 255 : next()) << 48;
  }
  return endpoints;
}

/// The weighted mean of two endpoints of 8 bits. The specification widens them to 16 bits, a factor of 257, and rounds
/// once: with s = low * (64 - weight) + high * weight, (257 s + 32) >> 14, which is (s + ((s + 32) >> 8)) >> 6.
Lanes mix(const Endpoints& ends, uint32_t weight) {
  constexpr Lanes kByte = 255 * kEachLane;
  const Lanes sum = ends.low * (64 - weight) + ends.high * weight;  // at most 255 * 64 per lane
  return ((sum + ((sum + 32 * kEachLane) >> 8 & kByte)) >> 6) & kByte;
}

uint32_t pack(Lanes lanes) {
  lanes = (lanes | lanes >> 8) & 0x0000ffff0000ffff;
  return static_cast<uint32_t>(lanes | lanes >> 16);
}

}  // namespace

void decode_uastc_block(const std::byte* block, std::span<uint32_t, 16> texels) {
  const auto fill = [&](uint32_t color) { std::ranges::fill(texels, color); };
  Bits bits{format::load<uint64_t>(block), format::load<uint64_t>(block + 8)};
  const uint32_t number = kModeOfCode[bits.low & 127];
  if (number == kModes) return fill(kErrorColor);
  const Mode& mode = kModeOf[number];
  bits.take(mode.code_bits);
  if (number == kSolidMode) return fill(bits.take(32));
  bits.take(mode.hint_bits);
  uint32_t pattern = 0;
  if (mode.pattern_bits != 0) {
    const auto patterns = patterns_of(number);
    const uint32_t index = bits.take(mode.pattern_bits);
    if (index >= patterns.size()) return fill(kErrorColor);
    pattern = patterns[index];
  }
  // The channel with weights of its own: alpha if there is no field.
  const uint32_t channel = mode.is_dual && mode.channels != 2 ? bits.take(2) : 3;
  const Lanes second = mode.is_dual ? Lanes{0xffff} << 16 * channel : 0;
  const std::array<Endpoints, 3> endpoints = take_endpoints(mode, bits);
  const auto& weights = kWeight[mode.weight_bits];
  uint32_t seen = 0;  // subsets; the first texel of each has a weight without its highest bit
  for (uint32_t& texel : texels) {
    const uint32_t subset = pattern & (mode.subsets == 3 ? 3 : 1);
    pattern >>= mode.subsets == 3 ? 2 : 1;
    const uint32_t count = mode.weight_bits - (~seen >> subset & 1);
    seen |= 1u << subset;
    Lanes lanes = mix(endpoints[subset], weights[bits.take(count)]);
    if (mode.is_dual) lanes = (lanes & ~second) | (mix(endpoints[subset], weights[bits.take(count)]) & second);
    texel = pack(lanes);
  }
}

}  // namespace scree::runtime
