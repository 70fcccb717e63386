// What GPUs do differently: instructions that compute capability 7.5 lacks, and the blocks that a multiprocessor's
// shared memory holds. The results are the same on all of them.
#pragma once

#include <cuda_pipeline_primitives.h>
#include <cuda_runtime.h>

#include <cstdint>

#include "kernels/math.h"

namespace scree::kernels {

/// A warp's lanes.
inline constexpr uint32_t kWarpLanes = 32;

/// The compute capability whose code is built, times 10. The build option SCREE_CUDA_PATH makes a newer GPU take the
/// code of an older one, so that the code can be tested there.
#if defined(SCREE_CUDA_PATH)
inline constexpr uint32_t kCapability = SCREE_CUDA_PATH;
#elif defined(__CUDA_ARCH__)
inline constexpr uint32_t kCapability = __CUDA_ARCH__ / 10;
#else
inline constexpr uint32_t kCapability = 90;  // the host's pass of the compiler
#endif

/// Shared memory of a multiprocessor, in bytes (CUDA C++ Programming Guide, "Compute Capabilities").
constexpr uint32_t shared_bytes_of(uint32_t capability) {
  switch (capability) {
    case 75:
      return 64 << 10;
    case 80:
    case 87:
      return 164 << 10;
    case 86:
    case 89:
    case 120:
    case 121:
      return 100 << 10;
    default:
      return 228 << 10;
  }
}

/// Blocks of `bytes` of shared memory that a multiprocessor holds at once, at least 1 and at most `most`: a bound for
/// __launch_bounds__, so that registers are not saved for blocks that never come. The system keeps 1 KiB per block.
constexpr uint32_t blocks_in_shared(uint64_t bytes, uint32_t most) {
  const auto blocks = static_cast<uint32_t>(shared_bytes_of(kCapability) / (bytes + 1024));
  return blocks > most ? most : blocks == 0 ? 1 : blocks;
}

/// The lanes' values joined by `join`, in every lane of a whole warp; five shuffles.
template <class T, class Join>
__device__ inline T join_lanes(T value, const Join& join) {
  for (uint32_t step = kWarpLanes / 2; step != 0; step /= 2) value = join(value, __shfl_xor_sync(~0u, value, step));
  return value;
}

/// The sum, the largest and the bitwise or of the lanes' 32-bit values, in every lane of a whole warp. `kOne`: by the
/// one instruction that compute capability 8.0 brought.
template <bool kOne = (kCapability >= 80), class T>
__device__ inline T sum_of_lanes(T value) {
  static_assert(sizeof(T) == 4);
  if constexpr (kOne) {
    return __reduce_add_sync(~0u, value);
  } else {
    return join_lanes(value, [](T a, T b) { return a + b; });
  }
}
template <bool kOne = (kCapability >= 80), class T>
__device__ inline T largest_of_lanes(T value) {
  static_assert(sizeof(T) == 4);
  if constexpr (kOne) {
    return __reduce_max_sync(~0u, value);
  } else {
    return join_lanes(value, [](T a, T b) { return max_of(a, b); });
  }
}
template <bool kOne = (kCapability >= 80), class T>
__device__ inline T bits_of_lanes(T value) {
  static_assert(sizeof(T) == 4);
  if constexpr (kOne) {
    return __reduce_or_sync(~0u, value);
  } else {
    return join_lanes(value, [](T a, T b) { return a | b; });
  }
}

/// Sum over the lanes before this one of a full warp; `total`: over all lanes.
template <class T>
__device__ inline T sum_before(T value, uint32_t lane, T& total) {
  T sum = value;
  for (uint32_t distance = 1; distance < kWarpLanes; distance *= 2) {
    const T other = __shfl_up_sync(~0u, sum, distance);
    if (lane >= distance) sum += other;
  }
  total = __shfl_sync(~0u, sum, kWarpLanes - 1);
  return sum - value;
}

/// Copies runs of up to 64 pieces of 16 bytes to shared memory by a warp: each is begun while the warp works on the one
/// before. begin() starts a copy, in which lane i takes the pieces i and i + 32. commit() follows every begin(), and
/// once more where nothing is left to copy. After wait() and __syncwarp() all copies but the last committed one are
/// there. `kAsync`: past the registers (cp.async, compute capability 8.0); else a lane holds its pieces of the last
/// copy in registers until the next commit.
template <bool kAsync = (kCapability >= 80)>
class StageCopy {
 public:
  __device__ void begin(uint4* to, const uint4* from, uint32_t pieces) {
    const uint32_t lane = threadIdx.x % kWarpLanes;
    if (lane < pieces) __pipeline_memcpy_async(to + lane, from + lane, sizeof(uint4));
    if (lane + kWarpLanes < pieces)
      __pipeline_memcpy_async(to + lane + kWarpLanes, from + lane + kWarpLanes, sizeof(uint4));
  }
  __device__ void commit() { __pipeline_commit(); }
  __device__ void wait() { __pipeline_wait_prior(1); }
};

template <>
class StageCopy<false> {
 public:
  __device__ void begin(uint4* to, const uint4* from, uint32_t pieces) {
    store();
    const uint32_t lane = threadIdx.x % kWarpLanes;
    to_ = to + lane;
    pieces_ = pieces > lane ? pieces - lane : 0;
    if (pieces_ != 0) first_ = from[lane];
    if (pieces_ > kWarpLanes) second_ = from[lane + kWarpLanes];
    is_new_ = true;
  }
  __device__ void commit() {
    if (!is_new_) store();
    is_new_ = false;
  }
  __device__ void wait() {}

 private:
  __device__ void store() {
    if (pieces_ != 0) to_[0] = first_;
    if (pieces_ > kWarpLanes) to_[kWarpLanes] = second_;
    pieces_ = 0;
  }

  uint4 first_{};
  uint4 second_{};
  uint4* to_ = nullptr;
  uint32_t pieces_ = 0;  // this lane's and those after it, of the copy that its registers hold
  bool is_new_ = false;  // begun since the last commit
};

}  // namespace scree::kernels
