// The CSV row of a measured frame. docs/results/README.md describes the columns.
#pragma once

#include "lab/report/case_result.h"
#include "tools/bench/csv.h"

namespace scree::lab {

bench::CsvCells case_cells(const Machine& machine, const CaseResult& result);

}  // namespace scree::lab
