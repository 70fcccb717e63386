#include "runtime/srgb.h"

#include <cmath>

namespace scree::runtime {
namespace {

double decode(double code) {
  return code <= 0.04045 ? code / 12.92 : std::pow((code + 0.055) / 1.055, 2.4);
}

}  // namespace

const Srgb& Srgb::tables() {
  static const Srgb made;
  return made;
}

Srgb::Srgb() {
  for (size_t i = 0; i < 256; ++i) {
    linear_[i] = static_cast<float>(decode(static_cast<double>(i) / 255.0));
    first_light_[i] = i == 0 ? 0.0f : static_cast<float>(decode((static_cast<double>(i) - 0.5) / 255.0));
  }
  first_light_[256] = INFINITY;
  size_t code = 0;
  for (size_t i = 0; i <= kBuckets; ++i) {
    while (first_light_[code + 1] <= static_cast<float>(i) / kBuckets) ++code;
    bucket_code_[i] = static_cast<uint8_t>(code);
  }
}

}  // namespace scree::runtime
