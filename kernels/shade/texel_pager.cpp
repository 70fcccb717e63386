#include "kernels/shade/texel_pager.h"

#include <algorithm>
#include <bit>

namespace scree::kernels {
namespace {

/// Removes the upper half of a tile's pixels and returns them. It has at least two.
UnfinishedTile split(UnfinishedTile& tile) {
  UnfinishedTile rest = tile;
  for (int count = std::popcount(tile.pixels) / 2; count > 0; --count) rest.pixels &= rest.pixels - 1;
  tile.pixels &= ~rest.pixels;
  return rest;
}

}  // namespace

Result<void> shade_in_rounds(TexelPager& pager, uint32_t tile_count,
                             const std::function<uint32_t(std::span<const UnfinishedTile>, UnfinishedTile*)>& shade) {
  const std::lock_guard<std::mutex> lock(pager.mutex());
  std::vector<UnfinishedTile> waiting(tile_count);  // the next one last
  for (uint32_t i = 0; i < tile_count; ++i) waiting[i] = {tile_count - 1 - i, ~uint32_t{0}};
  std::vector<UnfinishedTile> tiles;
  std::vector<UnfinishedTile> left;
  size_t count = tile_count;  // of tiles that are shaded at a time
  while (!waiting.empty()) {
    count = std::min(count, waiting.size());
    tiles.assign(waiting.rbegin(), waiting.rbegin() + static_cast<ptrdiff_t>(count));
    waiting.resize(waiting.size() - count);
    left.resize(count);
    pager.begin_round();
    left.resize(shade(tiles, left.data()));
    if (left.empty()) {
      count *= 2;
      continue;
    }
    const bool is_pixel = left.size() == 1 && std::has_single_bit(left.front().pixels);
    const Result<bool> fits = pager.bring(is_pixel);
    if (!fits) return fits.error();
    // Threads list tiles in any order. Neighbours show the same pages.
    std::sort(left.begin(), left.end(), [](const auto& a, const auto& b) { return a.tile > b.tile; });
    count = left.size();
    if (!*fits && count == 1) left.insert(left.begin(), split(left.front()));
    if (!*fits) count = (count + 1) / 2;
    waiting.insert(waiting.end(), left.begin(), left.end());
  }
  return {};
}

}  // namespace scree::kernels
