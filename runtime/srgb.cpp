#include "runtime/srgb.h"

#include <array>
#include <cmath>
#include <cstddef>

namespace scree::runtime {
namespace {

double decode(double code) {
  return code <= 0.04045 ? code / 12.92 : std::pow((code + 0.055) / 1.055, 2.4);
}

struct Tables {
  // Light in [0, 1] falls into buckets; the curve is steepest at 0, where a bucket spans 12.92 * 255 / 4096 = 0.8
  // codes.
  static constexpr size_t kBuckets = 4096;
  std::array<float, 256> linear;
  std::array<float, 257> first_light;             // the least light that takes a code; past the end no light does
  std::array<uint8_t, kBuckets + 1> bucket_code;  // of the least light in a bucket

  Tables() {
    for (size_t i = 0; i < 256; ++i) {
      linear[i] = static_cast<float>(decode(static_cast<double>(i) / 255.0));
      first_light[i] = i == 0 ? 0.0f : static_cast<float>(decode((static_cast<double>(i) - 0.5) / 255.0));
    }
    first_light[256] = INFINITY;
    size_t code = 0;
    for (size_t i = 0; i <= kBuckets; ++i) {
      while (first_light[code + 1] <= static_cast<float>(i) / kBuckets) ++code;
      bucket_code[i] = static_cast<uint8_t>(code);
    }
  }
};

const Tables& tables() {
  static const Tables made;
  return made;
}

}  // namespace

float linear_of_srgb(uint8_t code) {
  return tables().linear[code];
}

uint8_t srgb_of_linear(float linear) {
  if (!(linear > 0.0f)) return 0;
  if (linear >= 1.0f) return 255;
  const Tables& t = tables();
  size_t code = t.bucket_code[static_cast<size_t>(linear * Tables::kBuckets)];
  while (linear >= t.first_light[code + 1]) ++code;
  return static_cast<uint8_t>(code);
}

}  // namespace scree::runtime
