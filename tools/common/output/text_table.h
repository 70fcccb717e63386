// Text in aligned columns.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace scree::inspect {

/// Rows of cells. Every column is as wide as its widest cell; the first `left` columns are flush left, the others flush
/// right. Cells are UTF-8; a code point counts as one column.
class TextTable {
 public:
  explicit TextTable(size_t left = 1, size_t indent = 2) : left_(left), indent_(indent) {}

  void row(std::vector<std::string> cells) { rows_.push_back({std::move(cells), false}); }
  /// A horizontal rule below or above the cells.
  void rule() { rows_.push_back({{}, true}); }
  bool empty() const { return rows_.empty(); }
  std::string text() const;

 private:
  struct Row {
    std::vector<std::string> cells;
    bool is_rule;
  };
  size_t left_;
  size_t indent_;
  std::vector<Row> rows_;
};

/// `name` as one printable line of at most `width` letters. Control characters, which could move a terminal's cursor,
/// and bytes that are not UTF-8 become '?'. A longer name is cut and ends in "...".
std::string printable(std::string_view name, size_t width = 40);

}  // namespace scree::inspect
