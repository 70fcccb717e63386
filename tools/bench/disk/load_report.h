// How fast .scree files load: `scree bench --load`.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "format/result.h"
#include "tools/bench/disk/file_cache.h"
#include "tools/bench/disk/timed_load.h"
#include "tools/bench/report/case_result.h"
#include "tools/bench/report/csv.h"
#include "tools/bench/setup/options.h"
#include "tools/common/backend.h"

namespace scree::bench {

struct LoadOptions {
  std::vector<std::string> files;
  tools::BackendOptions backend;
  LoadSettings settings;
  uint32_t repeats = 5;
  std::string csv;  // empty: none
};

/// A file, loaded one way from one state of the page cache, several times.
struct LoadRow {
  std::string file;
  LoadWay way = LoadWay::kMap;
  bool is_cold = false;
  double cached_share = 0;  // of the file before its loads: cold the most, else the least
  uint32_t threads = 0;     // asked for
  TimedLoad last;           // its sizes
  Times resident;           // ms, as the others
  Times first_frame;
  Times resident_cpu;
  double raw_gb_per_s = 0;  // of the same file past the page cache in the same run, the median; 0: not to be had
  uint64_t raw_bytes = 0;   // that each of those reads took
  uint32_t raw_in_flight = 0;

  double gb_per_s() const { return static_cast<double>(last.read_bytes) * 1e-6 / resident.median; }
};

CsvCells load_cells(const Machine& machine, const LoadRow& row);

/// Times, rates and shares of the disk's rate.
std::string load_table(const std::vector<LoadRow>& rows);

/// What each file would take from disks of 1, 3 and 7 GB/s: the larger of reading it at that rate and its fastest load
/// from the page cache. Empty without such rows.
std::string disk_table(const std::vector<LoadRow>& rows);

/// Loads `path` `repeats` times in each of `ways`, cold (dropped from the page cache, which is then looked at) and,
/// where `is_cached_too` and the way goes through it, from the page cache; the raw disk is read once beside each
/// repeat, so that all meet the same neighbours, with as many reads in flight as were fastest the first time. `notes`:
/// what could not be measured, and why. Errors: those of timed_load; kFile.
Result<std::vector<LoadRow>> measure_loads(const std::string& path, const std::vector<LoadWay>& ways,
                                           bool is_cached_too, uint32_t repeats, const LoadSettings& settings,
                                           std::vector<std::string>& notes);

/// Errors kUsage: what --load cannot take, with what it can.
Result<LoadOptions> parse_loads(const BenchWords& words);

/// measure_loads() of every file on the CPU or the GPU, printed on stdout and appended to the CSV file.
Result<void> run_loads(const LoadOptions& options);

}  // namespace scree::bench
