// The visibility buffer of several GPUs that each drew a part of a scene. A sample is a minimum, so the least of all
// GPUs' words is the one that a single GPU would have drawn.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>

#include "format/result.h"

namespace scree::kernels {

inline constexpr uint32_t kMostBuffers = 16;

/// One visibility buffer per GPU, each in that GPU's memory.
struct SampleBuffers {
  uint64_t* of[kMostBuffers];
  uint32_t count;
};

/// Queues on `stream`: words `first` to `end` - 1 of every buffer become the least of all buffers' words. The current
/// device reads and writes all of them (peer access). Errors kDevice.
Result<void> start_least_samples(const SampleBuffers& buffers, uint64_t first, uint64_t end, cudaStream_t stream);

}  // namespace scree::kernels
