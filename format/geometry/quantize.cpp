#include "format/geometry/quantize.h"

#include <algorithm>
#include <bit>
#include <cassert>
#include <cmath>

namespace scree::format {
namespace {

constexpr int32_t kMantissaBits = 23;
constexpr int32_t kNoExponent = 1 << 20;
constexpr int32_t kAllRoundToZero = 130;  // half of this step is above every float, so any interval fits

/// The exponent of float_ulp(value).
int32_t ulp_exponent(float value) {
  const uint32_t biased = (std::bit_cast<uint32_t>(value) >> kMantissaBits) & 0xffu;
  return static_cast<int32_t>(std::max(biased, 1u)) - 127 - kMantissaBits;
}

/// The exponent of the lowest set bit of a value that is not 0, which is the coarsest lattice that contains the value.
int32_t lowest_bit_exponent(float value) {
  const uint32_t bits = std::bit_cast<uint32_t>(value);
  const uint32_t fraction = bits & ((1u << kMantissaBits) - 1);
  const bool normal = ((bits >> kMantissaBits) & 0xffu) != 0;
  return ulp_exponent(value) + std::countr_zero(normal ? fraction | (1u << kMantissaBits) : fraction);
}

/// The largest exponent on whose lattice every float of the interval lies.
int32_t interval_exact_exponent(Interval axis) {
  if (axis.lo == axis.hi) return axis.lo == 0 ? kNoExponent : lowest_bit_exponent(axis.lo);
  if (axis.lo <= 0 && axis.hi >= 0) return kMinLatticeExponent;
  return ulp_exponent(std::min(std::fabs(axis.lo), std::fabs(axis.hi)));
}

}  // namespace

double float_ulp(float value) {
  return exp2i(ulp_exponent(value));
}

LatticeAxis lattice_axis(float lo, float hi, int32_t exponent) {
  assert(lo <= hi && fits_lattice(lo, exponent) && fits_lattice(hi, exponent));
  const int64_t min = quantize(lo, exponent);
  const int64_t max = quantize(hi, exponent);
  return {min, static_cast<uint32_t>(std::bit_width(static_cast<uint64_t>(max - min)))};
}

int32_t exact_exponent(std::span<const Interval> axes) {
  int32_t exponent = kNoExponent;
  for (const Interval& axis : axes) exponent = std::min(exponent, interval_exact_exponent(axis));
  return exponent == kNoExponent ? 0 : exponent;
}

int32_t finest_exponent(std::span<const Interval> axes, uint32_t bits) {
  assert(bits >= 1 && bits <= 24);
  // Starts at or below the first exponent that can fit: rounded ends that are 2^bits - 1 steps apart leave the interval
  // at most 2^bits steps long.
  int32_t exponent = exact_exponent(axes);
  for (const Interval& axis : axes) {
    assert(std::isfinite(axis.lo) && std::isfinite(axis.hi) && axis.lo <= axis.hi);
    const double extent = static_cast<double>(axis.hi) - static_cast<double>(axis.lo);
    if (extent > 0) exponent = std::max(exponent, std::ilogb(extent) - static_cast<int32_t>(bits) - 1);
  }
  const auto fits = [&] {
    return std::all_of(axes.begin(), axes.end(), [&](const Interval& axis) {
      return fits_lattice(axis.lo, exponent) && fits_lattice(axis.hi, exponent) &&
             lattice_axis(axis.lo, axis.hi, exponent).bits <= bits;
    });
  };
  while (exponent < kAllRoundToZero && !fits()) ++exponent;
  return exponent;
}

}  // namespace scree::format
