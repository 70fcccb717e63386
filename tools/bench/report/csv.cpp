#include "tools/bench/report/csv.h"

#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <fstream>

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include "tools/common/stop_signal.h"

namespace scree::bench {
namespace {

std::string quoted(const std::string& text) {
  if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string out = "\"";
  for (const char c : text) {
    out += c;
    if (c == '"') out += '"';
  }
  return out + '"';
}

std::string hex(uint64_t value) {
  char text[17];
  std::snprintf(text, sizeof text, "%016llx", static_cast<unsigned long long>(value));
  return text;
}

void add_times(CsvCells& cells, const std::string& name, const std::optional<Times>& times) {
  cells.emplace_back(name + "_ms", times ? csv_number(times->median) : "");
  cells.emplace_back(name + "_min_ms", times ? csv_number(times->minimum) : "");
  cells.emplace_back(name + "_spread_ms", times ? csv_number(times->spread) : "");
}

CsvCells cells_of(const Machine& machine, const CaseResult& r) {
  CsvCells cells{
      {"commit", machine.commit},
      {"gpu", machine.gpu},
      {"driver", machine.driver},
      {"copy_gb_per_s", csv_number(machine.copy_gb_per_s)},
      {"scene", r.scene},
      {"order", r.order},
      {"scale", csv_number(r.scale)},
      {"positions", r.positions},
      {"indices", r.indices},
      {"view", r.view},
      {"width", csv_number(uint64_t{r.width})},
      {"height", csv_number(uint64_t{r.height})},
      {"samples_per_side", csv_number(uint64_t{r.samples_per_side})},
      {"sampleless_test", r.sampleless_test ? "on" : "off"},
      {"culling", r.culling},
      {"effects", r.effects},
      {"frames", csv_number(uint64_t{r.frames})},
      {"unique_triangles", csv_number(r.unique_triangles)},
      {"drawn_triangles", csv_number(r.drawn_triangles)},
      {"geometry_bytes", csv_number(r.geometry_bytes)},
      {"bytes_per_triangle", csv_number(r.bytes_per_triangle())},
      {"device_bytes", csv_number(r.device_bytes)},
      {"instances_drawn", csv_number(r.stats.instances_drawn)},
      {"draws", csv_number(r.stats.draws)},
      {"culled_triangles", csv_number(r.culled_triangles())},
      {"small_triangles", csv_number(r.stats.triangles_small)},
      {"medium_triangles", csv_number(r.stats.triangles_medium)},
      {"large_triangles", csv_number(r.stats.triangles_large)},
      {"clipped_triangles", csv_number(r.stats.triangles_clipped)},
      {"groups_tested", csv_number(r.stats.groups_tested)},
      {"clusters_tested", csv_number(r.stats.clusters_tested)},
      {"clusters_drawn", csv_number(r.stats.clusters_drawn)},
      {"covered_samples", csv_number(r.covered_samples)},
      {"picture", hex(r.picture)},
      {"touched_bytes", r.touched_bytes ? csv_number(*r.touched_bytes) : ""},
  };
  add_times(cells, "clear", r.clear);
  add_times(cells, "cull", r.cull);
  add_times(cells, "small", r.small);
  add_times(cells, "medium", r.medium);
  add_times(cells, "large", r.large);
  add_times(cells, "pyramid", r.pyramid);
  add_times(cells, "second", r.second);
  add_times(cells, "raster", r.raster);
  add_times(cells, "wall", r.wall);
  add_times(cells, "resolve", r.resolve);
  add_times(cells, "occlusion", r.occlusion);
  add_times(cells, "frame", r.frame);
  cells.emplace_back("mean_ms", csv_number(r.drawing().mean));
  cells.emplace_back("worst_ms", csv_number(r.drawing().worst));
  cells.emplace_back("jump_ms", r.jump_ms ? csv_number(*r.jump_ms) : "");
  cells.emplace_back("triangles_per_s", csv_number(r.triangles_per_s()));
  const auto error = [&](const char* column, auto member) {
    cells.emplace_back(column, r.error ? csv_number((*r.error).*member) : "");
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

std::string csv_columns(const CsvCells& cells) {
  std::string line;
  for (const auto& cell : cells) line += (line.empty() ? "" : ",") + cell.first;
  return line;
}

std::string csv_values(const CsvCells& cells) {
  std::string line;
  bool first = true;
  for (const auto& cell : cells) {
    if (!first) line += ',';
    first = false;
    line += quoted(cell.second);
  }
  return line;
}

std::string csv_number(double value) {
  if (std::isinf(value)) return "inf";
  char text[32];
  std::snprintf(text, sizeof text, "%.6g", value);
  return text;
}
std::string csv_number(uint64_t value) {
  return std::to_string(value);
}

std::string csv_header() {
  return csv_columns(cells_of({}, {}));
}

std::string csv_row(const Machine& machine, const CaseResult& result) {
  return csv_values(cells_of(machine, result));
}

Result<void> append_csv(const std::string& path, const std::string& header, const std::string& row) {
  // The lock is held from the test of the first line to the end of the write, so that two programs that begin a file
  // leave one header and whole rows.
  const int file = ::open(path.c_str(), O_RDWR | O_CREAT | O_APPEND | O_CLOEXEC, 0666);
  if (file < 0) return file_error(path);
  struct Close {
    int file;
    ~Close() { ::close(file); }
  } const closes{file};
  while (::flock(file, LOCK_EX) != 0 && errno == EINTR) {
  }
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
  const std::string text = (is_new ? header + '\n' : std::string()) + row + '\n';
  for (size_t done = 0; done < text.size();) {
    const ssize_t written = ::write(file, text.data() + done, text.size() - done);
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) return file_error(path);
    done += static_cast<size_t>(written);
  }
  tools::note_written(path);
  return {};
}

}  // namespace scree::bench
