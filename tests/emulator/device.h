// Gives the C++ compiler the names that nvcc predefines for a kernel's source. It is included before everything else of
// an emulated .cu file (CMakeLists.txt here), whose launches and shared memory convert.cmake has rewritten.
#pragma once

#include <cuda_runtime.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <cstring>
#include <tuple>
#include <type_traits>

#include "tests/emulator/machine.h"

// Enables the GPU parts of shared headers.
#define __CUDA_ARCH__ 900

#undef __global__
#undef __device__
#undef __host__
#undef __launch_bounds__
#undef __grid_constant__
#undef __noinline__
#undef __shared__  // convert.cmake leaves none
#define __global__
#define __device__
#define __host__
#define __launch_bounds__(...)
#define __grid_constant__
#define __noinline__

#define threadIdx (::scree::emulator::thread_index())
#define blockIdx (::scree::emulator::block_index())
#define blockDim (::scree::emulator::block_size())
#define gridDim (::scree::emulator::grid_size())

namespace scree::emulator {

/// The `__shared__` variable of type T whose declaration has this number in its source file.
template <class T, uint32_t kDeclaration>
T& shared() {
  return *static_cast<T*>(shared_memory(kDeclaration, sizeof(T)));
}

template <class... P>
std::function<void()> bind_kernel(const void* function, void** parameters) {
  const auto kernel = reinterpret_cast<void (*)(P...)>(const_cast<void*>(function));
  return [&]<size_t... I>(std::index_sequence<I...>)->std::function<void()> {
    return [kernel, kept = std::tuple<P...>(*static_cast<P*>(parameters[I])...)] { std::apply(kernel, kept); };
  }
  (std::index_sequence_for<P...>());
}

/// The launch kernel<<<blocks, threads, shared_bytes, stream>>> of a kernel with parameters P.
template <class... P>
class Launch {
 public:
  Launch(void (*kernel)(P...), const char* name, dim3 blocks, dim3 threads, size_t shared_bytes, cudaStream_t stream)
      : kernel_(reinterpret_cast<const void*>(kernel)),
        blocks_(blocks),
        threads_(threads),
        shared_bytes_(shared_bytes),
        stream_(stream) {
    add_kernel(kernel_, name, bind_kernel<P...>);
  }

  void operator()(P... parameters) const {
    void* places[] = {&parameters..., nullptr};
    (void)::cudaLaunchKernel(kernel_, blocks_, threads_, places, shared_bytes_, stream_);
  }

 private:
  const void* kernel_;
  dim3 blocks_, threads_;
  size_t shared_bytes_;
  cudaStream_t stream_;
};

template <class... P>
Launch<P...> launch(const char* name, void (*kernel)(P...), dim3 blocks, dim3 threads, size_t shared_bytes = 0,
                    cudaStream_t stream = nullptr) {
  return Launch<P...>(kernel, name, blocks, threads, shared_bytes, stream);
}

/// The value that each lane of a mask passed, as its own type. Must be read before the lane's next collective.
template <class T>
class Values {
 public:
  Values(const char* what, uint32_t mask, T value) : what_(what), mask_(mask) {
    static_assert(sizeof(T) <= sizeof(uint64_t) && std::is_trivially_copyable_v<T>);
    uint64_t bits = 0;
    std::memcpy(&bits, &value, sizeof value);
    bits_ = exchange_in_warp(what, mask, bits).values.data();
  }

  T operator[](uint32_t lane) const {
    if ((mask_ >> lane & 1u) == 0) fail("%s(0x%08x) asks lane %u, which is not in it", what_, mask_, lane);
    return value_of(lane);
  }

  /// All values of the mask, combined by `join` one after another.
  template <class Join>
  T joined(Join join) const {
    T all = value_of(static_cast<uint32_t>(std::countr_zero(mask_)));
    for (uint32_t rest = mask_ & (mask_ - 1); rest != 0; rest &= rest - 1)
      all = join(all, value_of(static_cast<uint32_t>(std::countr_zero(rest))));
    return all;
  }

  /// The lanes of the mask for whose value `is_chosen` is true, one bit each.
  template <class Choose>
  uint32_t lanes_where(Choose is_chosen) const {
    uint32_t bits = 0;
    for (uint32_t rest = mask_; rest != 0; rest &= rest - 1)
      if (is_chosen(value_of(static_cast<uint32_t>(std::countr_zero(rest))))) bits |= rest & -rest;
    return bits;
  }

 private:
  T value_of(uint32_t lane) const {
    T value;
    std::memcpy(&value, bits_ + lane, sizeof value);
    return value;
  }

  const char* what_;
  uint32_t mask_;
  const uint64_t* bits_;
};

inline uint32_t lane_number() {
  return threadIdx.x % kWarpLanes;
}

}  // namespace scree::emulator

