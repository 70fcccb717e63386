// Numbers formatted for people.
#pragma once

#include <cstdint>
#include <string>

namespace scree::tools {

/// With `digits` digits after the point.
std::string fixed(double number, int digits);

/// "18,900,000,000".
std::string grouped(uint64_t number);

/// Three significant digits; without an exponent if that is short ("0.000122", "37.4", "12,345"), else like "1.19e-07".
std::string short_number(double number);

}  // namespace scree::tools
