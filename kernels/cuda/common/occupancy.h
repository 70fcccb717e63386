// How many blocks of a kernel a GPU holds at once.
#pragma once

#include <cuda_runtime.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

#include "kernels/cuda/common/check.h"

namespace scree::kernels {

/// Lets blocks of `kernel` have `bytes` of dynamic shared memory. Errors kDevice.
template <class... Arguments>
Result<void> allow_shared(void (*kernel)(Arguments...), size_t bytes) {
  return cuda_check(cudaFuncSetAttribute(reinterpret_cast<const void*>(kernel),
                                         cudaFuncAttributeMaxDynamicSharedMemorySize, static_cast<int>(bytes)),
                    "asking for shared memory");
}

/// The grids of kernels whose warps take work until none is left: as many blocks as the current device holds at once
/// with the kernel's registers and shared memory (cudaOccupancy). So no warp's share waits for a block that starts
/// late.
class ResidentBlocks {
 public:
  /// Errors kDevice.
  Result<void> open() {
    int device = 0;
    SCREE_TRY(cuda_check(cudaGetDevice(&device), "asking for the device"));
    SCREE_TRY(cuda_check(cudaDeviceGetAttribute(&multiprocessors_, cudaDevAttrMultiProcessorCount, device),
                         "asking for multiprocessors"));
    return cuda_check(cudaDeviceGetAttribute(&threads_, cudaDevAttrMaxThreadsPerMultiProcessor, device),
                      "asking for threads of a multiprocessor");
  }

  uint32_t multiprocessors() const { return static_cast<uint32_t>(multiprocessors_); }

  /// Blocks of `threads` threads that fill the device if neither registers nor shared memory are short.
  uint32_t fill(uint32_t threads) const { return static_cast<uint32_t>(multiprocessors_ * threads_) / threads; }

  /// Blocks of `kernel`. At least one per multiprocessor, even if CUDA returns an error; the launch then reports it.
  template <class... Arguments>
  uint32_t of(void (*kernel)(Arguments...), uint32_t threads, size_t shared_bytes = 0) {
    const auto key = reinterpret_cast<const void*>(kernel);
    const auto end = known_.begin() + count_;
    const auto at = std::find_if(known_.begin(), end, [&](const Known& known) { return known.kernel == key; });
    if (at != end) return at->blocks;
    int blocks = 0;
    const Result<void> done = cuda_check(
        cudaOccupancyMaxActiveBlocksPerMultiprocessor(&blocks, kernel, static_cast<int>(threads), shared_bytes),
        "asking for occupancy");
    const uint32_t all = multiprocessors() * static_cast<uint32_t>(std::max(done ? blocks : 1, 1));
    if (done && count_ < known_.size()) known_[count_++] = {key, all};
    return all;
  }

 private:
  struct Known {
    const void* kernel;
    uint32_t blocks;
  };

  int multiprocessors_ = 0;
  int threads_ = 0;
  std::array<Known, 64> known_{};
  uint32_t count_ = 0;
};

}  // namespace scree::kernels
