// Layers of blended surfaces over an opaque picture: each is drawn into samples of its own, shaded, and laid under
// those before it. Source: spec/rasterization.md, blending.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "kernels/frame.h"

namespace scree::kernels {

/// A picture's layers while they are drawn: a value per sample, or as many as are given.
struct BlendTargets {
  uint32_t sample_count;
  const uint64_t* opaque;
  uint64_t* drawn;  // where a layer is drawn
  uint64_t* layer;  // the last one: kBackground where it shows nothing
  float* colors;    // 3: its light
  float* alphas;
  float* over;  // 4: light of the layers so far, and the share of the light behind them that they let through
};

/// How layers are drawn and shaded, over host or device memory.
struct LayerSource {
  /// Draws blended surfaces into at.drawn, behind `peeled` (at.layer, or null for the first layer).
  std::function<Result<void>(const BlendTargets& at, const uint64_t* peeled)> draw;
  /// Fills in at.colors and at.alphas where at.layer shows something.
  std::function<Result<void>(const BlendTargets& at)> shade;
};

/// Draws up to `most` layers, from the nearest on, until none is left. `begin(is_first)` and `end()`, the number of
/// samples that show the layer, stand before and after it is drawn; `lay_under()` lays it under those before.
template <class Begin, class End, class LayUnder>
Result<void> draw_layers(const BlendTargets& at, uint32_t most, const LayerSource& source, BlendCounts& counts,
                         const Begin& begin, const End& end, const LayUnder& lay_under) {
  for (counts = {};; ++counts.layers) {
    const bool is_first = counts.layers == 0;
    if (Result<void> done = begin(is_first); !done) return done;
    if (Result<void> done = source.draw(at, is_first ? nullptr : at.layer); !done) return done;
    const Result<uint64_t> shown = end();
    if (!shown) return shown.error();
    if (*shown != 0 && counts.layers == most) counts.samples_left_out = *shown;
    if (*shown == 0 || counts.layers == most) return {};
    if (Result<void> done = source.shade(at); !done) return done;
    if (Result<void> done = lay_under(); !done) return done;
  }
}

/// The layers over the opaque picture `samples`, up to `most`: BlendTargets::over. Takes 32 bytes per sample meanwhile.
/// Errors kMemory, those of `source`.
Result<std::vector<float>> blend_cpu(const View& view, std::span<const uint64_t> samples, uint32_t most,
                                     const LayerSource& source, uint32_t threads, BlendCounts& counts);

/// The same of a scene that shows_layers(), whose pages are there.
Result<std::vector<float>> blend_cpu(const SceneView& scene, const View& view, std::span<const uint64_t> samples,
                                     const ShadeOptions& options, uint32_t threads, BlendCounts& counts);

/// LayerSource::draw, of the chunks whose pages are there. `scene`: blended_view().
Result<void> draw_layer_cpu(const SceneView& scene, const View& view, const BlendTargets& at, const uint64_t* peeled,
                            uint32_t threads);
/// Light and alpha of `samples`, at.drawn or at.layer, where the chunk's page is there. `scene`: blended_view().
Result<void> shade_layer_cpu(const SceneView& scene, const View& view, const BlendTargets& at, const uint64_t* samples,
                             const ShadeOptions& options, uint32_t threads);

}  // namespace scree::kernels
