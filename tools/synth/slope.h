// The scene of the demo: a scree slope of textured, instanced stones below a cliff.
#pragma once

#include "format/result.h"
#include "tools/synth/synth.h"

namespace scree::synth {

/// Writes the slope: y up, metres, one camera "view" for 16:9. A ground and a cliff mesh have 0.18 M triangles. 4
/// boulder and 8 stone meshes have up to 12,000 * options.scale instances (at least 16), with large stones at the foot
/// as in real scree. Three JPEG textures and a PNG lie beside a .gltf or inside a .glb. Another options.seed scatters
/// the stones differently. Errors as synthesize().
Result<SynthReport> write_slope(const SynthOptions& options);

}  // namespace scree::synth
