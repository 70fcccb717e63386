// The demo's picture: a scree slope of textured, instanced stones below a cliff.
#pragma once

#include "format/result.h"
#include "tools/synth/synth.h"

namespace scree::synth {

/// Writes the slope: y up, metres, one camera "view" for 16:9. A ground and cliff mesh (0.18 M triangles), 4
/// boulder and 8 stone meshes instanced up to 12,000 * options.scale times (at least 16), large stones at the foot as
/// in real scree; three JPEG textures and a PNG beside a .gltf or inside a .glb. Another options.seed scatters the
/// stones differently. Errors as synthesize().
Result<SynthReport> write_slope(const SynthOptions& options);

}  // namespace scree::synth
