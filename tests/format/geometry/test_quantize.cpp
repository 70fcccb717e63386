#include "format/geometry/quantize.h"

#include <bit>
#include <cfloat>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "tests/catch.h"

using namespace scree::format;

namespace {

/// A finite float of any magnitude, sign and fraction; often with few significant bits.
float any_float(std::mt19937& random) {
  const uint32_t exponent = static_cast<uint32_t>(random() % 255);
  uint32_t fraction = static_cast<uint32_t>(random()) & 0x7fffffu;
  if (random() % 3 == 0) fraction &= ~uint32_t{0} << (random() % 24);
  return std::bit_cast<float>(static_cast<uint32_t>(random() % 2) << 31 | exponent << 23 | fraction);
}

/// The nearest multiple of 2^exponent, computed with the x87's 64-bit significand, independently of the codec.
long double nearest_step(float value, int32_t exponent) {
  return rintl(ldexpl(static_cast<long double>(value), -exponent));
}

}  // namespace

TEST_CASE("exp2i is the power of two over the whole range of doubles", "[quantize]") {
  for (int32_t exponent = -1022; exponent <= 1023; ++exponent)
    if (exp2i(exponent) != std::ldexp(1.0, exponent)) FAIL(exponent);
  CHECK(exp2i(kMinLatticeExponent) == static_cast<double>(std::numeric_limits<float>::denorm_min()));
}

TEST_CASE("quantize rounds to the nearest coordinate, halves to even", "[quantize]") {
  CHECK(quantize(0.5f, 0) == 0);
  CHECK(quantize(1.5f, 0) == 2);
  CHECK(quantize(2.5f, 0) == 2);
  CHECK(quantize(-0.5f, 0) == 0);
  CHECK(quantize(-1.5f, 0) == -2);
  CHECK(quantize(-2.5f, 0) == -2);
  CHECK(quantize(0.49999997f, 0) == 0);
  CHECK(quantize(8388607.5f, 0) == 8388608);
  CHECK(quantize(8388609.0f, 0) == 8388609);
  CHECK(quantize(FLT_MAX, 127) == 2);
  CHECK(quantize(FLT_TRUE_MIN, -149) == 1);
  CHECK(quantize(-FLT_TRUE_MIN, -148) == 0);
  std::mt19937 random(1);
  int tested = 0;
  for (int i = 0; i < 400000; ++i) {
    const float value = any_float(random);
    const int32_t exponent = -149 + static_cast<int32_t>(random() % 277);
    const long double expected = nearest_step(value, exponent);
    const bool fits = fabsl(ldexpl(static_cast<long double>(value), -exponent)) < 4503599627370496.0L;
    if (fits != fits_lattice(value, exponent)) FAIL(value << " at 2^" << exponent << ": fits " << fits);
    if (!fits) continue;
    ++tested;
    if (quantize(value, exponent) != static_cast<int64_t>(expected)) FAIL(value << " at 2^" << exponent);
  }
  CHECK(tested > 100000);
}

TEST_CASE("dequantize rounds once", "[quantize]") {
  std::mt19937_64 random(2);
  for (int i = 0; i < 400000; ++i) {
    const int64_t coordinate = static_cast<int64_t>(random() >> 11) >> (random() % 53)
                                                                           << (random() % 2 ? 0 : random() % 8);
    if (coordinate > (int64_t{1} << 53)) continue;
    const int64_t turned = random() % 2 ? coordinate : -coordinate;
    const int32_t exponent = -149 + static_cast<int32_t>(random() % 277);
    const auto expected = static_cast<float>(ldexpl(static_cast<long double>(turned), exponent));
    if (dequantize(turned, exponent) != expected) FAIL(turned << " at 2^" << exponent);
  }
  CHECK(dequantize((int64_t{1} << 24) + 1, 0) == 16777216.0f);  // ties go to even
  CHECK(dequantize((int64_t{1} << 24) + 3, 0) == 16777220.0f);
  CHECK(dequantize(3, -150 + 1) == 3 * FLT_TRUE_MIN);
}

TEST_CASE("a dequantised coordinate is within half a step of its value, and exact on a fine lattice", "[quantize]") {
  std::mt19937 random(3);
  for (int i = 0; i < 400000; ++i) {
    const float value = any_float(random);
    const int32_t exponent = -149 + static_cast<int32_t>(random() % 277);
    if (!fits_lattice(value, exponent)) continue;
    const float back = dequantize(quantize(value, exponent), exponent);
    if (!std::isfinite(back)) continue;  // within half a step of 2^128, which choose_lattice refuses
    const double error = std::fabs(static_cast<double>(back) - static_cast<double>(value));
    if (error > 0.5 * exp2i(exponent)) FAIL(value << " at 2^" << exponent << ": off by " << error);
    if (exp2i(exponent) <= float_ulp(value) && error != 0) FAIL(value << " at 2^" << exponent << " is not exact");
  }
}

