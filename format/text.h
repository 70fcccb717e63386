// Text functions with several users: lower case and UTF-8.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace scree::format {

/// Lower case for ASCII letters, in any locale; other bytes are unchanged.
inline std::string lower_case(std::string_view text) {
  std::string out(text);
  for (char& letter : out)
    if (letter >= 'A' && letter <= 'Z') letter = static_cast<char>(letter - 'A' + 'a');
  return out;
}

/// Bytes of the well-formed UTF-8 sequence at the start of `text` (Unicode 15, table 3-7), or 0 if there is none.
/// `text` must not be empty.
inline size_t utf8_length(std::string_view text) {
  const auto byte = [&](size_t index) { return static_cast<unsigned char>(text[index]); };
  const unsigned char lead = byte(0);
  size_t length = 0;
  unsigned char low = 0x80, high = 0xbf;  // of the second byte
  if (lead < 0x80) return 1;
  if (lead >= 0xc2 && lead <= 0xdf) length = 2;
  if (lead >= 0xe0 && lead <= 0xef) length = 3;
  if (lead >= 0xf0 && lead <= 0xf4) length = 4;
  if (lead == 0xe0) low = 0xa0;
  if (lead == 0xed) high = 0x9f;
  if (lead == 0xf0) low = 0x90;
  if (lead == 0xf4) high = 0x8f;
  if (length == 0 || text.size() < length || byte(1) < low || byte(1) > high) return 0;
  for (size_t i = 2; i < length; ++i)
    if ((byte(i) & 0xc0) != 0x80) return 0;
  return length;
}

/// " (name)" for a message, with at most 100 bytes of the name; empty without a name.
inline std::string in_brackets(std::string_view name) {
  constexpr size_t kMost = 100;
  if (name.empty()) return {};
  if (name.size() <= kMost) return " (" + std::string(name) + ")";
  size_t end = kMost;
  while (end > kMost - 4 && (static_cast<unsigned char>(name[end]) & 0xc0) == 0x80) --end;  // the start of a character
  return " (" + std::string(name.substr(0, end)) + "...)";
}

}  // namespace scree::format
