// Layers of a picture on a GPU (kernels/shade/layers.h), in device memory.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>

#include "format/result.h"
#include "kernels/frame.h"
#include "kernels/raster/transform.h"

namespace scree::kernels {

/// As layers_cpu(), queued on `stream`. All pointers, also those in `scene`, are on the current device. `transforms`:
/// of `view`, by instance number, valid for the instances that `samples` show. Errors kRange, kDevice.
Result<void> start_layers(const SceneView& scene, const View& view, uint32_t samples_per_side, const uint64_t* samples,
                          const Transform* transforms, const LayerTargets& out, cudaStream_t stream);

}  // namespace scree::kernels
