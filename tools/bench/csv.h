// Measured rows as CSV (RFC 4180): one header line, a row per case.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "format/result.h"
#include "tools/bench/times.h"

namespace scree::bench {

/// A row's cells, each with its column, so that header and values always agree.
using CsvCells = std::vector<std::pair<std::string, std::string>>;

/// The columns, or the values, of a row, without the line break.
std::string csv_columns(const CsvCells& cells);
std::string csv_values(const CsvCells& cells);

/// Six significant digits; "inf" for infinity.
std::string csv_number(double value);
std::string csv_number(uint64_t value);

/// Adds NAME_ms (the median), NAME_min_ms and NAME_spread_ms; empty cells without times.
void add_times(CsvCells& cells, const std::string& name, const std::optional<Times>& times);

/// Appends a row; a new or empty file gets the header first. Errors kFile; kFormat: the file's first line is not the
/// header of `cells`, so the row would have the wrong columns.
Result<void> append_csv(const std::string& path, const CsvCells& cells);

/// Finds the errors of append_csv() that are known before there are values. Creates no file.
Result<void> check_csv(const std::string& path, const CsvCells& cells);

}  // namespace scree::bench