TEST_CASE("float_ulp is the distance to the next float", "[quantize]") {
  std::mt19937 random(4);
  for (int i = 0; i < 100000; ++i) {
    const float value = std::fabs(any_float(random));
    const float next = std::nextafter(value, std::numeric_limits<float>::infinity());
    if (std::isinf(next)) continue;
    if (float_ulp(value) != static_cast<double>(next) - static_cast<double>(value)) FAIL(value);
    if (float_ulp(-value) != float_ulp(value)) FAIL(-value);
  }
  CHECK(float_ulp(0) == exp2i(-149));
  CHECK(float_ulp(FLT_MAX) == exp2i(104));
}

TEST_CASE("lattice_axis takes the bits of the true integers", "[quantize]") {
  CHECK(lattice_axis(3, 3, 0).bits == 0);
  CHECK(lattice_axis(0, 1, 0).bits == 1);
  CHECK(lattice_axis(0, 65535, 0).bits == 16);
  CHECK(lattice_axis(0, 65536, 0).bits == 17);
  CHECK(lattice_axis(-0.4f, 65535.4f, 0).bits == 16);
  CHECK(lattice_axis(0, 65535.6f, 0).bits == 17);  // the end rounds up
  CHECK(lattice_axis(-5.75f, 8, -2).min == -23);
  CHECK(lattice_axis(-16777216, 16777216, 0).bits == 26);
}

TEST_CASE("finest_exponent is the smallest that fits, and not below the floats' own", "[quantize]") {
  std::mt19937 random(5);
  int at_floats = 0, at_limit = 0, at_bits = 0;
  for (int i = 0; i < 40000; ++i) {
    const uint32_t bits = 1 + static_cast<uint32_t>(random() % 24);
    std::vector<Interval> axes(1 + random() % 3);
    const float scale = std::ldexp(1.0f, static_cast<int>(random() % 200) - 110);
    for (Interval& axis : axes) {
      const float a = random() % 4 == 0 ? any_float(random) * 0x1p-8f
                                        : scale * static_cast<float>(static_cast<int>(random() % 20001) - 10000);
      float b = a;
      if (random() % 4 != 0)
        b += scale * std::ldexp(static_cast<float>(random() % 10000), -static_cast<int>(random() % 24));
      axis = {std::min(a, b), std::max(a, b)};
    }
    const int32_t exponent = finest_exponent(axes, bits);
    const auto fits = [&](int32_t at) {
      for (const Interval& axis : axes) {
        const long double lo = ldexpl(static_cast<long double>(axis.lo), -at);
        const long double hi = ldexpl(static_cast<long double>(axis.hi), -at);
        if (fabsl(lo) >= 0x1p52L || fabsl(hi) >= 0x1p52L) return 1;
        if (rintl(hi) - rintl(lo) > static_cast<long double>((1 << bits) - 1)) return 2;
      }
      return 0;
    };
    if (fits(exponent) != 0) FAIL("2^" << exponent << " does not fit " << bits << " bits");
    const int32_t floats = exact_exponent(axes);
    if (exponent < floats) FAIL("2^" << exponent << " is finer than 2^" << floats);
    if (exponent == floats) {
      ++at_floats;
    } else {
      const int reason = fits(exponent - 1);
      if (reason == 0) FAIL("2^" << exponent - 1 << " fits " << bits << " bits too");
      ++(reason == 1 ? at_limit : at_bits);
    }
  }
  CHECK(at_floats > 100);
  CHECK(at_limit > 100);
  CHECK(at_bits > 1000);
}

TEST_CASE("exact_exponent is the coarsest lattice that contains every float", "[quantize]") {
  CHECK(exact_exponent(std::vector<Interval>{{0, 0}}) == 0);
  CHECK(exact_exponent(std::vector<Interval>{{3, 3}}) == 0);
  CHECK(exact_exponent(std::vector<Interval>{{96, 96}}) == 5);
  CHECK(exact_exponent(std::vector<Interval>{{96, 96}, {0, 0}, {0.75f, 0.75f}}) == -2);
  CHECK(exact_exponent(std::vector<Interval>{{-1, 1}}) == -149);
  CHECK(exact_exponent(std::vector<Interval>{{1, 1000}}) == -23);
  CHECK(exact_exponent(std::vector<Interval>{{-1000, -512}}) == -14);
  CHECK(exact_exponent(std::vector<Interval>{{FLT_TRUE_MIN, FLT_TRUE_MIN}}) == -149);
  CHECK(exact_exponent(std::vector<Interval>{{FLT_MAX, FLT_MAX}}) == 104);
  std::mt19937 random(6);
  for (int i = 0; i < 20000; ++i) {
    const float value = any_float(random);
    if (value == 0) continue;
    const int32_t point = exact_exponent(std::vector<Interval>{{value, value}});
    const long double steps = ldexpl(static_cast<long double>(value), -point);
    if (rintl(steps) != steps || rintl(steps / 2) == steps / 2) FAIL(value << " is not odd at 2^" << point);
  }
}
