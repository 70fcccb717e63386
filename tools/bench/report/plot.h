// What `scree bench --plot` does: rows of --curves as pictures.
#pragma once

#include <string>
#include <vector>

#include "format/result.h"
#include "tools/bench/report/svg_chart.h"

namespace scree::bench {

/// A CSV file (RFC 4180) with a first line of columns.
struct CsvTable {
  std::vector<std::string> columns;
  std::vector<std::vector<std::string>> rows;  // each as long as `columns`
};
/// Errors kFile; kFormat: a line with another number of cells, a quote that does not end.
Result<CsvTable> read_csv(const std::string& path);

struct NamedChart {
  std::string name;  // "wrong"
  Chart chart;
};
/// The charts that rows of --curves or --reference have points for. Errors kFormat: no such rows, a cell that is not a
/// number.
Result<std::vector<NamedChart>> curve_charts(const CsvTable& table);

/// Writes curves_NAME.svg beside the CSV file `path` for each chart, and says so on stdout. Errors: those of read_csv
/// and curve_charts, the file named; kFile.
Result<void> plot_csv(const std::string& path);

}  // namespace scree::bench
