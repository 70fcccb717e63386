// The resolve of pictures in rounds: their textures are decoded on demand (texture_cache.h), or read in pages
// (texel_pager.h).
#pragma once

#include "kernels/shade/pixels.h"
#include "kernels/shade/texture_cache.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

/// Rounds of shading: each shades the remaining pixels and decodes the groups that they lacked. A picture whose texels
/// are all in the cache takes one round, one whose texels fit takes two, a larger one more. Pixels left by the last
/// round decode for themselves (FallbackTexels).
inline constexpr uint32_t kDecodeRounds = 4;

/// Shades tiles whose pixels may lack texels, and lists the tiles with pixels that did. `Pixels`: Resolve, or
/// ShadePart, whose pixels are samples.
template <class Pixels>
struct ShadeRound {
  Pixels pixels;
  const UnfinishedTile* tiles;  // one per item; null: all tiles, all pixels
  UnfinishedTile* unfinished;   // room for all tiles; null if no texels can be missing
  RoundCounters* counters;

  /// `tiles` has as many entries as the previous round counted.
  template <class Team>
  SCREE_HD void operator()(uint32_t item, Team team) const {
    using Shader = typename Pixels::Shader;
    static_assert(Team::size() == 1 || Team::size() == kPixelTileSize);
    const UnfinishedTile own = tiles != nullptr ? tiles[item] : UnfinishedTile{item, ~uint32_t{0}};
    ShadeState<Team, Shader> state;
    uint32_t missed = 0;  // bit per pixel of this lane
    uint32_t bit = team.rank();
    pixels.tiles.for_each(own.tile, team, [&](uint32_t x, uint32_t y, bool inside) {
      const bool wanted = inside && (own.pixels >> bit & 1u) != 0;
      if constexpr (Shader::Texels::kMayMiss) state.texels.missed = false;
      pixels.finish(team, x, y, wanted, state);
      if constexpr (Shader::Texels::kMayMiss)
        if (wanted && state.texels.missed) missed |= 1u << bit;
      bit += team.size();
    });
    if constexpr (Shader::Texels::kMayMiss) {
      const uint32_t rest = Team::size() == 1 ? missed : team.ballot(missed != 0);
      if (rest != 0 && team.rank() == 0) unfinished[fetch_increment(&counters->tiles)] = {own.tile, rest};
    }
  }
};

/// Calls visit(shader) with the shader of a textured picture, whose options.show is Show::kTexture. `kApart`: as for
/// visit_kinds().
template <bool kApart, class Texels, class Visit>
inline void visit_textured(const ShadeInputs& in, const Texels& texels, const Visit& visit) {
  if (shades_surfaces(in.scene, in.options)) {
    in.view.orthographic ? visit(Shader<true, Show::kSurface, ChunkKinds::kMixed, Texels>{in, texels})
                         : visit(Shader<false, Show::kSurface, ChunkKinds::kMixed, Texels>{in, texels});
    return;
  }
  in.view.orthographic ? visit_kinds<kApart, true, Show::kTexture>(in, texels, visit)
                       : visit_kinds<kApart, false, Show::kTexture>(in, texels, visit);
}

}  // namespace SCREE_ISA
}  // namespace scree::kernels
