#include "runtime/texture.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <utility>

#include "runtime/srgb.h"

namespace scree::runtime {
namespace {

constexpr uint16_t kGlNearest = 9728;

/// Which texels of a row (or column) one texel of the next level covers, and by how much.
struct Taps {
  uint32_t first;
  uint32_t count;
  std::array<float, 3> weight;
};

/// `size` texels become max(1, size / 2): each covers size / (size / 2) of them, which is 1, 2 or (odd) 2 and a
/// fraction.
std::vector<Taps> make_taps(uint32_t size) {
  const uint32_t half = std::max(1u, size / 2);
  std::vector<Taps> taps(half);
  for (uint32_t i = 0; i < half; ++i) {
    Taps& tap = taps[i];
    if (size == 1) {
      tap = {0, 1, {1.0f, 0.0f, 0.0f}};
    } else if (size % 2 == 0) {
      tap = {2 * i, 2, {0.5f, 0.5f, 0.0f}};
    } else {
      // In units of 1 / half texels the new texel spans [i * size, (i + 1) * size): all of 2i + 1, and parts of its two
      // neighbours.
      const auto whole = static_cast<float>(size);
      tap = {
          2 * i,
          3,
          {static_cast<float>(half - i) / whole, static_cast<float>(half) / whole, static_cast<float>(i + 1) / whole}};
    }
  }
  return taps;
}

using Texel = std::array<float, 4>;  // linear colour, alpha / 255

void decode_row(const uint8_t* rgba, std::vector<Texel>& out) {
  const Srgb& srgb = Srgb::tables();
  for (size_t x = 0; x < out.size(); ++x, rgba += 4)
    out[x] = {srgb.linear(rgba[0]), srgb.linear(rgba[1]), srgb.linear(rgba[2]),
              static_cast<float>(rgba[3]) * (1.0f / 255.0f)};
}

void encode_texels(const std::vector<Texel>& texels, uint8_t* rgba) {
  const Srgb& srgb = Srgb::tables();
  for (const Texel& texel : texels) {
    for (size_t c = 0; c < 3; ++c) rgba[c] = srgb.code(texel[c]);
    rgba[3] = static_cast<uint8_t>(std::clamp(texel[3], 0.0f, 1.0f) * 255.0f + 0.5f);
    rgba += 4;
  }
}

/// Adds `weight` times a row of texels, each of `across` taps, to `out`.
void add_row(const Texel* source, const std::vector<Taps>& across, bool is_even, float weight, Texel* out) {
  if (is_even) {
    weight *= 0.5f;
    for (size_t x = 0; x < across.size(); ++x)
      for (size_t c = 0; c < 4; ++c) out[x][c] += weight * (source[2 * x][c] + source[2 * x + 1][c]);
    return;
  }
  for (size_t x = 0; x < across.size(); ++x) {
    const Taps& tap = across[x];
    for (uint32_t i = 0; i < tap.count; ++i)
      for (size_t c = 0; c < 4; ++c) out[x][c] += weight * tap.weight[i] * source[tap.first + i][c];
  }
}

/// The next level of `width` x `height` texels that `row(y)` gives row by row.
template <class Row>
std::vector<Texel> halve(uint32_t width, uint32_t height, const Row& row) {
  const std::vector<Taps> across = make_taps(width);
  const std::vector<Taps> down = make_taps(height);
  std::vector<Texel> half(across.size() * down.size());
  for (size_t y = 0; y < down.size(); ++y)
    for (uint32_t j = 0; j < down[y].count; ++j)
      add_row(row(down[y].first + j), across, width % 2 == 0, down[y].weight[j], half.data() + y * across.size());
  return half;
}

}  // namespace

MipChain make_mips(Image image) {
  assert(image.width >= 1 && image.height >= 1 && image.width <= kMaxDecodedSide && image.height <= kMaxDecodedSide);
  MipChain chain;
  chain.width = image.width;
  chain.height = image.height;
  uint64_t texels = 0;
  for (uint32_t level = 0;; ++level) {
    const uint32_t width = std::max(1u, image.width >> level);
    const uint32_t height = std::max(1u, image.height >> level);
    chain.level_offset[level] = texels;
    texels += uint64_t{width} * height;
    chain.level_count = level + 1;
    if (width == 1 && height == 1) break;
  }
  chain.texels = std::move(image.rgba);
  chain.texels.resize(4 * texels);

  std::vector<Texel> above;  // the level above in float; the first is decoded a row at a time instead
  std::vector<Texel> decoded_row(image.width);
  uint32_t decoded_y = ~0u;
  for (uint32_t level = 1; level < chain.level_count; ++level) {
    const uint32_t width = std::max(1u, image.width >> (level - 1));
    const uint32_t height = std::max(1u, image.height >> (level - 1));
    const auto row = [&](uint32_t y) -> const Texel* {
      if (level > 1) return above.data() + uint64_t{y} * width;
      if (y != decoded_y) {
        decode_row(chain.texels.data() + uint64_t{4} * width * y, decoded_row);
        decoded_y = y;
      }
      return decoded_row.data();
    };
    std::vector<Texel> half = halve(width, height, row);
    encode_texels(half, chain.texels.data() + 4 * chain.level_offset[level]);
    above = std::move(half);
  }
  return chain;
}

kernels::TextureView texture_view(const MipChain& chain, const format::TextureRecord& record) {
  kernels::TextureView view{};
  view.texels = chain.texels.data();
  std::copy(std::begin(chain.level_offset), std::end(chain.level_offset), std::begin(view.level_offset));
  view.width = chain.width;
  view.height = chain.height;
  view.level_count = chain.level_count;
  view.wrap_s = record.wrap_s;
  view.wrap_t = record.wrap_t;
  view.nearest = record.mag_filter == kGlNearest;
  return view;
}

}  // namespace scree::runtime
