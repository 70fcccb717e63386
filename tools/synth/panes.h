// The scene for blended surfaces: panes of glass behind one another.
#pragma once

#include "format/result.h"
#include "tools/synth/synth.h"

namespace scree::synth {

/// Writes the panes: a camera "through" for 16:9, in front of 8 * options.scale panes (at least 1) that all fill its
/// picture, and an opaque wall behind them. A pane is a wavy grid of 64 x 64 quads with an alpha of 0.2 and a colour of
/// its own; of "panes-textured" it has texture coordinates, and its alpha is that of a PNG of options.texture_size
/// texels a side, from 0.1 to 0.5. Errors as synthesize().
Result<SynthReport> write_panes(const SynthOptions& options);

}  // namespace scree::synth
