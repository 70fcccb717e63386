// A warp as a team: the atomics and lanes that the passes need to run on CUDA. The kernels that run them are in this
// folder; docs/frame.md lists every launch of a frame.
#pragma once

#include <cstdint>

#include "kernels/cuda/warp.cuh"

namespace scree::kernels {

/// One warp as a team of 32 lanes.
struct WarpTeam {
  static constexpr bool kCachesVertices = false;
  static constexpr bool kDrawsRuns = false;
  static constexpr bool kMakesTransforms = false;

  __device__ uint32_t rank() const { return threadIdx.x & 31u; }
  __device__ static constexpr uint32_t size() { return 32; }

  __device__ static uint64_t add(uint64_t* counter, uint64_t value) {
    return atomicAdd(reinterpret_cast<unsigned long long*>(counter), value);
  }

  __device__ static uint64_t load_relaxed(const uint64_t* sample) {
    return *static_cast<const volatile uint64_t*>(sample);
  }
  __device__ static void atomic_min(uint64_t* sample, uint64_t value) {
    atomicMin(reinterpret_cast<unsigned long long*>(sample), value);
  }

  /// The smaller of the sample and `value` stays. Reads first: most pixels that are drawn again lose, and a read is an
  /// eighth of the price of an atomic.
  __device__ static void update_min(uint64_t* sample, uint64_t value) {
    if (value < load_relaxed(sample)) atomic_min(sample, value);
  }
};

}  // namespace scree::kernels
