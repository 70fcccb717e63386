// Differences between GPUs: instructions that compute capability 7.5 lacks, and the blocks that fit into a
// multiprocessor's shared memory. The results are the same on all GPUs.
#pragma once

#include <cuda_pipeline_primitives.h>
#include <cuda_runtime.h>

#include <cstdint>

#include "kernels/math.h"

namespace scree::kernels {

/// Lanes per warp.
inline constexpr uint32_t kWarpLanes = 32;

/// The compute capability whose code is built, times 10. The build option SCREE_CUDA_PATH gives a newer GPU the code of
/// an older one, for tests.
#if defined(SCREE_CUDA_PATH)
inline constexpr uint32_t kCapability = SCREE_CUDA_PATH;
#elif defined(__CUDA_ARCH__)
inline constexpr uint32_t kCapability = __CUDA_ARCH__ / 10;
#else
inline constexpr uint32_t kCapability = 90;  // in the host's pass of the compiler
#endif

/// Bytes of shared memory per multiprocessor (CUDA C++ Programming Guide, "Compute Capabilities").
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

/// Blocks of `bytes` of shared memory that fit into a multiprocessor, at least 1 and at most `most`. A bound for
/// __launch_bounds__, so that registers are limited only for blocks that fit. The system keeps 1 KiB per block.
constexpr uint32_t blocks_in_shared(uint64_t bytes, uint32_t most) {
  const auto blocks = static_cast<uint32_t>(shared_bytes_of(kCapability) / (bytes + 1024));
  return blocks > most ? most : blocks == 0 ? 1 : blocks;
}

/// The lanes' values combined by `join`, in every lane of a full warp; five shuffles.
template <class T, class Join>
__device__ inline T join_lanes(T value, const Join& join) {
  for (uint32_t step = kWarpLanes / 2; step != 0; step /= 2) value = join(value, __shfl_xor_sync(~0u, value, step));
  return value;
}

/// The sum, the largest and the bitwise or of the lanes' 32-bit values, in every lane of a full warp. `kOne`: computed
/// by the single instruction of compute capability 8.0.
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

/// The sum over the lanes before this one, in a full warp. `total`: the sum over all lanes.
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

/// The number of lanes in `lanes` before this one.
__device__ inline uint32_t rank_among(uint32_t lanes) {
  return static_cast<uint32_t>(__popc(lanes & ((1u << threadIdx.x % kWarpLanes) - 1)));
}

/// Copies runs of up to 64 pieces of 16 bytes to shared memory by a warp. Each copy runs while the warp works on the
/// previous one. begin() starts a copy; lane i takes the pieces i and i + 32. commit() must follow every begin(), and
/// once more when there are no bytes left to copy. After wait() and __syncwarp() all copies but the last committed one
/// are complete. `kAsync`: copies bypass the registers (cp.async, compute capability 8.0); otherwise a lane holds its
/// pieces of the last copy in registers until the next commit.
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
  uint32_t pieces_ = 0;  // pieces from this lane's on, of the copy that its registers hold
  bool is_new_ = false;  // begun since the last commit
};

}  // namespace scree::kernels
