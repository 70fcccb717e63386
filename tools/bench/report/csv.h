// Measured rows as CSV (RFC 4180): one header line, a row a case. docs/results/README.md says what the columns mean.
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "format/result.h"
#include "tools/bench/report/case_result.h"

namespace scree::bench {

/// A row's cells, each with its column: the two stand side by side where a row is made, so that they cannot come apart.
using CsvCells = std::vector<std::pair<std::string, std::string>>;

/// The columns, or the values, of a row; without the line's end.
std::string csv_columns(const CsvCells& cells);
std::string csv_values(const CsvCells& cells);

/// Six significant digits; "inf".
std::string csv_number(double value);
std::string csv_number(uint64_t value);

/// Of a measured frame.
std::string csv_header();
std::string csv_row(const Machine& machine, const CaseResult& result);

/// Appends a row; a new or empty file gets the header first. Errors kFile; kFormat: the file's first line is not this
/// header, so the row would stand under other columns.
Result<void> append_csv(const std::string& path, const std::string& header, const std::string& row);

}  // namespace scree::bench
