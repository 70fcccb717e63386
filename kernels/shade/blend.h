// Blended surfaces, layer by layer from the nearest on. In every sample a layer has the nearest fragment that lies
// behind the layer before and in front of the opaque picture. Source: spec/rasterization.md, blending.
#pragma once

#include "kernels/blend.h"
#include "kernels/raster/mask.h"
#include "kernels/raster/queues.h"
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

/// Prepares `at.drawn` before a layer is drawn. Samples in which the previous layer has no fragment become 0, which
/// hides everything, because no fragment is left there.
struct BeginLayer {
  BlendTargets at;
  bool is_first;
  FragmentSlots drawn =
      {};  // samples whose fragments fit these slots are done, and get no layers; unless counts is null

  template <class Team>
  SCREE_HD void operator()(uint32_t item, Team team) const {
    for_each_sample(item, at.sample_count, team, [&](uint32_t i) {
      const bool is_done = drawn.counts != nullptr && drawn.counts[i] <= drawn.slot_count;
      const bool goes_on = is_first ? !is_done : at.layer[i] != kBackground;
      at.drawn[i] = goes_on ? at.opaque[i] : 0;
      if (!is_first) return;
      at.layer[i] = goes_on ? 0 : kBackground;
      if (is_done) return;
      for (uint32_t c = 0; c < 4; ++c) at.over[4 * uint64_t{i} + c] = c == 3 ? 1.0f : 0.0f;
    });
  }
};

/// Stores a layer in `at.layer` after it is drawn. Adds the number of samples that show something to `count`.
struct EndLayer {
  BlendTargets at;
  uint64_t* count;

  template <class Team>
  SCREE_HD void operator()(uint32_t item, Team team) const {
    uint64_t shown = 0;
    for_each_sample(item, at.sample_count, team, [&](uint32_t i) {
      const uint64_t drawn = at.drawn[i];
      const bool shows = drawn != at.opaque[i] && at.layer[i] != kBackground;
      at.layer[i] = shows ? drawn : kBackground;
      shown += shows ? 1 : 0;
    });
    if (shown != 0) team.add(count, shown);
  }
};

/// Composites a fragment under the previous layers. Returns whether the layers so far let light through.
SCREE_HD inline bool lay_under(float over[4], const float color[3], float alpha) {
  const float share = over[3] * alpha;
  for (int c = 0; c < 3; ++c) over[c] = over[c] + share * color[c];
  over[3] = over[3] - share;
  return over[3] > 0;
}

/// Composites the layer under the previous layers. Samples whose layers let no light through have no further layers.
struct LayUnder {
  BlendTargets at;

  template <class Team>
  SCREE_HD void operator()(uint32_t item, Team team) const {
    for_each_sample(item, at.sample_count, team, [&](uint32_t i) {
      if (at.layer[i] == kBackground) return;
      if (!lay_under(at.over + 4 * uint64_t{i}, at.colors + 3 * uint64_t{i}, at.alphas[i])) at.layer[i] = kBackground;
    });
  }
};

/// The alpha of a triangle's sample, the same on every machine. It is computed in double, except for its factors.
/// `of_texture()`: its MaskPlane::alpha(); called if the material has a texture.
template <bool kOrthographic, class OfTexture>
SCREE_HD inline float blended_alpha(const SceneView& scene, const FrameView& view, const Transform& transform,
                                    uint64_t chunk_number, uint32_t triangle, int32_t x, int32_t y,
                                    const OfTexture& of_texture) {
  const format::ChunkRecord& chunk = scene.chunks[chunk_number];
  const format::MeshRecord& mesh = scene.meshes[chunk.mesh];
  float alpha = scene.materials[mesh.material].base_color[3];
  if ((mesh.attributes & format::kHasUv) != 0 && scene.blend_masks[mesh.material].alpha != nullptr)
    alpha = alpha * (static_cast<float>(of_texture()) / static_cast<float>(format::kMaxMaskThreshold));
  if ((mesh.attributes & format::kHasColor) != 0) {
    const PlacedChunk at = place_chunk<ChunkKinds::kMixed>(scene, chunk_number, triangle, transform);
    uint32_t vertex[3];
    fetch_triangle(at.reader, triangle, vertex);
    double weights[3];
    hit_weights(intersect_plane_at<kOrthographic>(view, transform, fetch_corners<double>(at.reader, vertex), x, y),
                weights);
    const auto* const stream =
        reinterpret_cast<const uint8_t*>(at.page + chunk.offset + streams_of(mesh, chunk).colors.offset);
    double code = 0;
    for (int i = 0; i < 3; ++i) code = code + weights[i] * static_cast<double>(stream[4 * uint64_t{vertex[i]} + 3]);
    alpha = alpha * static_cast<float>(min_of(code / 255.0, 1.0));
  }
  return alpha;
}

