// sRGB coding of 8-bit colour. Source: IEC 61966-2-1.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace scree::runtime {

/// The coding as tables, for loops that keep a reference.
class Srgb {
 public:
  static const Srgb& tables();

  /// Linear light, 0 to 1, of a code.
  float linear(uint8_t code) const { return linear_[code]; }

  /// The code nearest to linear light in code space, exactly: the rounding of the formula, without its pow(). Below 0
  /// and NaN give 0, above 1 gives 255.
  uint8_t code(float linear) const {
    if (!(linear > 0.0f)) return 0;
    if (linear >= 1.0f) return 255;
    size_t found = bucket_code_[static_cast<size_t>(linear * kBuckets)];
    while (linear >= first_light_[found + 1]) ++found;
    return static_cast<uint8_t>(found);
  }

 private:
  Srgb();

  // Light in [0, 1] falls into buckets; the curve is steepest at 0, where a bucket spans 12.92 * 255 / 4096 = 0.8
  // codes.
  static constexpr size_t kBuckets = 4096;
  std::array<float, 256> linear_;
  std::array<float, 257> first_light_;             // the least light that takes a code; past the end no light does
  std::array<uint8_t, kBuckets + 1> bucket_code_;  // of the least light in a bucket
};

inline float linear_of_srgb(uint8_t code) {
  return Srgb::tables().linear(code);
}
inline uint8_t srgb_of_linear(float linear) {
  return Srgb::tables().code(linear);
}

}  // namespace scree::runtime
