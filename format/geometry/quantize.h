// Lattice coordinates: value <-> integer multiple of a power of two. Source: spec/codecs.md, lattice.
#pragma once

#include <cstdint>
#include <cstring>
#include <span>

#include "format/hd.h"

namespace scree::format {

/// Every float32 is a multiple of 2^-149 and below 2^128, so finer or coarser steps are never needed.
inline constexpr int32_t kMinLatticeExponent = -149;
inline constexpr int32_t kMaxLatticeExponent = 127;

/// Coordinates stay below this in magnitude, so that a coordinate plus a code is exact in a double.
inline constexpr int64_t kLatticeLimit = int64_t{1} << 52;

/// 2^exponent, exact for -1022 <= exponent <= 1023.
SCREE_HD inline double exp2i(int32_t exponent) {
  const uint64_t bits = static_cast<uint64_t>(exponent + 1023) << 52;
  double value;
  memcpy(&value, &bits, sizeof value);
  return value;
}

/// The value of a lattice coordinate, rounded once, to float: the product and the conversion to double are exact for
/// |coordinate| <= 2^53 and exponents of the lattice.
SCREE_HD inline float dequantize(int64_t coordinate, int32_t exponent) {
  return static_cast<float>(static_cast<double>(coordinate) * exp2i(exponent));
}

/// Adding 1.5 * 2^52 leaves no bits below 1, so the addition rounds, and is faster than a call of nearbyint(). Above
/// 2^23 a scaled float is an integer with at most 24 significant bits, so adding and subtracting are exact there.
inline constexpr double kRounder = 6755399441055744.0;

/// The coordinate nearest to a finite value, halves to even. The caller has checked that it fits (fits_lattice()).
SCREE_HD inline int64_t quantize(float value, int32_t exponent) {
  const double scaled = static_cast<double>(value) * exp2i(-exponent);
  return static_cast<int64_t>((scaled + kRounder) - kRounder);
}

/// Whether quantize(value, exponent) is below kLatticeLimit in magnitude. `value` is finite, `exponent` one of a
/// lattice.
inline bool fits_lattice(float value, int32_t exponent) {
  const double scaled = static_cast<double>(value) * exp2i(-exponent);
  return scaled < static_cast<double>(kLatticeLimit) && scaled > -static_cast<double>(kLatticeLimit);
}

/// An interval on a lattice.
struct LatticeAxis {
  int64_t min;    // coordinate of code 0
  uint32_t bits;  // codes are below 2^bits
};

/// The axis of [lo, hi] on the lattice of `exponent`: min = quantize(lo), bits = bit_width(quantize(hi) - min). Both
/// ends must fit the lattice.
LatticeAxis lattice_axis(float lo, float hi, int32_t exponent);

/// A closed interval of finite floats, lo <= hi.
struct Interval {
  float lo;
  float hi;
};

/// The smallest exponent with which every interval takes at most `bits` bits (1 to 24) after its ends are rounded, and
/// no coordinate reaches kLatticeLimit. Not below exact_exponent(), since a finer step changes nothing.
int32_t finest_exponent(std::span<const Interval> axes, uint32_t bits);

/// The largest exponent on whose lattice every float of every interval lies, so that quantising loses nothing. An
/// interval of one point counts as that point. 0 if all are the point 0.
int32_t exact_exponent(std::span<const Interval> axes);

/// The spacing of floats at `value`, towards infinity: 2^-149 at 0.
double float_ulp(float value);

}  // namespace scree::format
