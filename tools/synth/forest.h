// The scene for alpha masks: a forest of leaf cards.
#pragma once

#include "format/result.h"
#include "tools/synth/synth.h"

namespace scree::synth {

/// Writes the forest: y up, metres, cameras "overview", "within" and "clearing" for 16:9. It has 20 plants (trees,
/// bushes, grass) of 200 masked cards each (400 triangles; trees have an opaque trunk of 60 more) in 50,000 *
/// options.scale instances (at least 20) at the same density, and an opaque ground. Two atlases of 4 x 4 sprigs, PNGs
/// of options.texture_size texels per side, are shared by all plants; the materials are double-sided, with alphaMode
/// MASK. Another options.seed scatters the plants differently. Errors as synthesize().
Result<SynthReport> write_forest(const SynthOptions& options);

}  // namespace scree::synth
