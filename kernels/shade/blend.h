// Blended surfaces, from the nearest layer on: a layer has of every sample the nearest fragment behind the layer before
// and before the opaque picture. Source: spec/rasterization.md, blending.
#pragma once

#include <type_traits>

#include "kernels/blend.h"
#include "kernels/raster/mask.h"
#include "kernels/shade/pixels.h"
#include "kernels/shade/texture_cache.h"

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

/// Before the first pass: no layer is there.
struct BeginLayers {
  BlendTargets at;

  template <class Team>
  SCREE_HD void operator()(uint32_t item, Team team) const {
    for_each_sample(item, at.sample_count, team, [&](uint32_t i) {
      const uint64_t opaque = at.opaque[i];
      for (uint32_t l = 0; l < at.layers; ++l) at.drawn[uint64_t{l} * at.sample_count + i] = opaque;
    });
  }
};

/// `alpha`, of the factor, times those of the texture and of the vertex colours. Takes many registers, so it is a call
/// that takes only values, as Shader::exact_place().
template <bool kOrthographic>
[[gnu::noinline]] SCREE_HD float varying_alpha(const SceneView& scene, const FrameView& view,
                                               const Transform* transform, uint64_t chunk_number, uint32_t triangle,
                                               int32_t x, int32_t y, float alpha) {
  const PlacedChunk at = place_chunk<ChunkKinds::kMixed>(scene, chunk_number, triangle, *transform);
  if ((at.mesh.attributes & format::kHasUv) != 0 && scene.blend_masks[at.mesh.material].alpha != nullptr) {
    MaskPlane plane;
    make_mask_plane<kOrthographic>(scene, view, at.transform, at.mesh, at.chunk, at.page, at.reader, triangle, plane);
    alpha = alpha * (static_cast<float>(plane.alpha(x, y)) / static_cast<float>(format::kMaxMaskThreshold));
  }
  if ((at.mesh.attributes & format::kHasColor) != 0) {
    uint32_t vertex[3];
    fetch_triangle(at.reader, triangle, vertex);
    const auto center = [](int32_t place, float half) {
      return static_cast<double>(place) * kSubpixels + kSubpixels / 2 - static_cast<double>(half);
    };
    const PlaneHit<double> hit =
        intersect_plane<kOrthographic>(at.transform, fetch_corners<double>(at.reader, vertex),
                                       center(x, view.half_width), center(y, view.half_height));
    double weights[3];
    hit_weights(hit, weights);
    const auto* const stream =
        reinterpret_cast<const uint8_t*>(at.page + at.chunk.offset + streams_of(at.mesh, at.chunk).colors.offset);
    double code = 0;
    for (int i = 0; i < 3; ++i) code = code + weights[i] * static_cast<double>(stream[4 * uint64_t{vertex[i]} + 3]);
    alpha = alpha * static_cast<float>(min_of(code / 255.0, 1.0));
  }
  return alpha;
}

/// The alpha of a triangle's sample, in double but for its factors: the same on every machine.
template <bool kOrthographic>
SCREE_HD inline float blended_alpha(const SceneView& scene, const FrameView& view, const Transform& transform,
                                    uint64_t chunk_number, uint32_t triangle, int32_t x, int32_t y) {
  const format::MeshRecord& mesh = scene.meshes[scene.chunks[chunk_number].mesh];
  const float alpha = scene.materials[mesh.material].base_color[3];
  const bool has_texture = (mesh.attributes & format::kHasUv) != 0 && scene.blend_masks[mesh.material].alpha != nullptr;
  if (!has_texture && (mesh.attributes & format::kHasColor) == 0) return alpha;
  return varying_alpha<kOrthographic>(scene, view, &transform, chunk_number, triangle, x, y, alpha);
}

/// Light and alpha of a layer's sample, in one piece of memory: a GPU reads and writes all four at once.
struct alignas(16) LayerLight {
  float rgb[3];
  float alpha;
};

/// In a Shader's place: layers that were shaded in parts.
struct ShadedLayer {
  using Texels = SceneTexels;

