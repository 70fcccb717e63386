#include "tools/bench/csv.h"

#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <utility>
#include <vector>

namespace scree::bench {
namespace {

using Cell = std::pair<std::string, std::string>;  // column, value

std::string quoted(const std::string& text) {
  if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string out = "\"";
  for (const char c : text) {
    out += c;
    if (c == '"') out += '"';
  }
  return out + '"';
}

std::string number(double value) {
  if (std::isinf(value)) return "inf";
  char text[32];
  std::snprintf(text, sizeof text, "%.6g", value);
  return text;
}
std::string number(uint64_t value) {
  return std::to_string(value);
}

std::string hex(uint64_t value) {
  char text[17];
  std::snprintf(text, sizeof text, "%016llx", static_cast<unsigned long long>(value));
  return text;
}

void add_times(std::vector<Cell>& cells, const std::string& name, const std::optional<Times>& times) {
  cells.emplace_back(name + "_ms", times ? number(times->median) : "");
  cells.emplace_back(name + "_min_ms", times ? number(times->minimum) : "");
  cells.emplace_back(name + "_spread_ms", times ? number(times->spread) : "");
}

/// Columns and values stand side by side here alone, so that they cannot come apart.
std::vector<Cell> cells_of(const Machine& machine, const CaseResult& r) {
  const double unique = static_cast<double>(r.unique_triangles);
  std::vector<Cell> cells{
      {"commit", machine.commit},
      {"gpu", machine.gpu},
      {"driver", machine.driver},
      {"copy_gb_per_s", number(machine.copy_gb_per_s)},
      {"scene", r.scene},
      {"order", r.order},
      {"scale", number(r.scale)},
      {"positions", r.positions},
      {"indices", r.indices},
      {"view", r.view},
      {"width", number(uint64_t{r.width})},
      {"height", number(uint64_t{r.height})},
      {"samples_per_side", number(uint64_t{r.samples_per_side})},
      {"sampleless_test", r.sampleless_test ? "on" : "off"},
      {"culling", r.culling},
      {"effects", r.effects},
      {"frames", number(uint64_t{r.frames})},
      {"unique_triangles", number(r.unique_triangles)},
      {"drawn_triangles", number(r.drawn_triangles)},
      {"geometry_bytes", number(r.geometry_bytes)},
      {"bytes_per_triangle", number(static_cast<double>(r.geometry_bytes) / unique)},
      {"device_bytes", number(r.device_bytes)},
      {"instances_drawn", number(r.stats.instances_drawn)},
      {"draws", number(r.stats.draws)},
      {"culled_triangles", number(r.culled_triangles())},
      {"small_triangles", number(r.stats.triangles_small)},
      {"medium_triangles", number(r.stats.triangles_medium)},
      {"large_triangles", number(r.stats.triangles_large)},
      {"clipped_triangles", number(r.stats.triangles_clipped)},
      {"groups_tested", number(r.stats.groups_tested)},
      {"clusters_tested", number(r.stats.clusters_tested)},
      {"clusters_drawn", number(r.stats.clusters_drawn)},
      {"covered_samples", number(r.covered_samples)},
      {"picture", hex(r.picture)},
      {"touched_bytes", r.touched_bytes ? number(*r.touched_bytes) : ""},
  };
  add_times(cells, "clear", r.clear);
  add_times(cells, "cull", r.cull);
  add_times(cells, "small", r.small);
  add_times(cells, "medium", r.medium);
  add_times(cells, "large", r.large);
  add_times(cells, "pyramid", r.pyramid);
  add_times(cells, "second", r.second);
  add_times(cells, "raster", r.raster);
  add_times(cells, "resolve", r.resolve);
  add_times(cells, "occlusion", r.occlusion);
  add_times(cells, "frame", r.frame);
  cells.emplace_back("mean_ms", number(r.drawing().mean));
  cells.emplace_back("worst_ms", number(r.drawing().worst));
  cells.emplace_back("jump_ms", r.jump_ms ? number(*r.jump_ms) : "");
  cells.emplace_back("triangles_per_s", number(r.triangles_per_s()));
  const auto error = [&](const char* column, auto member) {
    cells.emplace_back(column, r.error ? number((*r.error).*member) : "");
  };
  error("position_error", &PictureError::position_error);
  error("wrong_pixels", &PictureError::wrong_pixels);
  error("depth_error_max", &PictureError::depth_error_max);
  error("depth_error_rms", &PictureError::depth_error_rms);
  error("psnr_db", &PictureError::psnr_db);
  return cells;
}

Error file_error(const std::string& path) {
  return {ErrorCode::kFile, path + ": " + std::strerror(errno)};
}

}  // namespace

std::string csv_header() {
  std::string line;
  for (const Cell& cell : cells_of({}, {})) line += (line.empty() ? "" : ",") + cell.first;
  return line;
}

std::string csv_row(const Machine& machine, const CaseResult& result) {
  std::string line;
  bool first = true;
  for (const Cell& cell : cells_of(machine, result)) {
    if (!first) line += ',';
    first = false;
    line += quoted(cell.second);
  }
  return line;
}

Result<void> append_csv(const std::string& path, const std::string& row) {
  const std::string header = csv_header();
  bool is_new = true;
  {
    std::ifstream in(path, std::ios::binary);
    std::string line;
    if (in && std::getline(in, line)) {
      is_new = false;
      if (line != header)
        return Error{ErrorCode::kFormat, path + ": line 1 is not this version's list of columns; name another file"};
    }
  }
  errno = 0;
  std::ofstream out(path, std::ios::binary | std::ios::app);
  if (!out) return file_error(path);
  if (is_new) out << header << '\n';
  out << row << '\n';
  out.close();
  if (!out) return file_error(path);
  return {};
}

}  // namespace scree::bench
