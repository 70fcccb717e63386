// Arithmetic that has the same bits on a CPU and on CUDA: + - * / and one fused multiply-add, built without
// contraction.
#pragma once

#include <cstdint>
#include <cstring>

#include "format/bits.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

/// a * b + c, rounded once. Without -mfma it is a library call with the same bits.
SCREE_HD inline float fused(float a, float b, float c) {
#if defined(__CUDA_ARCH__)
  return __fmaf_rn(a, b, c);
#else
  return __builtin_fmaf(a, b, c);
#endif
}

SCREE_HD inline uint32_t float_bits(float value) {
#if defined(__CUDA_ARCH__)
  return __float_as_uint(value);
#else
  uint32_t bits;
  std::memcpy(&bits, &value, sizeof bits);
  return bits;
#endif
}

SCREE_HD inline float bits_float(uint32_t bits) {
#if defined(__CUDA_ARCH__)
  return __uint_as_float(bits);
#else
  float value;
  std::memcpy(&value, &bits, sizeof value);
  return value;
#endif
}

// If either is NaN the result is the second operand, on every machine (fminf and its relatives differ).
template <class T>
SCREE_HD inline T min_of(T a, T b) {
  return a < b ? a : b;
}
template <class T>
SCREE_HD inline T max_of(T a, T b) {
  return a > b ? a : b;
}

SCREE_HD inline double abs_of(double value) {
  return value < 0 ? -value : value;
}
SCREE_HD inline float abs_of(float value) {
  return bits_float(float_bits(value) & 0x7fffffffu);
}

using format::count_bits;
using format::lowest_bit;

/// Nearest integer, halves to even, of |value| <= 2^51. Adding 1.5 * 2^52 leaves no fraction bits.
SCREE_HD inline double round_even(double value) {
  constexpr double kMagic = 6755399441055744.0;
  return (value + kMagic) - kMagic;
}

/// Nearest integer, halves to even, of |value| <= 2^23. Other values give an unspecified result, without trapping.
SCREE_HD inline float round_even(float value) {
  const float magic = bits_float((float_bits(value) & 0x80000000u) | 0x4b000000u);  // +-2^23
  return (value + magic) - magic;
}

/// The same as an integer; |value| <= 2^23.
SCREE_HD inline int32_t to_int_even(float value) {
#if defined(__CUDA_ARCH__)
  return __float2int_rn(value);
#else
  return static_cast<int32_t>(round_even(value));
#endif
}

}  // namespace SCREE_ISA
}  // namespace scree::kernels
