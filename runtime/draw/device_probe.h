// Whether the program has code for a GPU. Where the program is built with CUDA.
#pragma once

#include <cuda_runtime_api.h>

namespace scree::runtime {

/// Looks for a kernel of this program's on the current device: cudaSuccess where the GPU can run it.
cudaError_t probe_kernel();

}  // namespace scree::runtime
