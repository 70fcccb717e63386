// Compiles every pass for the GPU, so that single source stays single source: a pass that only a CPU compiler takes breaks
// this target. Nothing here is run; the CUDA backend brings its own launches.
#include "kernels/passes.h"
#include "kernels/shade.h"

namespace scree::kernels {
namespace {

/// One warp: what a pass may ask of a team.
struct WarpTeam {
  static constexpr bool kCachesVertices = false;
  static constexpr bool kDrawsRuns = false;

  __device__ uint32_t rank() const { return threadIdx.x & 31u; }
  __device__ static constexpr uint32_t size() { return 32; }
  __device__ static uint64_t add(uint64_t* counter, uint64_t value) {
    return atomicAdd(reinterpret_cast<unsigned long long*>(counter), static_cast<unsigned long long>(value));
  }
  __device__ static void keep_min(uint64_t* sample, uint64_t value) {
    if (value < *static_cast<volatile uint64_t*>(sample)) {
      atomicMin(reinterpret_cast<unsigned long long*>(sample), static_cast<unsigned long long>(value));
    }
  }
};

}  // namespace

template <class Pass>
__global__ void run_pass(Pass pass, uint32_t count) {
  const uint32_t item = (blockIdx.x * blockDim.x + threadIdx.x) / 32;
  if (item < count) pass(item, WarpTeam{});
}

template __global__ void run_pass(Clear, uint32_t);
template __global__ void run_pass(Cull, uint32_t);
template __global__ void run_pass(SplitLarge, uint32_t);
template __global__ void run_pass(RasterSmall<false>, uint32_t);
template __global__ void run_pass(RasterSmall<true>, uint32_t);
template __global__ void run_pass(RasterMedium<false>, uint32_t);
template __global__ void run_pass(RasterMedium<true>, uint32_t);
template __global__ void run_pass(RasterTiles<false>, uint32_t);
template __global__ void run_pass(RasterTiles<true>, uint32_t);
template __global__ void run_pass(Shade<false>, uint32_t);
template __global__ void run_pass(Shade<true>, uint32_t);

}  // namespace scree::kernels
