// Reads the CSV files that scree and scree-lab write.
#pragma once

#include <map>
#include <sstream>
#include <string>
#include <vector>

#include "tests/catch.h"
#include "tests/tools/temp_folder.h"

namespace scree::tests {

using CsvRow = std::map<std::string, std::string>;  // by column

/// The cells of one line. "a ""b"", c" is a single cell.
inline std::vector<std::string> csv_cells(const std::string& line) {
  std::vector<std::string> cells(1);
  bool quoted = false;
  for (size_t i = 0; i < line.size(); ++i) {
    if (line[i] == '"' && quoted && i + 1 < line.size() && line[i + 1] == '"') {
      cells.back() += line[++i];
    } else if (line[i] == '"') {
      quoted = !quoted;
    } else if (line[i] == ',' && !quoted) {
      cells.emplace_back();
    } else {
      cells.back() += line[i];
    }
  }
  REQUIRE_FALSE(quoted);
  return cells;
}

/// All rows. Each line must have as many cells as the first one.
inline std::vector<CsvRow> read_csv(const std::string& path) {
  std::istringstream lines(read_whole(path));
  std::string line;
  REQUIRE(std::getline(lines, line));
  const std::vector<std::string> columns = csv_cells(line);
  std::vector<CsvRow> rows;
  while (std::getline(lines, line)) {
    const std::vector<std::string> cells = csv_cells(line);
    REQUIRE(cells.size() == columns.size());
    CsvRow& row = rows.emplace_back();
    for (size_t i = 0; i < cells.size(); ++i) row[columns[i]] = cells[i];
  }
  return rows;
}

}  // namespace scree::tests
