// Arithmetic of colours, which need not be equal bit for bit on a CPU and on CUDA.
#pragma once

#include <cmath>

#include "kernels/math.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

/// a * b + c, rounded once on CUDA.
SCREE_HD inline float multiply_add(float a, float b, float c) {
#if defined(__CUDA_ARCH__)
  return __fmaf_rn(a, b, c);
#else
  return a * b + c;
#endif
}
/// Rounded twice everywhere, because layers of floats must be equal bit for bit.
SCREE_HD inline double multiply_add(double a, double b, double c) {
  return a * b + c;
}

/// 1 / value; for a float on CUDA with an error of 1 ulp, and 0 for values above 2^126.
SCREE_HD inline float reciprocal(float value) {
#if defined(__CUDA_ARCH__)
  return __fdividef(1.0f, value);
#else
  return 1.0f / value;
#endif
}
SCREE_HD inline double reciprocal(double value) {
  return 1.0 / value;
}

/// 1 / sqrt(x), on CUDA with an error of 2 ulp; infinite for 0.
SCREE_HD inline float inverse_root(float value) {
#if defined(__CUDA_ARCH__)
  return rsqrtf(value);
#else
  return 1.0f / std::sqrt(value);
#endif
}

/// The logarithm to base 2 of a value above 2^-126, on CUDA with an error of 2^-22 or, outside [0.5, 2], of 3 ulp.
SCREE_HD inline float logarithm(float value) {
#if defined(__CUDA_ARCH__)
  return __log2f(value);
#else
  return std::log2(value);
#endif
}

}  // namespace SCREE_ISA
}  // namespace scree::kernels
