// Blended surfaces, layer by layer from the nearest on: a layer has of every sample the nearest fragment behind the
// layer before and before the opaque picture. Source: spec/rasterization.md, blending.
#pragma once

#include "kernels/blend.h"
#include "kernels/raster/mask.h"
#include "kernels/shade/pixels.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

/// Samples per item of the passes over samples alone.
inline constexpr uint32_t kBlendItem = 1024;

SCREE_HD inline uint32_t blend_items(uint32_t sample_count) {
  return (sample_count + kBlendItem - 1) / kBlendItem;
}

/// Calls body(place) for the samples of an item.
template <class Team, class Body>
SCREE_HD inline void for_each_sample(uint32_t item, uint32_t sample_count, Team team, const Body& body) {
  static_assert(uint64_t{kMaxImageSide} * kMaxImageSide < 1u << 31);
  const uint32_t first = item * kBlendItem;
  const uint32_t end = min_of(first + kBlendItem, sample_count);
  for (uint32_t i = first + team.rank(); i < end; i += team.size()) body(i);
}

/// Before a layer is drawn. Where the layer before has nothing, no fragment is left: 0 hides all of them.
struct BeginLayer {
  BlendTargets at;
  bool is_first;

  template <class Team>
  SCREE_HD void operator()(uint32_t item, Team team) const {
    for_each_sample(item, at.sample_count, team, [&](uint32_t i) {
      at.drawn[i] = is_first || at.layer[i] != kBackground ? at.opaque[i] : 0;
      if (!is_first) return;
      for (uint32_t c = 0; c < 4; ++c) at.over[4 * uint64_t{i} + c] = c == 3 ? 1.0f : 0.0f;
    });
  }
};

/// After it is drawn: `layer` is what it shows. Adds the number of samples that show something to `count`.
struct EndLayer {
  BlendTargets at;
  bool is_first;
  uint64_t* count;

  template <class Team>
  SCREE_HD void operator()(uint32_t item, Team team) const {
    uint64_t shown = 0;
    for_each_sample(item, at.sample_count, team, [&](uint32_t i) {
      const uint64_t drawn = at.drawn[i];
      const bool shows = drawn != at.opaque[i] && (is_first || at.layer[i] != kBackground);
      at.layer[i] = shows ? drawn : kBackground;
      shown += shows ? 1 : 0;
    });
    if (shown != 0) team.add(count, shown);
  }
};

/// Lays the layer under those before. What nothing shines through ends there.
struct LayUnder {
  BlendTargets at;

  template <class Team>
  SCREE_HD void operator()(uint32_t item, Team team) const {
    for_each_sample(item, at.sample_count, team, [&](uint32_t i) {
      if (at.layer[i] == kBackground) return;
      float* const over = at.over + 4 * uint64_t{i};
      const float* const color = at.colors + 3 * uint64_t{i};
      const float share = over[3] * at.alphas[i];
      for (int c = 0; c < 3; ++c) over[c] = over[c] + share * color[c];
      over[3] = over[3] - share;
      if (!(over[3] > 0)) at.layer[i] = kBackground;
    });
  }
};

/// The alpha of a triangle's sample, in double but for its factors: the same on every machine.
template <bool kOrthographic>
SCREE_HD inline float blended_alpha(const SceneView& scene, const FrameView& view, const Transform& transform,
                                    uint64_t chunk_number, uint32_t triangle, int32_t x, int32_t y) {
  const format::ChunkRecord& chunk = scene.chunks[chunk_number];
  const format::MeshRecord& mesh = scene.meshes[chunk.mesh];
  float alpha = scene.materials[mesh.material].base_color[3];
  if ((mesh.attributes & format::kHasUv) != 0 && scene.blend_masks[mesh.material].alpha != nullptr) {
    MaskPlane plane;
    make_mask_plane<kOrthographic>(scene, view, transform, chunk_number, triangle, plane);
    alpha = alpha * (static_cast<float>(plane.alpha(x, y)) / static_cast<float>(format::kMaxMaskThreshold));
  }
  if ((mesh.attributes & format::kHasColor) != 0) {
    const PlacedChunk at = place_chunk<ChunkKinds::kMixed>(scene, chunk_number, triangle, transform);
    uint32_t vertex[3];
    fetch_triangle(at.reader, triangle, vertex);
    const auto center = [](int32_t place, float half) {
      return static_cast<double>(place) * kSubpixels + kSubpixels / 2 - static_cast<double>(half);
    };
    const PlaneHit<double> hit = intersect_plane<kOrthographic>(
        transform, fetch_corners<double>(at.reader, vertex), center(x, view.half_width), center(y, view.half_height));
    double weights[3];
    hit_weights(hit, weights);
    const auto* const stream =
        reinterpret_cast<const uint8_t*>(at.page + chunk.offset + streams_of(mesh, chunk).colors.offset);
    double code = 0;
    for (int i = 0; i < 3; ++i) code = code + weights[i] * static_cast<double>(stream[4 * uint64_t{vertex[i]} + 3]);
    alpha = alpha * static_cast<float>(min_of(code / 255.0, 1.0));
  }
  return alpha;
}

/// The alpha of samples whose triangle's chunk has its page, a tile of samples an item.
template <bool kOrthographic>
struct FindAlphas {
  using Texels = SceneTexels;  // which it does not read

  ShadeInputs in;  // of the view that draws the layers
  PixelTiles tiles;
  const uint64_t* samples;
  float* alphas;

  template <class Team>
  SCREE_HD void operator()(uint32_t item, Team team) const {
    ShadeState<Team, FindAlphas> state;
    tiles.for_each(item, team, [&](uint32_t x, uint32_t y, bool inside) {
      const uint64_t place = uint64_t{y} * tiles.width + x;
      const uint64_t sample = inside ? samples[place] : kBackground;
      const uint64_t id = sample_id(sample);
      const bool shows = sample != kBackground;
      locate(team, in.scene, id, shows, state.at);
      if (!shows || in.scene.pages[in.scene.chunks[state.at.chunk].page] == nullptr) return;
      alphas[place] = blended_alpha<kOrthographic>(in.scene, in.view, state.source.get(in, state.at.instance),
                                                   state.at.chunk, static_cast<uint32_t>(id - state.at.first_id),
                                                   static_cast<int32_t>(x), static_cast<int32_t>(y));
    });
  }
};

/// In a Shader's place: colours that ShadePart kept, under the layers of BlendTargets::over. Resolve reads `over`.
struct BlendedColors {
  using Texels = SceneTexels;

  ShadeInputs in;
  const float* colors;
  const float* over;

  template <class Team>
  SCREE_HD void operator()(Team, bool wanted, uint64_t, int32_t x, int32_t y, ShadeState<Team, BlendedColors>&,
                           float rgb[3]) const {
    if (!wanted) return;
    const uint64_t place = place_of(x, y);
    for (uint64_t c = 0; c < 3; ++c) rgb[c] = colors[3 * place + c];
  }

  SCREE_HD const float* over_at(uint32_t x, uint32_t y) const {
    return over + 4 * place_of(static_cast<int32_t>(x), static_cast<int32_t>(y));
  }

 private:
  SCREE_HD uint64_t place_of(int32_t x, int32_t y) const {
    return static_cast<uint64_t>(y) * static_cast<uint64_t>(in.view.width) + static_cast<uint64_t>(x);
  }
};

}  // namespace SCREE_ISA
}  // namespace scree::kernels
