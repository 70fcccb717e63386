// sRGB coding in the passes: 8-bit codes to linear light and back. Source: IEC 61966-2-1.
#pragma once

#include <cmath>
#include <cstdint>

#include "kernels/math.h"

namespace scree::kernels {

/// The tables of the coding, in memory that the passes can read: host or device. make_srgb_tables() fills them.
struct SrgbTables {
  static constexpr uint32_t kBuckets = 4096;
  float linear[256];       // the linear light of a code
  float first_light[257];  // the least light that takes a code; the last entry exceeds every light
  uint8_t
      bucket_code[kBuckets + 1];  // the code of the least light in a bucket; light in [0, 1] is divided into kBuckets
};

SrgbTables make_srgb_tables();

/// The tables in host memory, made once.
const SrgbTables& srgb_tables();

inline namespace SCREE_ISA {

/// The code nearest to linear light in code space: the rounding of the formula. Below 0 and NaN give 0, above 1 gives
/// 255. The same on a CPU and on CUDA.
SCREE_HD inline uint32_t srgb_code(const SrgbTables& tables, float light) {
#if defined(__CUDA_ARCH__)
  const float limited = min_of(light > 0.0f ? light : 0.0f, 1.0f);
  // A gather from a table takes a warp up to 32 steps; the formula takes two instructions of the special function unit,
  // with an error below 2^-10 codes. Only this near to a border between codes is the border read from the table.
  const float code = limited <= 0.0031308f
                         ? limited * (12.92f * 255.0f)
                         : __fmaf_rn(exp2f(log2f(limited) * (1.0f / 2.4f)), 1.055f * 255.0f, -0.055f * 255.0f);
  uint32_t found = static_cast<uint32_t>(to_int_even(code));
  if (abs_of(code - static_cast<float>(found)) > 0.499f) [[unlikely]] {
    while (found > 0 && limited < tables.first_light[found]) --found;
    while (limited >= tables.first_light[found + 1]) ++found;
  }
  return found;
#else
  if (!(light > 0.0f)) return 0;
  if (light >= 1.0f) return 255;
  uint32_t found = tables.bucket_code[static_cast<uint32_t>(light * static_cast<float>(SrgbTables::kBuckets))];
  while (light >= tables.first_light[found + 1]) ++found;
  return found;
#endif
}

}  // namespace SCREE_ISA
}  // namespace scree::kernels