  ShadeInputs in;
  const float* shaded;
};

/// Shades a sample of a layer; false where its chunk has no page. All lanes of a team must call it. `wanted`: whether
/// the lane has one.
template <class Team, bool kOrthographic, Show kShow, ChunkKinds kKinds, class Texels>
SCREE_HD inline bool shade_layer(Team team, const Shader<kOrthographic, kShow, kKinds, Texels>& shader, bool wanted,
                                 uint64_t sample, int32_t x, int32_t y,
                                 ShadeState<Team, Shader<kOrthographic, kShow, kKinds, Texels>>& state,
                                 LayerLight& out) {
  const ShadeInputs& in = shader.in;
  const uint64_t id = sample_id(sample);
  locate(team, in.scene, id, wanted, state.at);
  if (!wanted || in.scene.pages[in.scene.chunks[state.at.chunk].page] == nullptr) return false;
  const auto triangle = static_cast<uint32_t>(id - state.at.first_id);
  const Transform& transform = state.source.get(in, state.at.instance);
  out.alpha = blended_alpha<kOrthographic>(in.scene, in.view, transform, state.at.chunk, triangle, x, y);
  const PlacedChunk at = place_chunk<kKinds>(in.scene, state.at.chunk, triangle, transform);
  uint32_t vertex[3];
  fetch_triangle(at.reader, triangle, vertex);
  shader.shade(at, state.at.instance, vertex, x, y, state.texels, out.rgb);
  return true;
}
template <class Team>
SCREE_HD inline bool shade_layer(Team, const ShadedLayer& shader, bool wanted, uint64_t, int32_t x, int32_t y,
                                 ShadeState<Team, ShadedLayer>&, LayerLight& out) {
  if (!wanted) return false;
  const uint64_t place =
      static_cast<uint64_t>(y) * static_cast<uint64_t>(shader.in.view.width) + static_cast<uint64_t>(x);
  out = reinterpret_cast<const LayerLight*>(shader.shaded)[place];
  return true;
}

/// Shades the layers of a pass and lays them under those of the passes before, a tile of samples per item: each sample
/// is located and written once. Samples that nothing shines through, or that have fewer layers than a pass draws, end;
/// all others are made ready for the next pass. In the form of Resolve, with samples for pixels.
template <class ShaderOfLayers>
struct BlendLayers {
  using Shader = ShaderOfLayers;

  Shader shader;  // of the view that draws the layers
  PixelTiles tiles;
  BlendTargets at;
  BlendPass pass;
  bool is_part;  // fills in at.shaded where the chunk's page is there, of one layer, and lays nothing

  template <class Team>
  SCREE_HD void operator()(uint32_t item, Team team) const {
    ShadeState<Team, Shader> state;
    tiles.for_each(item, team, [&](uint32_t x, uint32_t y, bool inside) { finish(team, x, y, inside, state); });
  }

