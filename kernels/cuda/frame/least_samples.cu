#include <algorithm>

#include "kernels/cuda/common/check.h"
#include "kernels/cuda/frame/least_samples.h"

namespace scree::kernels {
namespace {

constexpr uint32_t kThreads = 256;
constexpr uint64_t kMostBlocks = 2048;  // enough requests in flight to fill a link between GPUs

/// A word is written only where it changes, since links between GPUs are slower than memory.
__global__ void __launch_bounds__(kThreads)
    least_samples(const __grid_constant__ SampleBuffers buffers, uint64_t first, uint64_t end) {
  for (uint64_t i = first + uint64_t{blockIdx.x} * kThreads + threadIdx.x; i < end;
       i += uint64_t{gridDim.x} * kThreads) {
    uint64_t words[kMostBuffers];
    uint64_t least = ~uint64_t{0};
#pragma unroll
    for (uint32_t g = 0; g < kMostBuffers; ++g) {
      if (g >= buffers.count) break;
      words[g] = buffers.of[g][i];
      least = words[g] < least ? words[g] : least;
    }
#pragma unroll
    for (uint32_t g = 0; g < kMostBuffers; ++g) {
      if (g >= buffers.count) break;
      if (words[g] != least) buffers.of[g][i] = least;
    }
  }
}

}  // namespace

Result<void> start_least_samples(const SampleBuffers& buffers, uint64_t first, uint64_t end, cudaStream_t stream) {
  if (first >= end) return {};
  const auto blocks = static_cast<uint32_t>(std::min((end - first - 1) / kThreads + 1, kMostBlocks));
  least_samples<<<blocks, kThreads, 0, stream>>>(buffers, first, end);
  return cuda_check(cudaGetLastError(), "joining the samples of several GPUs");
}

}  // namespace scree::kernels
