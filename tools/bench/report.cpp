#include <cinttypes>
#include <cstdio>

#include "tools/bench/bench.h"
#include "tools/bench/csv.h"
#include "tools/common/output/human.h"
#include "tools/common/output/json_writer.h"
#include "tools/common/output/text_table.h"

namespace scree::bench {
namespace {

using inspect::TextTable;
using tools::fixed;
using tools::format_bytes;
using tools::format_count;
using tools::short_number;

constexpr double kNearlyAll = 0.99;  // least cached share of a cached file; a dropped file has at most 1 - kNearlyAll

std::string hex(uint64_t value) {
  char text[17];
  std::snprintf(text, sizeof text, "%016" PRIx64, value);
  return text;
}

/// "disk", "page cache", or the actual state if neither was achieved.
std::string state_name(const LoadResult& load) {
  const std::string share = fixed(100 * load.cached_share, 0) + "% cached";
  if (load.is_cold) return load.cached_share <= 1 - kNearlyAll ? "disk" : "not dropped, " + share;
  return load.cached_share >= kNearlyAll ? "page cache" : share;
}

std::string loads_table(const FileResult& file) {
  TextTable table(1);
  table.row({"loaded from", "s", "least", "first picture s", "GB/s", "in memory"});
  table.rule();
  for (const LoadResult& load : file.loads)
    table.row({state_name(load), short_number(load.load.median * 1e-3), short_number(load.load.minimum * 1e-3),
               short_number(load.first_picture.median * 1e-3), fixed(load.gb_per_s(), 2),
               format_bytes(load.device_bytes)});
  return table.text();
}

std::string views_table(const FileResult& file) {
  bool is_streamed = false;
  for (const ViewResult& view : file.views) is_streamed = is_streamed || view.streamed_bytes;
  TextTable table(1);
  std::vector<std::string> heads{"view", "frames", "first ms", "draw ms", "least", "worst", "shade ms", "triangles/s"};
  if (is_streamed) heads.push_back("streamed");
  table.row(std::move(heads));
  table.rule();
  for (const ViewResult& view : file.views) {
    const double per_s = static_cast<double>(file.drawn_triangles) / (view.draw.median * 1e-3);
    std::vector<std::string> cells{inspect::printable(view.name),   std::to_string(view.frames),
                                   short_number(view.first_ms),     short_number(view.draw.median),
                                   short_number(view.draw.minimum), short_number(view.draw.worst),
                                   short_number(view.shade.median), format_count(per_s)};
    if (is_streamed) cells.push_back(view.streamed_bytes ? format_bytes(*view.streamed_bytes) : "-");
    table.row(std::move(cells));
  }
  return table.text();
}

void write_times(tools::JsonWriter& json, const char* name, const Times& times) {
  json.object(name, [&] {
    json.member("median", times.median);
    json.member("min", times.minimum);
    json.member("max", times.worst);
    json.member("mean", times.mean);
  });
}

void write_file(tools::JsonWriter& json, const FileResult& file) {
  json.member("file", file.file);
  json.member("bytes", file.file_bytes);
  json.member("unique_triangles", file.unique_triangles);
  json.member("drawn_triangles", file.drawn_triangles);
  json.member("gpus", file.gpus);
  json.objects("loads", file.loads, [&](const LoadResult& load) {
    json.member("from", load.is_cold ? "disk" : "page cache");
    json.member("cached_share", load.cached_share);
    json.member("read_bytes", load.read_bytes);
    json.member("device_bytes", load.device_bytes);
    write_times(json, "load_ms", load.load);
    write_times(json, "first_picture_ms", load.first_picture);
    json.member("gb_per_s", load.gb_per_s());
  });
  json.objects("views", file.views, [&](const ViewResult& view) {
    json.member("view", view.name);
    json.member("frames", view.frames);
    json.member("first_ms", view.first_ms);
    write_times(json, "draw_ms", view.draw);
    write_times(json, "shade_ms", view.shade);
    if (view.streamed_bytes) json.member("streamed_bytes", *view.streamed_bytes);
    json.member("picture", hex(view.picture));
  });
}

CsvCells view_cells(const BenchReport& report, const FileResult& file, const ViewResult& view) {
  const BenchOptions& options = report.options;
  CsvCells cells{{"commit", report.machine.commit},
                 {"device", (file.gpus != 1 ? std::to_string(file.gpus) + " x " : "") + report.machine.device},
                 {"driver", report.machine.driver},
                 {"threads", csv_number(uint64_t{options.threads})},
                 {"file", file.file},
                 {"file_bytes", csv_number(file.file_bytes)},
                 {"unique_triangles", csv_number(file.unique_triangles)},
                 {"drawn_triangles", csv_number(file.drawn_triangles)}};
  for (const bool is_cold : {true, false}) {
    const LoadResult* load = nullptr;
    for (const LoadResult& each : file.loads)
      if (each.is_cold == is_cold) load = &each;
    const std::string name = is_cold ? "disk_" : "cache_";
    cells.emplace_back(name + "share", load != nullptr ? csv_number(load->cached_share) : "");
    add_times(cells, name + "load", load != nullptr ? std::optional(load->load) : std::nullopt);
    add_times(cells, name + "first_picture", load != nullptr ? std::optional(load->first_picture) : std::nullopt);
    cells.emplace_back(name + "gb_per_s", load != nullptr ? csv_number(load->gb_per_s()) : "");
  }
  cells.emplace_back("read_bytes", csv_number(file.loads.back().read_bytes));
  cells.emplace_back("device_bytes", csv_number(file.loads.back().device_bytes));
  cells.emplace_back("view", view.name);
  cells.emplace_back("width", csv_number(uint64_t{options.size.width}));
  cells.emplace_back("height", csv_number(uint64_t{options.size.height}));
  cells.emplace_back("samples_per_side", csv_number(uint64_t{options.samples_per_side}));
  cells.emplace_back("frames", csv_number(uint64_t{view.frames}));
  cells.emplace_back("first_ms", csv_number(view.first_ms));
  add_times(cells, "draw", view.draw);
  add_times(cells, "shade", view.shade);
  cells.emplace_back("streamed_bytes", view.streamed_bytes ? csv_number(*view.streamed_bytes) : "");
  cells.emplace_back("picture", hex(view.picture));
  return cells;
}

}  // namespace

std::string bench_text(const BenchReport& report) {
  const BenchOptions& options = report.options;
  const std::string side = std::to_string(options.samples_per_side);
  std::string text = report.machine.device +
                     (report.machine.driver.empty() ? "" : ", driver " + report.machine.driver) + ", " +
                     std::to_string(options.threads) + (options.threads == 1 ? " thread" : " threads") + "; commit " +
                     report.machine.commit + "\nmedians of " + std::to_string(options.repeats) +
                     (options.repeats == 1 ? " load" : " loads") + " and of up to " + std::to_string(options.frames) +
                     (options.frames == 1 ? " frame" : " frames") + " at " + std::to_string(options.size.width) + "x" +
                     std::to_string(options.size.height) +
                     (options.samples_per_side == 1 ? "" : ", " + side + "x" + side + " samples per pixel") + "\n";
  for (const FileResult& file : report.files)
    text +=
        "\n" + inspect::printable(file.file, 200) + ": " + format_bytes(file.file_bytes) + ", " +
        format_count(static_cast<double>(file.unique_triangles)) + " triangles, " +
        format_count(static_cast<double>(file.drawn_triangles)) + " drawn" +
        (options.backend.gpus != 1 ? " by " + std::to_string(file.gpus) + (file.gpus == 1 ? " GPU" : " GPUs") : "") +
        "\n" + loads_table(file) + "\n" + views_table(file);
  return text;
}

std::string bench_json(const BenchReport& report) {
  return tools::json_object([&](tools::JsonWriter& json) {
           json.member("commit", report.machine.commit);
           json.member("device", report.machine.device);
           json.member("driver", report.machine.driver);
           json.member("threads", report.options.threads);
           json.member("width", report.options.size.width);
           json.member("height", report.options.size.height);
           json.member("samples_per_side", report.options.samples_per_side);
           json.member("repeats", report.options.repeats);
           json.objects("files", report.files, [&](const FileResult& file) { write_file(json, file); });
         }) +
         "\n";
}

Result<void> append_rows(const BenchReport& report) {
  for (const FileResult& file : report.files)
    for (const ViewResult& view : file.views) SCREE_TRY(append_csv(report.options.csv, view_cells(report, file, view)));
  return {};
}

Result<void> check_rows(const BenchOptions& options) {
  FileResult file;
  file.loads.emplace_back();
  return check_csv(options.csv, view_cells({options, {}, {}}, file, {}));
}

}  // namespace scree::bench
