// Tests whether the program has code for a GPU. Only in programs that are built with CUDA.
#pragma once

#include <cuda_runtime_api.h>

namespace scree::runtime {

/// Finds a kernel of this program on the current device. Returns cudaSuccess if the GPU can run it.
cudaError_t probe_kernel();

}  // namespace scree::runtime
