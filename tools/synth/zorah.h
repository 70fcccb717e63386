// Writes scenes with the counts of NVIDIA's Zorah.
#pragma once

#include "format/result.h"
#include "tools/synth/synth.h"
#include "tools/synth/zorah_plan.h"

namespace scree::synth {

/// Writes a plan as .gltf: buffers of EXT_meshopt_compression (vertex codec version 0) with one fallback buffer without
/// data, plain buffers for instances, textures as KTX2 files. The bytes are the same for any number of threads.
/// Memory: 1 GiB, and the largest buffer view or texture in unpacked and packed form. Errors kUsage (a .glb), kFile.
Result<SynthReport> write_zorah(const ZorahPlan& plan, const SynthOptions& options);

}  // namespace scree::synth
