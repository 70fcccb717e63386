#include "tools/bench/disk/load_report.h"

#include <algorithm>
#include <cstdio>
#include <iterator>
#include <utility>

#include "tools/bench/disk/raw_disk.h"
#include "tools/bench/setup/machine.h"
#include "tools/bench/setup/options.h"
#include "tools/common/human.h"
#include "tools/common/sigbus.h"
#include "tools/common/text_table.h"

namespace scree::bench {
namespace {

using tools::fixed;
using tools::format_bytes;
using tools::short_number;

constexpr double kMostCold = 0.01;      // of a file that counts as out of the page cache
constexpr double kDisks[] = {1, 3, 7};  // GB/s

bool takes_arena(LoadWay way) {
  return way == LoadWay::kArenaMapped || way == LoadWay::kArenaBuffered || way == LoadWay::kArenaDirect;
}
bool is_direct(LoadWay way) {
  return way == LoadWay::kArenaDirect || way == LoadWay::kGpuDirect;
}

/// "cold", "page cache", or what came of trying.
std::string state_name(const LoadRow& row) {
  const std::string share = fixed(100 * row.cached_share, 0) + "% cached";
  if (row.is_cold) return row.cached_share <= kMostCold ? "disk" : "not dropped, " + share;
  return row.cached_share >= 1 - kMostCold ? "page cache" : share;
}

/// One way and state while its repeats are measured.
struct Series {
  LoadRow row;
  std::vector<float> resident, first_frame, resident_cpu;

  void add(const TimedLoad& load, double share) {
    row.cached_share = resident.empty() ? share
                       : row.is_cold    ? std::max(row.cached_share, share)
                                        : std::min(row.cached_share, share);
    row.last = load;
    resident.push_back(static_cast<float>(load.resident_s * 1e3));
    first_frame.push_back(static_cast<float>(load.first_frame_s * 1e3));
    resident_cpu.push_back(static_cast<float>(load.resident_cpu_s * 1e3));
  }

