#include "tools/synth/block_encoder.h"

#include <algorithm>
#include <utility>

#include "format/bytes.h"

namespace scree::synth {
namespace {

/// The step of `value`, rounded, where `steps` equal steps go from `low` to `high`.
uint32_t step_of(int value, int low, int high, int steps) {
  if (high <= low) return 0;
  return static_cast<uint32_t>(std::clamp((2 * (value - low) * steps + (high - low)) / (2 * (high - low)), 0, steps));
}

/// Appends up to 128 bits, in order.
class Bits {
 public:
  void put(uint64_t value, uint32_t count) {
    words_[at_ / 64] |= value << at_ % 64;
    if (at_ % 64 + count > 64) words_[1] |= value >> (64 - at_ % 64);
    at_ += count;
  }
  void store(std::byte* out) const {
    format::store(out, words_[0]);
    format::store(out + 8, words_[1]);
  }

 private:
  uint64_t words_[2] = {0, 0};
  uint32_t at_ = 0;
};

}  // namespace

void encode_bc4(const BlockTexels& texels, uint32_t channel, std::byte* out) {
  int low = 255, high = 0;
  for (const auto& texel : texels) {
    low = std::min<int>(low, texel[channel]);
    high = std::max<int>(high, texel[channel]);
  }
  // If the larger end is first there are eight values: code 0 is the first end, 1 the second, and 2 to 7 lie between
  // them.
  uint64_t block = static_cast<uint64_t>(high) | static_cast<uint64_t>(low) << 8;
  for (uint32_t i = 0; i < 16 && low != high; ++i) {
    const uint32_t down = 7 - step_of(texels[i][channel], low, high, 7);
    const uint64_t code = down == 0 ? 0 : down == 7 ? 1 : down + 1;
    block |= code << (16 + 3 * i);
  }
  format::store(out, block);
}

void encode_bc5(const BlockTexels& texels, std::byte* out) {
  encode_bc4(texels, 0, out);
  encode_bc4(texels, 1, out + 8);
}

void encode_bc7(const BlockTexels& texels, std::byte* out) {
  const auto luminance = [](const std::array<uint8_t, 4>& texel) {
    return 2 * texel[0] + 4 * texel[1] + texel[2] + 4 * texel[3];
  };
  const auto [least, largest] = std::minmax_element(
      texels.begin(), texels.end(), [&](const auto& a, const auto& b) { return luminance(a) < luminance(b); });
  std::array<uint8_t, 4> first = *least, second = *largest;
  const int low = luminance(first), high = luminance(second);
  uint32_t codes[16];
  for (uint32_t i = 0; i < 16; ++i) codes[i] = step_of(luminance(texels[i]), low, high, 15);
  if (codes[0] >= 8) {  // the top bit of the first texel's code is not stored and must be 0
    std::swap(first, second);
    for (uint32_t& code : codes) code = 15 - code;
  }
  Bits bits;
  bits.put(1 << 6, 7);
  for (size_t c = 0; c < 4; ++c) {
    bits.put(first[c] >> 1, 7);
    bits.put(second[c] >> 1, 7);
  }
  bits.put(first[3] & 1, 1);  // the lowest bit of all channels is that of alpha, so that opaque stays opaque
  bits.put(second[3] & 1, 1);
  for (uint32_t i = 0; i < 16; ++i) bits.put(codes[i], i == 0 ? 3 : 4);
  bits.store(out);
}

}  // namespace scree::synth
