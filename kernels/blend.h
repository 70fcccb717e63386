// Layers of blended surfaces over an opaque picture. A pass draws the nearest few of every sample; then they are shaded
// and laid under those of the passes before. Source: spec/rasterization.md, blending.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "kernels/frame.h"

namespace scree::kernels {

/// What the passes of a picture have found so far.
struct BlendProgress {
  uint64_t left_out;  // BlendCounts::samples_left_out
  uint32_t layers;    // BlendCounts::layers
  uint32_t goes_on;   // 1: a sample of the last pass may have further layers
};

/// A picture's layers while they are drawn: a value per sample, or as many as are given.
struct BlendTargets {
  uint32_t sample_count;
  uint32_t layers;  // that a pass draws
  const uint64_t* opaque;
  uint64_t* drawn;    // `layers` pictures, the nearest layer first; the opaque picture's where there is none
  uint64_t* peeled;   // the last layer of the passes before
  float* over;        // 4: light of the layers so far, and the share of the light behind them that they let through
  float* shaded;      // 4: light and alpha of a layer that is shaded in parts; else null
  uint32_t* further;  // a bit per sample of a tile (PixelTiles): whether it may have layers in this pass
  BlendProgress* progress;
};

inline namespace SCREE_ISA {

/// The last layer of a pass, which frames draw into (Target::layers). It is 0 where nothing is left: that hides
/// everything.
SCREE_HD inline uint64_t* last_layer(const BlendTargets& at) {
  return at.drawn + uint64_t{at.layers - 1} * at.sample_count;
}

}  // namespace SCREE_ISA

struct BlendPass {
  uint32_t before;  // layers of the passes before
  uint32_t most;    // of all passes
};

/// Layers that a pass draws where it can: one more takes 8 bytes per sample, and saves pictures with more layers a
/// frame.
inline constexpr uint32_t kLayersPerPass = 4;

/// How layers are drawn and shaded, over host or device memory.
struct LayerSource {
  /// Draws blended surfaces into at.drawn, behind `peeled` (at.peeled, or null for the first pass).
  std::function<Result<void>(const BlendTargets& at, const uint64_t* peeled)> draw;
  /// Shades the layers of a pass and lays them under those before: BlendLayers. Null: each pass has one layer, and
  /// draw() fills in at.shaded where it shows something.
  std::function<Result<void>(const BlendTargets& at, const BlendPass& pass)> blend;
  uint32_t layers_per_pass = kLayersPerPass;  // with blend()

  uint32_t layers() const { return blend ? layers_per_pass : 1; }
};

/// Draws up to `most` layers, from the nearest on, until none is left. `begin()` sets at.drawn to the opaque picture
/// and all bits of at.further; `lay(pass)` is BlendLayers of layers that are shaded already; `read()` returns
/// at.progress and clears its goes_on.
template <class Begin, class Lay, class Read>
Result<void> draw_layers(const BlendTargets& at, uint32_t most, const LayerSource& source, BlendCounts& counts,
                         const Begin& begin, const Lay& lay, const Read& read) {
  counts = {};
  if (Result<void> begun = begin(); !begun) return begun;
  for (BlendPass pass{0, most};; pass.before += at.layers) {
    if (Result<void> done = source.draw(at, pass.before == 0 ? nullptr : at.peeled); !done) return done;
    if (Result<void> done = source.blend ? source.blend(at, pass) : lay(pass); !done) return done;
    const Result<BlendProgress> progress = read();
    if (!progress) return progress.error();
    counts.layers = progress->layers;
    counts.samples_left_out = progress->left_out;
    if (progress->goes_on == 0) return {};
  }
}

/// Host memory that the layers of a picture take per sample, rounded up. Beside them a bit per sample of whole tiles.
inline constexpr uint64_t kHostLayerBytes = 57;

/// The layers over the opaque picture `samples`, up to `most`: BlendTargets::over. Errors kMemory, those of `source`.
Result<std::vector<float>> blend_cpu(const View& view, std::span<const uint64_t> samples, uint32_t most,
                                     const LayerSource& source, uint32_t threads, BlendCounts& counts);

/// The same of a scene that shows_layers(), whose pages are there.
Result<std::vector<float>> blend_cpu(const SceneView& scene, const View& view, std::span<const uint64_t> samples,
                                     const ShadeOptions& options, uint32_t threads, BlendCounts& counts);

/// LayerSource::draw, of the chunks whose pages are there. `scene`: blended_view().
Result<void> draw_layers_cpu(const SceneView& scene, const View& view, const BlendTargets& at, const uint64_t* peeled,
                             uint32_t threads);
/// LayerSource::blend. `pass`: null to fill in at.shaded where the chunk's page is there. `scene`: blended_view().
Result<void> shade_layers_cpu(const SceneView& scene, const View& view, const BlendTargets& at, const BlendPass* pass,
                              const ShadeOptions& options, uint32_t threads);

}  // namespace scree::kernels
