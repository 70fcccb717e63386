// sRGB coding of 8-bit colour. Source: IEC 61966-2-1.
#pragma once

#include <cstdint>

namespace scree::runtime {

/// Linear light, 0 to 1, of a code.
float linear_of_srgb(uint8_t code);

/// The code nearest to linear light in code space, exactly: the rounding of the formula, without its pow(). Below 0 and
/// NaN give 0, above 1 gives 255.
uint8_t srgb_of_linear(float linear);

}  // namespace scree::runtime
