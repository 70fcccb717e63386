// sRGB coding of 8-bit colour. Source: IEC 61966-2-1.
#pragma once

#include <algorithm>
#include <cstdint>

#include "kernels/shade/srgb.h"

namespace scree::runtime {

/// The sRGB coding as tables, for loops that keep a reference.
class Srgb {
 public:
  static const Srgb& tables();

  /// The linear light, 0 to 1, of a code.
  float linear(uint8_t code) const { return tables_.linear[code]; }

  /// The code nearest to the linear light, measured in code space: exactly the rounding of the formula, without its
  /// pow(). Values below 0 and NaN give 0, values above 1 give 255.
  uint8_t code(float linear) const { return static_cast<uint8_t>(kernels::srgb_code(tables_, linear)); }

 private:
  Srgb() : tables_(kernels::make_srgb_tables()) {}

  kernels::SrgbTables tables_;
};

/// The code of a number from 0 to 1.
inline uint8_t code_of_number(float number) {
  return static_cast<uint8_t>(std::clamp(number, 0.0f, 1.0f) * 255.0f + 0.5f);
}

/// Srgb::linear() and Srgb::code() with the shared tables.
inline float linear_of_srgb(uint8_t code) {
  return Srgb::tables().linear(code);
}
inline uint8_t srgb_of_linear(float linear) {
  return Srgb::tables().code(linear);
}

}  // namespace scree::runtime