// The C++ forms of calls that take a kernel.
template <class... P>
cudaError_t cudaFuncSetAttribute(void (*kernel)(P...), cudaFuncAttribute attribute, int value) {
  return ::cudaFuncSetAttribute(reinterpret_cast<const void*>(kernel), attribute, value);
}
template <class... P>
cudaError_t cudaOccupancyMaxActiveBlocksPerMultiprocessor(int* blocks, void (*kernel)(P...), int threads,
                                                          size_t shared_bytes) {
  return ::cudaOccupancyMaxActiveBlocksPerMultiprocessorWithFlags(blocks, reinterpret_cast<const void*>(kernel),
                                                                  threads, shared_bytes, 0);
}

// Collectives (CUDA C++ Programming Guide, "Warp ...Functions").
template <class T>
T __shfl_sync(uint32_t mask, T value, uint32_t lane) {
  return scree::emulator::Values<T>("__shfl_sync", mask, value)[lane % scree::emulator::kWarpLanes];
}
template <class T>
T __shfl_xor_sync(uint32_t mask, T value, uint32_t lanes) {
  return scree::emulator::Values<T>("__shfl_xor_sync", mask, value)[scree::emulator::lane_number() ^ lanes];
}
template <class T>
T __shfl_up_sync(uint32_t mask, T value, uint32_t delta) {
  const scree::emulator::Values<T> values("__shfl_up_sync", mask, value);
  const uint32_t lane = scree::emulator::lane_number();
  return lane < delta ? value : values[lane - delta];
}
inline uint32_t __ballot_sync(uint32_t mask, bool value) {
  return scree::emulator::exchange_in_warp("__ballot_sync", mask, value).odd;
}
template <class T>
uint32_t __match_any_sync(uint32_t mask, T value) {
  return scree::emulator::Values<T>("__match_any_sync", mask, value).lanes_where([&](T one) { return one == value; });
}
template <class T>
T __reduce_add_sync(uint32_t mask, T value) {
  return scree::emulator::Values<T>("__reduce_add_sync", mask, value).joined([](T a, T b) { return a + b; });
}
template <class T>
T __reduce_max_sync(uint32_t mask, T value) {
  return scree::emulator::Values<T>("__reduce_max_sync", mask, value).joined([](T a, T b) { return std::max(a, b); });
}
inline uint32_t __reduce_or_sync(uint32_t mask, uint32_t value) {
  return scree::emulator::Values<uint32_t>("__reduce_or_sync", mask, value).joined([](uint32_t a, uint32_t b) {
    return a | b;
  });
}
inline void __threadfence_system() {}
inline void __syncwarp(uint32_t mask = ~0u) {
  scree::emulator::exchange_in_warp("__syncwarp", mask, 0);
}
inline void __syncthreads() {
  scree::emulator::sync_block();
}

// Atomics.
template <class T>
T atomicAdd(T* at, std::type_identity_t<T> value) {
  scree::emulator::pause_at_atomic();
  return std::atomic_ref(*at).fetch_add(value);
}
/// Replaces the value at an address by `choose(value)`. Returns the old value.
template <class T, class Choose>
T atomic_change(T* at, Choose choose) {
  scree::emulator::pause_at_atomic();
  const std::atomic_ref there(*at);
  T was = there.load();
  while (!there.compare_exchange_weak(was, choose(was))) {
  }
  return was;
}
template <class T>
T atomicMin(T* at, std::type_identity_t<T> value) {
  return atomic_change(at, [&](T was) { return std::min(was, value); });
}
template <class T>
T atomicMax(T* at, std::type_identity_t<T> value) {
  return atomic_change(at, [&](T was) { return std::max(was, value); });
}
template <class T>
T atomicAnd(T* at, std::type_identity_t<T> value) {
  return atomic_change(at, [&](T was) { return was & value; });
}
template <class T>
T atomicOr(T* at, std::type_identity_t<T> value) {
  return atomic_change(at, [&](T was) { return was | value; });
}
template <class T>
T atomicExch(T* at, std::type_identity_t<T> value) {
  return atomic_change(at, [&](T) { return value; });
}
template <class T>
T atomicCAS(T* at, std::type_identity_t<T> expected, std::type_identity_t<T> value) {
  scree::emulator::pause_at_atomic();
  std::atomic_ref(*at).compare_exchange_strong(expected, value);
  return expected;
}

