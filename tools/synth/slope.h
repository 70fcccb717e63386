// The scene of the demo: a scree slope of textured, instanced stones below a cliff.
#pragma once

#include "format/result.h"
#include "tools/synth/synth.h"

namespace scree::synth {

/// Writes the slope: y up, metres, one camera "view" for 16:9. It has a ground and a cliff mesh (0.18 M triangles), 4
/// boulder and 8 stone meshes with up to 12,000 * options.scale instances (at least 16), large stones at the foot as in
/// real scree, and three JPEG textures and a PNG beside a .gltf or inside a .glb. Another options.seed scatters the
/// stones differently. Errors as synthesize().
Result<SynthReport> write_slope(const SynthOptions& options);

}  // namespace scree::synth
