#include "tools/bench/report/plot.h"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <optional>
#include <utility>

namespace scree::bench {
namespace {

constexpr double kFloat32Place = 26;  // on the axis of bits, apart from 24

Error format_error(std::string message) {
  return {ErrorCode::kFormat, std::move(message)};
}

/// One row by column names.
class CurveRow {
 public:
  CurveRow(const std::map<std::string, size_t>& columns, const std::vector<std::string>& cells)
      : columns_(columns), cells_(cells) {}
  const std::string& text(const char* column) const { return cells_[columns_.at(column)]; }
  /// Nothing where the cell is empty.
  std::optional<double> number(const char* column) const {
    const std::string& cell = text(column);
    if (cell.empty()) return std::nullopt;
    return std::strtod(cell.c_str(), nullptr);
  }

 private:
  const std::map<std::string, size_t>& columns_;
  const std::vector<std::string>& cells_;
};

constexpr const char* kTexts[] = {"device", "study", "scene", "view", "positions", "indices"};
constexpr const char* kNumbers[] = {
    "scale",   "samples_per_side", "depth_bits",   "snap",    "bytes_per_triangle", "position_error",
    "draw_ms", "covered_pixels",   "wrong_pixels", "psnr_db", "flip_mean",          "same_depth_error_rms"};

using Value = std::optional<double> (*)(const CurveRow&);

std::optional<double> wrong_percent(const CurveRow& row) {
  const auto wrong = row.number("wrong_pixels"), covered = row.number("covered_pixels");
  if (!wrong || !covered || *covered <= 0) return std::nullopt;
  return 100 * *wrong / *covered;
}
std::optional<double> bits(const CurveRow& row) {
  return row.text("positions") == "float32" ? kFloat32Place : std::strtod(row.text("positions").c_str(), nullptr);
}
std::optional<double> samples(const CurveRow& row) {
  const auto side = row.number("samples_per_side");
  return side ? std::optional(*side * *side) : std::nullopt;
}

/// A chart to make of the rows of one study.
struct Plan {
  const char* name;
  const char* study;
  const char* title;
  ChartAxis x, y;
  Value x_value, y_value;
  bool
      both_indices;  // clustered rows beside packed ones, dashed; else packed ones alone, for the pictures are the same
};

std::vector<Plan> plans() {
  ChartAxis bits_axis{"bits an axis", false, {}};
  for (int b = 8; b <= 24; b += 2) bits_axis.ticks.emplace_back(b, std::to_string(b));
  bits_axis.ticks.emplace_back(kFloat32Place, "float32");
  const ChartAxis snap_axis{"steps a pixel", true, {{16, "16"}, {256, "256"}, {4096, "4096"}}};
  const ChartAxis depth_axis{"bits of a depth code", false, {{28, "28"}, {32, "32"}}};
  const ChartAxis samples_axis{"samples a pixel", true, {{1, "1"}, {4, "4"}, {16, "16"}}};
  const ChartAxis wrong_axis{"wrong, % of covered pixels", true, {}};
  return {
      {"wrong", "positions", "Pixels that show another triangle", bits_axis, wrong_axis, bits, wrong_percent, false},
      {"psnr",
       "positions",
       "PSNR against the reference",
       bits_axis,
       {"dB", false, {}},
       bits,
       [](const CurveRow& row) { return row.number("psnr_db"); },
       false},
      {"flip",
       "positions",
       "FLIP against the reference",
       bits_axis,
       {"mean FLIP", true, {}},
       bits,
       [](const CurveRow& row) { return row.number("flip_mean"); },
       false},
      {"error",
       "positions",
       "Largest position error",
       bits_axis,
       {"model units", true, {}},
       bits,
       [](const CurveRow& row) { return row.number("position_error"); },
       false},
      {"bytes",
       "positions",
       "Size",
       bits_axis,
       {"bytes a triangle", false, {}},
       bits,
       [](const CurveRow& row) { return row.number("bytes_per_triangle"); },
       true},
      {"speed",
       "positions",
       "Time of a frame",
       bits_axis,
       {"ms", true, {}},
       bits,
       [](const CurveRow& row) { return row.number("draw_ms"); },
       true},
      {"size_error",
       "positions",
       "Error against size",
       {"bytes a triangle", false, {}},
       wrong_axis,
       [](const CurveRow& row) { return row.number("bytes_per_triangle"); },
       wrong_percent,
       true},
      {"snapping", "snapping", "Pixels that snapping alone makes wrong", snap_axis, wrong_axis,
       [](const CurveRow& row) { return row.number("snap"); }, wrong_percent, true},
      {"depth",
       "depth",
       "Depth error that codes alone make",
       depth_axis,
       {"relative, RMS", true, {}},
       [](const CurveRow& row) { return row.number("depth_bits"); },
       [](const CurveRow& row) { return row.number("same_depth_error_rms"); },
       true},
      {"samples",
       "samples",
       "Supersampling against 64 samples of the reference",
       samples_axis,
       {"dB", false, {}},
       samples,
       [](const CurveRow& row) { return row.number("psnr_db"); },
       false},
  };
}

/// "dutch_ship" of "dutch_ship.gltf".
std::string without_extension(const std::string& name) {
  const size_t dot = name.find_last_of('.');
  return dot == std::string::npos || dot == 0 ? name : name.substr(0, dot);
}

/// What a line is of: a scene's view, in the order in which the file has them, so that a colour means the same in all
/// charts.
class Lines {
 public:
  void add(const CurveRow& row) {
    const std::string key = key_of(row);
    if (numbers_.try_emplace(key, numbers_.size()).second) names_.push_back(name_of(row));
  }
  size_t number(const CurveRow& row) const { return numbers_.at(key_of(row)); }
  const std::string& name(size_t number) const { return names_[number]; }
  size_t count() const { return names_.size(); }