// Bits (CUDA Math API, "Integer Intrinsics", "Type Casting Intrinsics").
inline int __popc(uint32_t value) {
  return std::popcount(value);
}
inline int __ffs(uint32_t value) {
  return value == 0 ? 0 : std::countr_zero(value) + 1;
}
inline int __clz(int value) {
  return std::countl_zero(static_cast<uint32_t>(value));
}
inline uint32_t __fns(uint32_t mask, uint32_t base, int offset) {
  if (offset <= 0) scree::emulator::fail("__fns: only offsets above 0 are emulated, not %d", offset);
  for (uint32_t bit = base; bit < 32; ++bit)
    if ((mask >> bit & 1u) != 0 && --offset == 0) return bit;
  return ~0u;
}
inline uint32_t __funnelshift_r(uint32_t low, uint32_t high, uint32_t shift) {
  return static_cast<uint32_t>((uint64_t{high} << 32 | low) >> (shift & 31u));
}
inline uint32_t __funnelshift_rc(uint32_t low, uint32_t high, uint32_t shift) {
  return static_cast<uint32_t>((uint64_t{high} << 32 | low) >> std::min(shift, 32u));
}
inline uint32_t __funnelshift_l(uint32_t low, uint32_t high, uint32_t shift) {
  return static_cast<uint32_t>((uint64_t{high} << 32 | low) << (shift & 31u) >> 32);
}
inline uint32_t __byte_perm(uint32_t low, uint32_t high, uint32_t selector) {
  const uint64_t bytes = uint64_t{high} << 32 | low;
  uint32_t out = 0;
  for (uint32_t i = 0; i < 4; ++i) {
    const uint32_t pick = selector >> 4 * i & 15u;
    const auto byte = static_cast<uint32_t>(bytes >> 8 * (pick & 7u)) & 0xffu;
    if ((pick & 8u) != 0) scree::emulator::fail("__byte_perm: selector 0x%x", selector);
    out |= byte << 8 * i;
  }
  return out;
}
/// `join` applied to both halves of two words, each half a T.
template <class T, class Join>
uint32_t join_halves(uint32_t a, uint32_t b, Join join) {
  const auto half = [&](uint32_t shift) {
    return uint32_t{static_cast<uint16_t>(join(static_cast<T>(a >> shift), static_cast<T>(b >> shift)))} << shift;
  };
  return half(16) | half(0);
}
inline uint32_t __vmaxu2(uint32_t a, uint32_t b) {
  return join_halves<uint16_t>(a, b, [](uint16_t x, uint16_t y) { return std::max(x, y); });
}
inline uint32_t __vminu2(uint32_t a, uint32_t b) {
  return join_halves<uint16_t>(a, b, [](uint16_t x, uint16_t y) { return std::min(x, y); });
}
inline uint32_t __vmaxs2(uint32_t a, uint32_t b) {
  return join_halves<int16_t>(a, b, [](int16_t x, int16_t y) { return std::max(x, y); });
}
inline uint32_t __vmins2(uint32_t a, uint32_t b) {
  return join_halves<int16_t>(a, b, [](int16_t x, int16_t y) { return std::min(x, y); });
}
inline uint32_t __vsub2(uint32_t a, uint32_t b) {
  return join_halves<uint16_t>(a, b, [](uint16_t x, uint16_t y) { return static_cast<uint16_t>(x - y); });
}
inline uint32_t __vimax3_u16x2(uint32_t a, uint32_t b, uint32_t c) {
  return __vmaxu2(__vmaxu2(a, b), c);
}
inline uint32_t __vimin3_u16x2(uint32_t a, uint32_t b, uint32_t c) {
  return __vminu2(__vminu2(a, b), c);
}
inline uint32_t __vimax3_s16x2(uint32_t a, uint32_t b, uint32_t c) {
  return __vmaxs2(__vmaxs2(a, b), c);
}
inline uint32_t __vimin3_s16x2(uint32_t a, uint32_t b, uint32_t c) {
  return __vmins2(__vmins2(a, b), c);
}
inline uint32_t __float_as_uint(float value) {
  return std::bit_cast<uint32_t>(value);
}
inline float __uint_as_float(uint32_t bits) {
  return std::bit_cast<float>(bits);
}
inline float __int_as_float(int bits) {
  return std::bit_cast<float>(bits);
}
inline float __fmaf_rn(float a, float b, float c) {
  return std::fma(a, b, c);
}
inline double __fma_rn(double a, double b, double c) {
  return std::fma(a, b, c);
}
inline float rsqrtf(float value) {
  return 1.0f / std::sqrt(value);
}
inline void sincospi(double turns, double* sine, double* cosine) {
  *sine = std::sin(turns * M_PI);
  *cosine = std::cos(turns * M_PI);
}
inline float __fdividef(float a, float b) {
  return a / b;
}
inline int __float2int_rn(float value) {
  return static_cast<int>(std::lrintf(value));
}
template <class T>
T __ldg(const T* at) {
  return *at;
}

// For kernels/cuda/common/graph.h, which binds a graph's nodes like launches.
#ifndef SCREE_EMULATED_CUDA
#define SCREE_EMULATED_CUDA
#endif