  void finish() {
    row.resident = summarize(resident);
    row.first_frame = summarize(first_frame);
    row.resident_cpu = summarize(resident_cpu);
  }
};

/// The first of `ways`' arena, if they need one; they go where there is no memory for it.
Result<HostArena> arena_for(const std::string& path, std::vector<LoadWay>& ways, std::vector<std::string>& notes) {
  if (std::none_of(ways.begin(), ways.end(), takes_arena)) return HostArena();
  const Result<uint64_t> bytes = arena_bytes(path);
  if (!bytes) return bytes.error();
  Result<HostArena> arena = HostArena::allocate(*bytes);
  if (arena) return arena;
  notes.push_back(path + ": not loaded through the ring: " + arena.error().message);
  std::erase_if(ways, takes_arena);
  return HostArena();
}

}  // namespace

CsvCells load_cells(const Machine& machine, const LoadRow& row) {
  const auto bytes = [](uint64_t value) { return csv_number(value); };
  CsvCells cells{{"commit", machine.commit},
                 {"device", machine.gpu},
                 {"driver", machine.driver},
                 {"file", row.file},
                 {"loaded", load_way_name(row.way)},
                 {"threads", csv_number(uint64_t{row.threads})},
                 {"from", row.is_cold ? "disk" : "page cache"},
                 {"cached_share", csv_number(row.cached_share)},
                 {"file_bytes", bytes(row.last.file_bytes)},
                 {"read_bytes", bytes(row.last.read_bytes)},
                 {"direct_bytes", bytes(row.last.direct_bytes)},
                 {"device_bytes", bytes(row.last.device_bytes)}};
  const auto add_times = [&](const std::string& name, const Times& times) {
    cells.emplace_back(name + "_ms", csv_number(times.median));
    cells.emplace_back(name + "_min_ms", csv_number(times.minimum));
    cells.emplace_back(name + "_spread_ms", csv_number(times.spread));
  };
  add_times("resident", row.resident);
  add_times("first_frame", row.first_frame);
  cells.emplace_back("resident_cpu_ms", csv_number(row.resident_cpu.median));
  cells.emplace_back("gb_per_s", csv_number(row.gb_per_s()));
  cells.emplace_back("raw_gb_per_s", row.raw_gb_per_s > 0 ? csv_number(row.raw_gb_per_s) : "");
  cells.emplace_back("raw_bytes", row.raw_gb_per_s > 0 ? csv_number(row.raw_bytes) : "");
  cells.emplace_back("raw_in_flight", row.raw_gb_per_s > 0 ? csv_number(uint64_t{row.raw_in_flight}) : "");
  return cells;
}

std::string load_table(const std::vector<LoadRow>& rows) {
  inspect::TextTable table(3);
  table.row({"file", "loaded", "from", "file bytes", "resident bytes", "resident s", "least", "processor s",
             "first picture s", "GB/s", "raw disk GB/s", "in flight", "share"});
  table.rule();
  for (const LoadRow& row : rows) {
    const bool has_raw = row.raw_gb_per_s > 0;
    table.row({inspect::printable(row.file), load_way_name(row.way), state_name(row), format_bytes(row.last.file_bytes),
               format_bytes(row.last.device_bytes), short_number(row.resident.median * 1e-3),
               short_number(row.resident.minimum * 1e-3), short_number(row.resident_cpu.median * 1e-3),
               short_number(row.first_frame.median * 1e-3), fixed(row.gb_per_s(), 2),
               has_raw ? fixed(row.raw_gb_per_s, 2) : "-", has_raw ? std::to_string(row.raw_in_flight) : "-",
               has_raw && row.is_cold ? fixed(row.gb_per_s() / row.raw_gb_per_s, 2) : "-"});
  }
  return table.text();
}

std::string disk_table(const std::vector<LoadRow>& rows) {
  struct Best {
    std::string file;
    uint64_t bytes;
    double seconds;
  };
  std::vector<Best> files;
  for (const LoadRow& row : rows) {
    if (row.is_cold) continue;
    const double seconds = row.resident.median * 1e-3;
    if (files.empty() || files.back().file != row.file) files.push_back({row.file, row.last.read_bytes, seconds});
    files.back().seconds = std::min(files.back().seconds, seconds);
  }
  if (files.empty()) return "";
  inspect::TextTable table(1);
  std::vector<std::string> heads{"file", "bytes", "page cache s"};
  for (const double disk : kDisks) heads.push_back(fixed(disk, 0) + " GB/s");
  table.row(std::move(heads));
  table.rule();
  for (const Best& file : files) {
    std::vector<std::string> cells{inspect::printable(file.file), format_bytes(file.bytes), short_number(file.seconds)};
    for (const double disk : kDisks)
      cells.push_back(short_number(std::max(file.seconds, static_cast<double>(file.bytes) * 1e-9 / disk)));
    table.row(std::move(cells));
  }
  return table.text();
}

Result<std::vector<LoadRow>> measure_loads(const std::string& path, const std::vector<LoadWay>& all_ways,
                                           bool is_cached_too, uint32_t repeats, const LoadSettings& settings,
                                           std::vector<std::string>& notes) {
  std::vector<LoadWay> ways = all_ways;
  const Result<HostArena> arena = arena_for(path, ways, notes);
  if (!arena) return arena.error();
  std::vector<Series> all;
  for (const bool is_cold : {true, false}) {
    for (const LoadWay way : ways) {
      if (!is_cold && (!is_cached_too || is_direct(way))) continue;
      Series& series = all.emplace_back();
      series.row.file = file_name(path);
      series.row.way = way;
      series.row.is_cold = is_cold;
      series.row.threads = settings.threads;
    }
  }
  RawReads disk;  // once beside each repeat
  for (uint32_t i = 0; i < repeats; ++i) {
    if (const auto read = disk.read(path, notes); !read) return read.error();
    for (Series& series : all) {
      const Result<double> share = series.row.is_cold ? drop_from_cache(path) : bring_to_cache(path);
      if (!share) return share.error();
      const Result<TimedLoad> load = timed_load(path, series.row.way, *arena, settings);
      if (!load) return load.error();
      series.add(*load, *share);
    }
  }
  std::vector<LoadRow> rows;
  for (Series& series : all) {
    series.finish();
    series.row.raw_gb_per_s = disk.gb_per_s();
    series.row.raw_bytes = disk.bytes();
    series.row.raw_in_flight = disk.in_flight();
    rows.push_back(std::move(series.row));
  }
  return rows;
}

Result<LoadOptions> parse_loads(const BenchWords& words) {
  LoadOptions options;
  if (words.files.empty()) return Error{ErrorCode::kUsage, "--load takes .scree files"};
  if (words.views.find(',') != std::string::npos) return Error{ErrorCode::kUsage, "--load draws one --view"};
  if (words.repeats == 0) return Error{ErrorCode::kUsage, "--repeats is at least 1"};
  options.files = words.files;
  options.settings.view = words.views;
  options.repeats = words.repeats;
  options.csv = words.csv;
  const Result<tools::BackendOptions> backend = tools::parse_backend(words.backend, words.device);
  if (!backend) return backend.error();
  options.backend = *backend;
  const Result<uint32_t> threads = tools::parse_threads(words.threads);
  if (!threads) return threads.error();
  options.settings.threads = *threads;
  if (words.size.empty()) return options;
  const Result<ImageSize> size = tools::parse_image_size(words.size, "--size");
  if (!size) return size.error();
  options.settings.size = *size;
  return options;
}

Result<void> run_loads(const LoadOptions& options) {
  const Result<std::optional<runtime::Gpu>> gpu = tools::choose_gpu("bench", options.backend);
  if (!gpu) return gpu.error();
  const Result<Machine> machine = gpu->has_value() ? find_machine(**gpu) : Result<Machine>(cpu_machine());
  if (!machine) return machine.error();
  const std::vector<LoadWay> ways =
      gpu->has_value()
          ? std::vector{LoadWay::kGpuMapped, LoadWay::kGpuBuffered, LoadWay::kGpuDirect}
          : std::vector{LoadWay::kMap, LoadWay::kArenaMapped, LoadWay::kArenaBuffered, LoadWay::kArenaDirect};
  std::vector<LoadRow> rows;
  Result<void> done;
  for (const std::string& file : options.files) {
    tools::report_sigbus("bench", file);
    std::vector<std::string> notes;
    Result<std::vector<LoadRow>> measured = measure_loads(file, ways, true, options.repeats, options.settings, notes);
    for (const std::string& note : notes) std::fprintf(stderr, "scree bench: %s\n", note.c_str());
    if (!measured) {  // what was measured before is printed all the same
      done = measured.error();
      break;
    }
    std::move(measured->begin(), measured->end(), std::back_inserter(rows));
  }
  if (rows.empty()) return done;
  std::printf(
      "%s; commit %s; %u threads; medians of %u loads; raw disk: O_DIRECT, blocks of %s, at most %s of a file\n%s",
      machine->gpu.c_str(), machine->commit.c_str(), options.settings.threads, options.repeats,
      format_bytes(kRawBlockBytes).c_str(), format_bytes(kMostRawBytes).c_str(), load_table(rows).c_str());
  const std::string disks = disk_table(rows);
  if (!disks.empty())
    std::printf("\nfrom other disks, seconds: the larger of reading at their rate and the load from the page cache\n%s",
                disks.c_str());
  for (const LoadRow& row : rows) {
    if (options.csv.empty()) break;
    const CsvCells cells = load_cells(*machine, row);
    if (const auto added = append_csv(options.csv, csv_columns(cells), csv_values(cells)); !added) return added;
  }
  return done;
}

}  // namespace scree::bench
