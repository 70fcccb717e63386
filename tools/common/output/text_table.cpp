#include "tools/common/output/text_table.h"

#include <algorithm>
#include <cstdint>

#include "format/text.h"

namespace scree::inspect {
namespace {

constexpr size_t kGap = 2;  // spaces between two columns

size_t letters(std::string_view text) {
  return static_cast<size_t>(std::count_if(text.begin(), text.end(), [](char c) { return (c & 0xc0) != 0x80; }));
}

}  // namespace

std::string TextTable::text() const {
  std::vector<size_t> widths;
  for (const Row& row : rows_) {
    widths.resize(std::max(widths.size(), row.cells.size()));
    for (size_t i = 0; i < row.cells.size(); ++i) widths[i] = std::max(widths[i], letters(row.cells[i]));
  }
  size_t total = 0;
  for (size_t i = 0; i < widths.size(); ++i) total += widths[i] + (i == 0 ? 0 : kGap);
  std::string text;
  for (const Row& row : rows_) {
    std::string line(indent_, ' ');
    if (row.is_rule) line.append(total, '-');
    for (size_t i = 0; i < row.cells.size(); ++i) {
      const std::string fill(widths[i] - letters(row.cells[i]), ' ');
      if (i > 0) line.append(kGap, ' ');
      line += i < left_ ? row.cells[i] + fill : fill + row.cells[i];
    }
    line.erase(line.find_last_not_of(' ') + 1);
    text += line + '\n';
  }
  return text;
}

std::string printable(std::string_view name, size_t width) {
  std::string text;
  size_t count = 0;
  while (!name.empty()) {
    if (count++ == width) {
      // Removes three letters to make room for the dots.
      for (int i = 0; i < 3 && !text.empty(); ++i) {
        while ((text.back() & 0xc0) == 0x80) text.pop_back();
        text.pop_back();
      }
      return text + "...";
    }
    const size_t length = format::utf8_length(name);
    const auto first = static_cast<uint8_t>(name[0]);
    // U+0080 to U+009F are control characters too.
    const bool is_control =
        first < 0x20 || first == 0x7f || (length == 2 && first == 0xc2 && static_cast<uint8_t>(name[1]) < 0xa0);
    if (length == 0 || is_control) {
      text += '?';
    } else {
      text.append(name.substr(0, length));
    }
    name.remove_prefix(std::max<size_t>(length, 1));
  }
  return text;
}

}  // namespace scree::inspect
