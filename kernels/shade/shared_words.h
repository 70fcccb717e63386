// Words in memory that the threads of a pass share. The rounds of shading provide all ordering that is needed.
#pragma once

#include <cstdint>

#include "kernels/math.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

SCREE_HD inline uint64_t compare_and_swap(uint64_t* address, uint64_t expected, uint64_t wanted) {
#if defined(__CUDA_ARCH__)
  return atomicCAS(reinterpret_cast<unsigned long long*>(address), static_cast<unsigned long long>(expected),
                   static_cast<unsigned long long>(wanted));
#else
  __atomic_compare_exchange_n(address, &expected, wanted, false, __ATOMIC_RELAXED, __ATOMIC_RELAXED);
  return expected;
#endif
}
SCREE_HD inline uint32_t compare_and_swap(uint32_t* address, uint32_t expected, uint32_t wanted) {
#if defined(__CUDA_ARCH__)
  return atomicCAS(address, expected, wanted);
#else
  __atomic_compare_exchange_n(address, &expected, wanted, false, __ATOMIC_RELAXED, __ATOMIC_RELAXED);
  return expected;
#endif
}
/// Returns the previous value. `address`: in memory that begins and ends at multiples of 4 bytes.
SCREE_HD inline uint8_t fetch_or(uint8_t* address, uint8_t bits) {
#if defined(__CUDA_ARCH__)
  const auto place = reinterpret_cast<uintptr_t>(address);
  const uint32_t shift = 8 * (static_cast<uint32_t>(place) & 3u);
  return static_cast<uint8_t>(atomicOr(reinterpret_cast<uint32_t*>(place - shift / 8), uint32_t{bits} << shift) >>
                              shift);
#else
  return __atomic_fetch_or(address, bits, __ATOMIC_RELAXED);
#endif
}
/// Returns the previous value.
SCREE_HD inline uint32_t fetch_increment(uint32_t* counter) {
#if defined(__CUDA_ARCH__)
  return atomicAdd(counter, 1u);
#else
  return __atomic_fetch_add(counter, 1u, __ATOMIC_RELAXED);
#endif
}
/// On a GPU it may return the value from the start of the kernel.
template <class T>
SCREE_HD inline T load_cached(const T* address) {
#if defined(__CUDA_ARCH__)
  return *address;
#else
  return __atomic_load_n(address, __ATOMIC_RELAXED);
#endif
}
/// Returns the current value.
template <class T>
SCREE_HD inline T load_relaxed(const T* address) {
#if defined(__CUDA_ARCH__)
  return *static_cast<const volatile T*>(address);
#else
  return __atomic_load_n(address, __ATOMIC_RELAXED);
#endif
}
template <class T>
SCREE_HD inline void store_relaxed(T* address, T value) {
#if defined(__CUDA_ARCH__)
  *static_cast<volatile T*>(address) = value;
#else
  __atomic_store_n(address, value, __ATOMIC_RELAXED);
#endif
}

}  // namespace SCREE_ISA
}  // namespace scree::kernels
