// The scene for blended surfaces: panes of glass, one behind another.
#pragma once

#include "format/result.h"
#include "tools/synth/synth.h"

namespace scree::synth {

/// Writes the panes: a camera "through" for 16:9, in front of 8 * options.scale panes (at least 1) that all fill its
/// picture, and an opaque wall behind them. A pane is a wavy grid of 64 x 64 quads with its own colour and an alpha of
/// 0.2. In "panes-textured" it has texture coordinates, and its alpha, from 0.1 to 0.5, comes from a PNG of
/// options.texture_size texels per side. Errors as synthesize().
Result<SynthReport> write_panes(const SynthOptions& options);

}  // namespace scree::synth
