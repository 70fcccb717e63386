// Lattice coordinates: value <-> integer multiple of a power of two. Source: spec/codecs.md, lattice.
#pragma once

#include <cmath>
#include <cstdint>

#include "format/hd.h"

namespace scree::format {

/// 2^exponent, exact for -1022 <= exponent <= 1023.
SCREE_HD inline double exp2i(int32_t exponent) {
  union {
    uint64_t bits;
    double value;
  } power{static_cast<uint64_t>(exponent + 1023) << 52};
  return power.value;
}

/// The value of a lattice coordinate, rounded once to float. Exact for |coordinate| < 2^53.
SCREE_HD inline float dequantize(int64_t coordinate, int32_t exponent) {
  return static_cast<float>(static_cast<double>(coordinate) * exp2i(exponent));
}

/// The coordinate nearest to a finite value, halves to even. The caller has checked that it fits (LatticeFit does).
inline int64_t quantize(float value, int32_t exponent) {
  return static_cast<int64_t>(std::nearbyint(static_cast<double>(value) * exp2i(-exponent)));
}

/// Which lattice holds an interval.
struct LatticeAxis {
  int64_t min;   // coordinate of code 0
  uint32_t bits; // codes are below 2^bits
};

/// The smallest exponent with which [lo, hi] takes at most `bits` bits on its lattice (1 to 24), or, for a flat interval,
/// the finest that still represents `lo` exactly. lo <= hi, both finite.
int32_t finest_exponent(float lo, float hi, uint32_t bits);

/// The axis of [lo, hi] on the lattice of `exponent`: min = quantize(lo), bits = bit_width(quantize(hi) - min).
LatticeAxis lattice_axis(float lo, float hi, int32_t exponent);

}  // namespace scree::format