  template <class Team>
  SCREE_HD void finish(Team team, uint32_t x, uint32_t y, bool inside, ShadeState<Team, Shader>& state) const {
    static_assert(Team::size() == 1 || Team::size() == kPixelTileSize);
    // All lanes of a team have the same tile, and a lane its own bit of it.
    uint32_t& further = at.further[y / kPixelTileHeight * tiles.across() + x / kPixelTileWidth];
    const uint32_t bits = further;
    const uint32_t bit = y % kPixelTileHeight * kPixelTileWidth + x % kPixelTileWidth;
    const bool has_layers = inside && (bits >> bit & 1u) != 0;
    if (team.ballot(has_layers) == 0) return;
    const uint64_t place = uint64_t{y} * tiles.width + x;
    const uint64_t opaque = has_layers ? at.opaque[place] : 0;
    LayerLight over{{0, 0, 0}, 1};
    if (has_layers && pass.before != 0 && !is_part) over = over_at(place);
    bool is_open = has_layers;  // another layer would be seen
    bool left_out = false;
    uint32_t shown = 0;  // layers of any lane
#if defined(__CUDA_ARCH__)
#pragma unroll 1
#endif
    for (; shown < at.layers; ++shown) {
      const uint64_t sample = is_open ? at.drawn[uint64_t{shown} * at.sample_count + place] : opaque;
      is_open = is_open && sample != opaque;
      if (team.ballot(is_open) == 0) break;
      if (pass.before + shown == pass.most && !is_part) {
        left_out = is_open;
        is_open = false;
        break;
      }
      LayerLight light{{0, 0, 0}, 0};
      const bool is_there =
          shade_layer(team, shader, is_open, sample, static_cast<int32_t>(x), static_cast<int32_t>(y), state, light);
      if (is_part) {
        if (is_there && !misses(state)) reinterpret_cast<LayerLight*>(at.shaded)[place] = light;
        return;
      }
      if (!is_open) continue;
      const float share = over.alpha * light.alpha;
      for (int c = 0; c < 3; ++c) over.rgb[c] = over.rgb[c] + share * light.rgb[c];
      over.alpha = over.alpha - share;
      is_open = over.alpha > 0;
    }
    if (is_part) return;
    const bool ends = has_layers && !misses(state);
    if (ends) over_at(place) = over;
    if (ends && is_open) {
      at.peeled[place] = last_layer(at)[place];
      for (uint32_t l = 0; l < at.layers; ++l) at.drawn[uint64_t{l} * at.sample_count + place] = opaque;
    } else if (ends) {
      last_layer(at)[place] = 0;
    }
    count(team, further, bits, bit, shown, ends && left_out, ends && is_open, ends && !is_open);
  }

 private:
  SCREE_HD LayerLight& over_at(uint64_t place) const {
    return reinterpret_cast<LayerLight*>(at.over)[place];
  }

  template <class State>
  SCREE_HD static bool misses([[maybe_unused]] const State& state) {
    if constexpr (Shader::Texels::kMayMiss) return state.texels.missed;
    return false;
  }

  template <class Team>
  SCREE_HD void count(Team team, uint32_t& further, uint32_t bits, uint32_t bit, uint32_t shown, bool left_out,
                      bool goes_on, bool ends) const {
    const uint32_t all_left_out = team.ballot(left_out);
    const uint32_t all_going_on = team.ballot(goes_on);
    const uint32_t all_ended = Team::size() == 1 ? (ends ? 1u << bit : 0u) : team.ballot(ends);
    if (team.rank() != 0) return;
    if (all_ended != 0) further = bits & ~all_ended;
    BlendProgress& progress = *at.progress;
    if (all_left_out != 0) team.add(&progress.left_out, count_bits(all_left_out));
    // A read is cheaper than an atomic that changes nothing.
    if (shown != 0 && load_relaxed(&progress.layers) < pass.before + shown)
      team.atomic_max(&progress.layers, pass.before + shown);
    if (all_going_on != 0 && load_relaxed(&progress.goes_on) == 0) team.atomic_max(&progress.goes_on, 1u);
  }
};

/// Calls visit(shader) with the shader of a picture's layers: one for all kinds of chunks, because each takes most of
/// its time elsewhere.
template <class Texels, class Visit>
inline void visit_layers(const ShadeInputs& in, const Texels& texels, const Visit& visit) {
  const auto with_camera = [&]<bool kOrthographic>() {
    const bool is_textured = in.options.show == Show::kTexture;
    if (is_textured && shades_surfaces(in.scene, in.options))
      return visit(Shader<kOrthographic, Show::kSurface, ChunkKinds::kMixed, Texels>{in, texels});
    if constexpr (std::is_same_v<Texels, SceneTexels>)
      if (!is_textured || in.scene.texture_count == 0)
        return visit(Shader<kOrthographic, Show::kColor, ChunkKinds::kMixed, Texels>{in, texels});
    visit(Shader<kOrthographic, Show::kTexture, ChunkKinds::kMixed, Texels>{in, texels});
  };
  in.view.orthographic ? with_camera.template operator()<true>() : with_camera.template operator()<false>();
}

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
