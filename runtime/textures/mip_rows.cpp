#include "runtime/textures/mip_rows.h"

#include <algorithm>
#include <bit>
#include <cassert>
#include <utility>

namespace scree::runtime {

uint32_t mip_level_count(uint32_t width, uint32_t height) {
  return static_cast<uint32_t>(std::bit_width(std::max({width, height, 1u})));
}

MipRows::MipRows(uint32_t width, uint32_t height, uint32_t last, Sink sink) : sink_(std::move(sink)) {
  assert(last < mip_level_count(width, height));
  for (uint32_t l = 0; l < last; ++l) {
    Level level;
    const uint32_t wide = std::max(1u, width >> l);
    level.across = make_taps(wide);
    level.down = make_taps(std::max(1u, height >> l));
    level.is_even = wide % 2 == 0;
    for (std::vector<Texel>& sum : level.sums) sum.assign(level.across.size(), Texel{});
    levels_.push_back(std::move(level));
  }
}

/// `size` texels become max(1, size / 2). Each new texel covers size / (size / 2) old ones, which is 1, 2 or, for an
/// odd size, 2 and a fraction.
std::vector<MipRows::Taps> MipRows::make_taps(uint32_t size) {
  const uint32_t half = std::max(1u, size / 2);
  std::vector<Taps> taps(half);
  for (uint32_t i = 0; i < half; ++i) {
    Taps& tap = taps[i];
    if (size == 1) {
      tap = {0, 1, {1.0f, 0.0f, 0.0f}};
    } else if (size % 2 == 0) {
      tap = {2 * i, 2, {0.5f, 0.5f, 0.0f}};
    } else {
      // In units of 1 / half texels the new texel spans [i * size, (i + 1) * size): all of 2i + 1, and parts of the two
      // neighbours of that texel.
      const auto whole = static_cast<float>(size);
      tap = {
          2 * i,
          3,
          {static_cast<float>(half - i) / whole, static_cast<float>(half) / whole, static_cast<float>(i + 1) / whole}};
    }
  }
  return taps;
}

/// Adds `weight` times a row of texels to a row of the next level.
void MipRows::add_row(const Level& level, const Texel* source, float weight, Texel* out) {
  if (level.is_even) {
    weight *= 0.5f;
    for (size_t x = 0; x < level.across.size(); ++x)
      for (size_t c = 0; c < 4; ++c) out[x][c] += weight * (source[2 * x][c] + source[2 * x + 1][c]);
    return;
  }
  for (size_t x = 0; x < level.across.size(); ++x) {
    const Taps& tap = level.across[x];
    for (uint32_t i = 0; i < tap.count; ++i)
      for (size_t c = 0; c < 4; ++c) out[x][c] += weight * tap.weight[i] * source[tap.first + i][c];
  }
}

void MipRows::push(uint32_t number, std::span<const Texel> row) {
  if (number == levels_.size()) return;
  Level& level = levels_[number];
  const uint32_t y = level.row++;
  // A row of an odd height belongs to two rows of the next level.
  for (uint32_t i = level.next; i < level.down.size() && level.down[i].first <= y; ++i) {
    const Taps& tap = level.down[i];
    std::vector<Texel>& sum = level.sums[i % 2];
    add_row(level, row.data(), tap.weight[y - tap.first], sum.data());
    if (y != tap.first + tap.count - 1) continue;
    ++level.next;
    sink_(number + 1, i, sum);
    push(number + 1, sum);
    std::fill(sum.begin(), sum.end(), Texel{});
  }
}

}  // namespace scree::runtime
