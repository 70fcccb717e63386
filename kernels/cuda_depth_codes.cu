#include "kernels/cuda_check.h"
#include "kernels/depth_codes_cuda.h"
#include "kernels/math.h"
#include "kernels/visbuffer.h"

namespace scree::kernels {
namespace {

constexpr uint32_t kSide = 1u << kDepthCodesLevel;
constexpr uint32_t kWarps = 4;  // a block

/// One warp a square, a lane two of its samples.
__global__ void __launch_bounds__(32 * kWarps)
    farthest_of_squares(const uint64_t* samples, uint32_t width, uint32_t height, uint32_t* codes) {
  const uint32_t across = (width - 1) / kSide + 1;
  const uint32_t square = blockIdx.x * kWarps + threadIdx.x / 32;
  if (square >= across * ((height - 1) / kSide + 1)) return;
  const uint32_t lane = threadIdx.x % 32;
  const uint32_t x = square % across * kSide + lane % kSide;
  uint32_t farthest = 0;
  for (uint32_t y = square / across * kSide + lane / kSide, i = 0; i < 2; ++i, y += 32 / kSide)
    if (x < width && y < height) farthest = max_of(farthest, sample_depth_code(samples[uint64_t{y} * width + x]));
  farthest = __reduce_max_sync(~0u, farthest);
  if (lane == 0) codes[square] = farthest;
}

}  // namespace

Result<void> find_depth_codes(const uint64_t* samples, uint32_t width, uint32_t height, uint32_t* codes,
                              cudaStream_t stream) {
  const uint32_t squares = ((width - 1) / kSide + 1) * ((height - 1) / kSide + 1);
  farthest_of_squares<<<(squares - 1) / kWarps + 1, 32 * kWarps, 0, stream>>>(samples, width, height, codes);
  return cuda_check(cudaGetLastError(), "finding the farthest depths");
}

}  // namespace scree::kernels
