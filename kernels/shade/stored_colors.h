// Pictures of scenes whose chunks are not all present at once. Samples are shaded while their chunk is present, and
// their colours are kept until the picture is complete.
#pragma once

#include "kernels/shade/pixels.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

/// Shades the samples whose triangle's chunk has its page, one tile of samples per item. Keeps the colours of all other
/// samples.
template <class ShaderOfPart>
struct ShadePart {
  using Shader = ShaderOfPart;

  Shader shader;
  PixelTiles tiles;         // tiles of samples
  const uint64_t* samples;  // the whole picture's
  float* colors;            // 3 per sample

  template <class Team>
  SCREE_HD void operator()(uint32_t item, Team team) const {
    ShadeState<Team, Shader> state;
    tiles.for_each(item, team, [&](uint32_t x, uint32_t y, bool inside) { finish(team, x, y, inside, state); });
  }

  /// One sample, in the form of Resolve::finish() for a pixel.
  template <class Team>
  SCREE_HD void finish(Team team, uint32_t x, uint32_t y, bool inside, ShadeState<Team, Shader>& state) const {
    const SceneView& scene = shader.in.scene;
    const uint64_t place = uint64_t{y} * tiles.width + x;
    const uint64_t sample = inside ? samples[place] : kBackground;
    const bool covered = sample != kBackground;
    locate(team, scene, sample_id(sample), covered, state.at);
    const bool there = covered && scene.pages[scene.chunks[state.at.chunk].page] != nullptr;
    float color[3];
    shader(team, there, sample, static_cast<int32_t>(x), static_cast<int32_t>(y), state, color);
    if (!there) return;
    if constexpr (Shader::Texels::kMayMiss)
      if (state.texels.missed) return;
    for (int c = 0; c < 3; ++c) colors[3 * place + static_cast<uint64_t>(c)] = color[c];
  }
};

/// Takes a Shader's place: returns the colours that ShadePart stored.
struct StoredColors {
  using Texels = SceneTexels;

  ShadeInputs in;
  const float* colors;

  template <class Team, class State>
  SCREE_HD void operator()(Team, bool wanted, uint64_t, int32_t x, int32_t y, State&, float rgb[3]) const {
    if (!wanted) return;
    const uint64_t place = place_of(x, y);
    for (uint64_t c = 0; c < 3; ++c) rgb[c] = colors[3 * place + c];
  }

 protected:
  SCREE_HD uint64_t place_of(int32_t x, int32_t y) const {
    return static_cast<uint64_t>(y) * static_cast<uint64_t>(in.view.width) + static_cast<uint64_t>(x);
  }
};

/// The same, with the layers that Resolve lays over these colours.
struct BlendedColors : StoredColors {
  const float* over;  // BlendTargets::over

  SCREE_HD const float* over_at(uint32_t x, uint32_t y) const {
    return over + 4 * place_of(static_cast<int32_t>(x), static_cast<int32_t>(y));
  }
};

}  // namespace SCREE_ISA
}  // namespace scree::kernels
