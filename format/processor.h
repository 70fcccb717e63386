// Features of the processor.
#pragma once

namespace scree::format {

/// Whether code built for AVX2 runs here.
inline bool has_avx2() {
#if defined(__x86_64__)
  static const bool has = __builtin_cpu_supports("avx2");
  return has;
#else
  return false;
#endif
}

}  // namespace scree::format
