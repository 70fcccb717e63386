#include "tools/common/output/human.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace scree::tools {

std::string fixed(double number, int digits) {
  char text[400];  // the largest double has 309 digits before the point
  std::snprintf(text, sizeof text, "%.*f", digits, number);
  return text;
}

std::string grouped(uint64_t number) {
  std::string digits = std::to_string(number);
  for (size_t place = digits.size(); place > 3; place -= 3) digits.insert(place - 3, ",");
  return digits;
}

std::string short_number(double number) {
  const double size = std::fabs(number);
  if (number == 0) return "0";
  if (!std::isfinite(number)) return number > 0 ? "inf" : number < 0 ? "-inf" : "nan";
  if (size >= 999.5 && size < 1e15) return (number < 0 ? "-" : "") + grouped(static_cast<uint64_t>(std::llround(size)));
  if (size < 1e-5 || size >= 1e15) {
    char text[64];
    std::snprintf(text, sizeof text, "%.2e", number);
    return text;
  }
  return fixed(number, std::max(0, 2 - static_cast<int>(std::floor(std::log10(size * 1.0000001)))));
}

}  // namespace scree::tools
