#include "kernels/shade/texel_pager.h"

#include <algorithm>
#include <bit>
#include <memory>
#include <vector>

namespace scree::kernels {
namespace {

/// Removes the upper half of a tile's pixels and returns them. Requires at least two pixels.
UnfinishedTile split(UnfinishedTile& tile) {
  UnfinishedTile rest = tile;
  for (int count = std::popcount(tile.pixels) / 2; count > 0; --count) rest.pixels &= rest.pixels - 1;
  tile.pixels &= ~rest.pixels;
  return rest;
}

using ShadeTiles = std::function<Result<uint32_t>(std::span<const UnfinishedTile>, UnfinishedTile*)>;

/// Shades `tiles` with the pages that are present, at most `most` at a time.
Result<void> shade_coarser(TexelPager& pager, std::span<const UnfinishedTile> tiles, size_t most,
                           UnfinishedTile* listed, const ShadeTiles& shade) {
  pager.begin_round();
  pager.take_coarser(true);
  Result<void> done;
  for (; done && !tiles.empty(); tiles = tiles.subspan(std::min(tiles.size(), most))) {
    const Result<uint32_t> unfinished = shade(tiles.first(std::min(tiles.size(), most)), listed);
    if (!unfinished) done = unfinished.error();
  }
  pager.take_coarser(false);
  return done;
}

}  // namespace

Result<void> shade_in_rounds(TexelPager& pager, uint32_t tile_count, const ShadeTiles& shade) {
  const std::lock_guard<std::mutex> lock(pager.mutex());
  std::vector<UnfinishedTile> waiting;                                               // the next one last
  std::vector<UnfinishedTile> tiles;                                                 // of a round; none: all
  const auto listed = std::make_unique_for_overwrite<UnfinishedTile[]>(tile_count);  // seldom written
  std::vector<UnfinishedTile> left;
  size_t count = tile_count;  // number of tiles that are shaded at a time
  const uint64_t first_round = pager.pages().round + 1;
  for (bool has_waited = false;; has_waited = true) {
    pager.begin_round();
    const uint32_t unfinished = SCREE_TRY(shade(tiles, listed.get()));
    left.assign(listed.get(), listed.get() + unfinished);
    if (left.empty()) {
      count *= 2;
    } else if (has_waited && pager.is_over()) {
      waiting.insert(waiting.end(), left.begin(), left.end());
      SCREE_TRY(shade_coarser(pager, waiting, tile_count, listed.get(), shade));
      return pager.count_missing(first_round);
    } else {
      const bool is_pixel = left.size() == 1 && std::has_single_bit(left.front().pixels);
      const bool fits = SCREE_TRY(pager.bring(is_pixel));
      // Threads list tiles in any order. Neighbours show the same pages.
      std::sort(left.begin(), left.end(), [](const auto& a, const auto& b) { return a.tile > b.tile; });
      count = left.size();
      if (!fits && count == 1) left.insert(left.begin(), split(left.front()));
      if (!fits) count = (count + 1) / 2;
      waiting.insert(waiting.end(), left.begin(), left.end());
    }
    if (waiting.empty()) return {};
    count = std::min({count, waiting.size(), size_t{tile_count}});  // halves of a tile are listed one by one
    tiles.assign(waiting.rbegin(), waiting.rbegin() + static_cast<ptrdiff_t>(count));
    waiting.resize(waiting.size() - count);
  }
}

}  // namespace scree::kernels
