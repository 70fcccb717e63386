// Measured rows as CSV (RFC 4180): one header line, a row a case. docs/results/README.md says what the columns mean.
#pragma once

#include <string>

#include "format/result.h"
#include "tools/bench/case_result.h"

namespace scree::bench {

/// Without the line's end.
std::string csv_header();
std::string csv_row(const Machine& machine, const CaseResult& result);

/// Appends a row; a new or empty file gets the header first. Errors kFile; kFormat: the file's first line is not this
/// header, so the row would stand under other columns.
Result<void> append_csv(const std::string& path, const std::string& row);

}  // namespace scree::bench
