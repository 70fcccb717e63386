#include "kernels/cuda/layers.h"

#include <cuda_runtime.h>

#include "kernels/cuda/check.h"
#include "kernels/cuda/pixels.cuh"

namespace scree::kernels {
namespace {

__global__ void run_layers(const __grid_constant__ MakeLayers pass, uint32_t count) {
  const uint32_t item = (blockIdx.x * kPixelThreads + threadIdx.x) / 32;
  if (item < count) pass(item, PixelTeam{});
}

}  // namespace

Result<void> start_layers(const MakeLayers& pass, cudaStream_t stream) {
  constexpr uint32_t kItemsPerBlock = kPixelThreads / 32;
  const uint32_t count = pass.items();
  if (count == 0) return {};
  run_layers<<<(count + kItemsPerBlock - 1) / kItemsPerBlock, kPixelThreads, 0, stream>>>(pass, count);
  return cuda_check(cudaGetLastError(), "starting to make a layer");
}

}  // namespace scree::kernels
