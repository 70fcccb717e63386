// A warp as a team: the atomics and lane functions that the passes need on CUDA.
#pragma once

#include <cstdint>

#include "kernels/cuda/common/warp.cuh"
#include "kernels/raster/queues.h"

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

  /// Keeps the smaller of the sample and `value`. Reads first: most pixels that are drawn again are not nearer, and a
  /// read takes an eighth of the time of an atomic.
  __device__ static void update_min(uint64_t* sample, uint64_t value) {
    if (value < load_relaxed(sample)) atomic_min(sample, value);
  }

  /// Draws a fragment of a blended surface: into the target's slots, or without slots into `sample`. `shown`:
  /// MaskPlane::shown(), not 0.
  __device__ static void draw_blended(const Target& target, uint64_t* sample, uint64_t value, uint32_t shown) {
    const FragmentSlots& to = target.fragments;
    if (to.counts == nullptr) return atomic_min(sample, value);
    const auto place = static_cast<uint64_t>(sample - target.samples);
    // Stops counting, so that the count cannot pass 2^32 whatever the number of fragments.
    if (*static_cast<const volatile uint32_t*>(to.counts + place) > to.slot_count) return;
    const uint32_t slot = atomicAdd(to.counts + place, 1u);
    if (slot >= to.slot_count) return;
    to.words[slot * to.sample_count + place] = value;
    to.alphas[slot * to.sample_count + place] = shown;
  }
};

}  // namespace scree::kernels