 private:
  static std::string key_of(const CurveRow& row) {
    return row.text("scene") + '\n' + row.text("scale") + '\n' + row.text("view");
  }
  static std::string name_of(const CurveRow& row) {
    const std::string scene = without_extension(row.text("scene"));
    const std::string scaled = row.text("scale") == "1" ? scene : scene + " x" + row.text("scale");
    return row.text("view") == "default" ? scaled : scaled + ", " + row.text("view");
  }
  std::map<std::string, size_t> numbers_;
  std::vector<std::string> names_;
};

Chart make_chart(const Plan& plan, const std::vector<CurveRow>& rows, const Lines& lines) {
  Chart chart{plan.title, "", plan.x, plan.y, {}};
  std::map<std::pair<bool, size_t>, ChartSeries> series;  // packed first
  std::string device;
  for (const CurveRow& row : rows) {
    if (row.text("study") != plan.study) continue;
    const bool clustered = row.text("indices") == "clustered";
    if (clustered && !plan.both_indices) continue;
    if (std::strcmp(plan.study, "samples") == 0 && row.text("positions") != "16") continue;
    const auto x = plan.x_value(row), y = plan.y_value(row);
    if (!x || !y) continue;
    const size_t number = lines.number(row);
    ChartSeries& line = series[{clustered, number}];
    if (!clustered) line.name = lines.name(number);
    line.colour = number;
    line.dashed = clustered;
    line.points.emplace_back(*x, *y);
    if (device.empty()) device = row.text("device");
    if (device != row.text("device")) device = "several devices";
  }
  bool has_border = false, has_dashes = false;
  for (auto& [key, line] : series) {
    std::stable_sort(line.points.begin(), line.points.end(),
                     [](const auto& a, const auto& b) { return a.first < b.first; });
    has_dashes = has_dashes || line.dashed;
    for (const auto& [x, y] : line.points) has_border = has_border || !std::isfinite(y) || (plan.y.log && y <= 0);
    chart.series.push_back(std::move(line));
  }
  const auto note = [&](const std::string& text) { chart.note += (chart.note.empty() ? "" : "; ") + text; };
  if (plan.name == std::string("speed")) note(device);
  if (has_dashes) note("dashed: clustered");
  if (has_border) note(plan.y.log ? "hollow: 0" : "hollow: equal");
  return chart;
}

}  // namespace

Result<CsvTable> read_csv(const std::string& path) {
  errno = 0;
  std::ifstream in(path, std::ios::binary);
  if (!in) return Error{ErrorCode::kFile, path + ": " + std::strerror(errno)};
  std::error_code unknown;
  if (std::filesystem::is_directory(path, unknown)) return Error{ErrorCode::kFile, path + ": is a folder"};
  const std::string text{std::istreambuf_iterator<char>(in), {}};
  std::vector<std::vector<std::string>> lines;
  std::vector<std::string> cells;
  std::string cell;
  bool quoted = false, any = false;
  const auto end_line = [&] {
    cells.push_back(std::exchange(cell, {}));
    if (any) lines.push_back(cells);
    cells.clear();
    any = false;
  };
  for (size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (quoted) {
      if (c != '"') {
        cell += c;
      } else if (i + 1 < text.size() && text[i + 1] == '"') {
        cell += text[++i];
      } else {
        quoted = false;
      }
      continue;
    }
    if (c == '\n') {
      end_line();
      continue;
    }
    if (c == '\r') continue;
    any = true;
    if (c == '"') {
      quoted = true;
    } else if (c == ',') {
      cells.push_back(std::exchange(cell, {}));
    } else {
      cell += c;
    }
  }
  if (quoted) return format_error(path + ": a quoted cell that does not end");
  end_line();
  if (lines.empty()) return format_error(path + ": empty, expected a line of columns");
  CsvTable table;
  table.columns = std::move(lines.front());
  for (size_t i = 1; i < lines.size(); ++i) {
    if (lines[i].size() != table.columns.size())
      return format_error(path + ": line " + std::to_string(i + 1) + " has " + std::to_string(lines[i].size()) +
                          " cells, but there are " + std::to_string(table.columns.size()) + " columns");
    table.rows.push_back(std::move(lines[i]));
  }
  return table;
}

Result<std::vector<NamedChart>> curve_charts(const CsvTable& table) {
  std::map<std::string, size_t> columns;
  for (size_t i = 0; i < table.columns.size(); ++i) columns.emplace(table.columns[i], i);
  const auto missing = [&](const char* column) { return !columns.contains(column); };
  for (const char* column : kTexts)
    if (missing(column)) return format_error("line 1: no column " + std::string(column) + ", so no rows of --curves");
  for (const char* column : kNumbers) {
    if (missing(column)) return format_error("line 1: no column " + std::string(column) + ", so no rows of --curves");
    for (size_t i = 0; i < table.rows.size(); ++i) {
      const std::string& cell = table.rows[i][columns.at(column)];
      char* end = nullptr;
      const double value = std::strtod(cell.c_str(), &end);
      if (!cell.empty() && (end != cell.c_str() + cell.size() || std::isnan(value)))
        return format_error("row " + std::to_string(i + 1) + ": " + column + " is '" + cell + "', not a number");
    }
  }
  std::vector<CurveRow> rows;
  Lines lines;
  for (const std::vector<std::string>& cells : table.rows) {
    rows.emplace_back(columns, cells);
    lines.add(rows.back());
  }
  std::vector<NamedChart> charts;
  for (const Plan& plan : plans()) {
    Chart chart = make_chart(plan, rows, lines);
    if (!chart.series.empty()) charts.push_back({plan.name, std::move(chart)});
  }
  if (charts.empty()) return format_error("no rows of --curves or --reference");
  return charts;
}

Result<void> plot_csv(const std::string& path) {
  const Result<CsvTable> table = read_csv(path);
  if (!table) return table.error();
  const Result<std::vector<NamedChart>> charts = curve_charts(*table);
  if (!charts) return at(path, charts.error());
  const size_t slash = path.find_last_of('/');
  const std::string folder = slash == std::string::npos ? "" : path.substr(0, slash + 1);
  for (const NamedChart& chart : *charts) {
    const std::string file = folder + "curves_" + chart.name + ".svg";
    errno = 0;
    std::ofstream out(file, std::ios::binary | std::ios::trunc);
    out << svg_chart(chart.chart);
    out.close();
    if (!out) return Error{ErrorCode::kFile, file + ": " + std::strerror(errno)};
    std::printf("%s\n", file.c_str());
  }
  return {};
}

}  // namespace scree::bench
