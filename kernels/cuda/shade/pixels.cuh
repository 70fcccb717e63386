// The team that shades pixels on a GPU: a warp, one lane per pixel of a tile.
#pragma once

#include <cuda_runtime.h>

#include <cstdint>

#include "kernels/cuda/common/check.h"
#include "kernels/math.h"

namespace scree::kernels {

inline constexpr uint32_t kPixelThreads = 128;  // per block

/// One warp. All its lanes take part in every pass.
struct PixelTeam {
  static constexpr bool kMakesTransforms = false;

  __device__ static uint32_t rank() { return threadIdx.x & 31u; }
  SCREE_HD static constexpr uint32_t size() { return 32; }
  __device__ static uint32_t ballot(bool value) { return __ballot_sync(0xffffffffu, value); }
  __device__ static uint64_t share(uint64_t value, uint32_t lane) {
    return __shfl_sync(0xffffffffu, static_cast<unsigned long long>(value), static_cast<int>(lane));
  }
  __device__ static void synchronise() { __syncwarp(); }
  __device__ static void atomic_min(uint32_t* place, uint32_t value) { atomicMin(place, value); }
  __device__ static void atomic_max(uint32_t* place, uint32_t value) { atomicMax(place, value); }
};

/// Queues a pass on `stream`, with a warp per item. Errors kDevice, with `what`.
template <class Pass>
Result<void> start_items(void (*kernel)(Pass, uint32_t), const Pass& pass, uint32_t count, cudaStream_t stream,
                         const char* what) {
  if (count == 0) return {};
  constexpr uint32_t kItemsPerBlock = kPixelThreads / PixelTeam::size();
  kernel<<<(count - 1) / kItemsPerBlock + 1, kPixelThreads, 0, stream>>>(pass, count);
  return cuda_check(cudaGetLastError(), what);
}

}  // namespace scree::kernels