/// Computes the alpha of the samples whose triangle's chunk has its page, one tile of samples per item.
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
      const Transform& transform = state.source.get(in, state.at.instance);
      const auto triangle = static_cast<uint32_t>(id - state.at.first_id);
      const auto column = static_cast<int32_t>(x);
      const auto row = static_cast<int32_t>(y);
      const auto of_texture = [&] {
        MaskPlane plane;
        make_mask_plane<kOrthographic>(in.scene, in.view, transform, state.at.chunk, triangle, plane);
        return plane.alpha(column, row);
      };
      alphas[place] =
          blended_alpha<kOrthographic>(in.scene, in.view, transform, state.at.chunk, triangle, column, row, of_texture);
    });
  }
};

/// Counts of the layers that lie in slots.
struct SlotCounts {
  static constexpr uint32_t kMostSlots = 8;

  uint64_t shown[kMostSlots + 1];  // by layer: not 0 if a sample shows it; for the first layer left out, their number
  uint64_t overfull;               // not 0 if a sample has more fragments than slots
  uint32_t deepest;                // the most fragments of any other sample
  uint32_t unused;
};

/// Lays a layer that lies in a slot under the layers before. The slots hold the sorted fragments of every sample and
/// then one kBackground. This pass copies kBackground to the next slot, and stores it there if the fragment lets
/// nothing through.
template <bool kOrthographic>
struct LaySlotUnder {
  using Texels = SceneTexels;  // which it does not read

  ShadeInputs in;  // of the view that draws the layers
  PixelTiles tiles;
  FragmentSlots slots;
  uint32_t slot;
  uint32_t most;  // layers that are drawn
  const float* colors;
  float* over;
  SlotCounts* counts;

  template <class Team>
  SCREE_HD void operator()(uint32_t item, Team team) const {
    ShadeState<Team, LaySlotUnder> state;
    uint64_t next_shown = 0;
    tiles.for_each(item, team, [&](uint32_t x, uint32_t y, bool inside) {
      const uint64_t sample = uint64_t{y} * tiles.width + x;
      const uint64_t at = slot * slots.sample_count + sample;
      const uint64_t word = inside ? slots.words[at] : kBackground;
      const bool shows = word != kBackground;
      locate(team, in.scene, sample_id(word), shows, state.at);
      bool ends = !shows;
      if (shows) {
        const float alpha = blended_alpha<kOrthographic>(
            in.scene, in.view, state.source.get(in, state.at.instance), state.at.chunk,
            static_cast<uint32_t>(sample_id(word) - state.at.first_id), static_cast<int32_t>(x),
            static_cast<int32_t>(y), [&] { return slots.alphas[at] & ~kShown; });
        ends = !lay_under(over + 4 * sample, colors + 3 * sample, alpha);
      }
      if (!inside || slot + 1 == slots.slot_count) return;
      uint64_t& next = slots.words[at + slots.sample_count];
      if (ends) next = kBackground;
      next_shown += next != kBackground ? 1 : 0;
    });
    if (next_shown == 0) return;
    uint64_t& next_count = counts->shown[slot + 1];
    if (slot + 1 == most) {
      team.add(&next_count, next_shown);
    } else if (next_count == 0) {
      next_count = 1;
    }
  }
};

}  // namespace SCREE_ISA
}  // namespace scree::kernels
