// Makes errors from parts of a message. A template, so that hot loops need no memory for the parts unless a check
// fails.
#pragma once

#include <cstdio>
#include <string>
#include <string_view>
#include <type_traits>

#include "format/result.h"

namespace scree {

inline void append_part(std::string& text, std::string_view part) {
  text += part;
}
inline void append_part(std::string& text, double part) {
  char digits[32];
  std::snprintf(digits, sizeof digits, "%g", part);
  text += digits;
}
template <class Integer>
requires std::is_integral_v<Integer> || std::is_enum_v<Integer>
void append_part(std::string& text, Integer part) {
  if constexpr (std::is_enum_v<Integer>)
    text += std::to_string(static_cast<std::underlying_type_t<Integer>>(part));
  else
    text += std::to_string(part);
}

/// An error whose message consists of `parts`: texts, and numbers in decimal. `parts` are values, because references
/// would need memory.
template <class... Parts>
[[gnu::noinline, gnu::cold]] Error fail(ErrorCode code, Parts... parts) {
  Error error{code, {}};
  (append_part(error.message, parts), ...);
  return error;
}

}  // namespace scree
