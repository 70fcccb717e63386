// Layers of blended surfaces over an opaque picture. A layer is drawn into samples of its own, shaded, and composited
// under the previous layers. Source: spec/rasterization.md, blending.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "kernels/frame.h"

namespace scree::kernels {

/// The buffers of a picture's layers while they are drawn: one value per sample unless another number is given.
struct BlendTargets {
  uint32_t sample_count;
  const uint64_t* opaque;
  uint64_t* drawn;  // where a layer is drawn
  uint64_t* layer;  // the last layer; kBackground where it has no fragment
  float* colors;    // 3: the layer's light
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

/// Draws up to `most` layers, from the nearest on, until none is left. Calls `begin(is_first)` before a layer is drawn
/// and `end()` after it, which returns the number of samples that show the layer. `lay_under()` composites the layer
/// under the previous layers.
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

/// Draws up to `most` layers over the opaque picture `samples`. Returns BlendTargets::over. Takes 32 bytes per sample
/// meanwhile. Errors kMemory, and the errors of `source`.
Result<std::vector<float>> blend_cpu(const View& view, std::span<const uint64_t> samples, uint32_t most,
                                     const LayerSource& source, uint32_t threads, BlendCounts& counts);

/// The same for a scene that shows_layers() and whose pages are present.
Result<std::vector<float>> blend_cpu(const SceneView& scene, const View& view, std::span<const uint64_t> samples,
                                     const ShadeOptions& options, uint32_t threads, BlendCounts& counts);

/// LayerSource::draw for the chunks whose pages are present. `scene`: blended_view().
Result<void> draw_layer_cpu(const SceneView& scene, const View& view, const BlendTargets& at, const uint64_t* peeled,
                            uint32_t threads);
/// Computes light and alpha of `samples` (at.drawn or at.layer) whose chunk's page is present. `scene`: blended_view().
Result<void> shade_layer_cpu(const SceneView& scene, const View& view, const BlendTargets& at, const uint64_t* samples,
                             const ShadeOptions& options, uint32_t threads);

}  // namespace scree::kernels
