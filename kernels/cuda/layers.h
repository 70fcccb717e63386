// Layers of a picture on a GPU (kernels/shade/layers.h), in device memory.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>

#include "format/result.h"
#include "kernels/shade/layers.h"

namespace scree::kernels {

/// Queues `pass`, all of whose pointers are of the current device, on `stream`. Errors kDevice.
Result<void> start_layers(const MakeLayers& pass, cudaStream_t stream);

}  // namespace scree::kernels
