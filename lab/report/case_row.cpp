#include "lab/report/case_row.h"

#include <cstdio>
#include <string>

namespace scree::lab {
namespace {

std::string hex(uint64_t value) {
  char text[17];
  std::snprintf(text, sizeof text, "%016llx", static_cast<unsigned long long>(value));
  return text;
}

}  // namespace

bench::CsvCells case_cells(const Machine& machine, const CaseResult& r) {
  using bench::csv_number;
  bench::CsvCells cells{
      {"commit", machine.commit},
      {"gpu", machine.device},
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
  bench::add_times(cells, "clear", r.clear);
  bench::add_times(cells, "cull", r.cull);
  bench::add_times(cells, "small", r.small);
  bench::add_times(cells, "medium", r.medium);
  bench::add_times(cells, "large", r.large);
  bench::add_times(cells, "pyramid", r.pyramid);
  bench::add_times(cells, "second", r.second);
  bench::add_times(cells, "raster", r.raster);
  bench::add_times(cells, "wall", r.wall);
  bench::add_times(cells, "resolve", r.resolve);
  bench::add_times(cells, "occlusion", r.occlusion);
  bench::add_times(cells, "frame", r.frame);
  cells.emplace_back("mean_ms", csv_number(r.drawing().mean));
  cells.emplace_back("worst_ms", csv_number(r.drawing().worst));
  cells.emplace_back("jump_ms", r.jump_ms ? csv_number(*r.jump_ms) : "");
  cells.emplace_back("triangles_per_s", csv_number(r.triangles_per_s()));
  const auto error = [&](const char* column, auto member) {
    cells.emplace_back(column, r.error ? csv_number((*r.error).*member) : "");
  };
  error("position_error", &PictureError::position_error);
  cells.emplace_back("wrong_pixels", r.error && r.error->wrong_pixels ? csv_number(*r.error->wrong_pixels) : "");
  error("depth_error_max", &PictureError::depth_error_max);
  error("depth_error_rms", &PictureError::depth_error_rms);
  error("psnr_db", &PictureError::psnr_db);
  const auto coverage = [&](const char* column, auto member) {
    cells.emplace_back(column, r.peer ? csv_number(r.peer->coverage.*member) : "");
  };
  coverage("same_samples", &Coverage::same);
  coverage("edge_samples", &Coverage::edge);
  coverage("depth_samples", &Coverage::depth);
  coverage("other_samples", &Coverage::other);
  coverage("depth_gap", &Coverage::depth_gap);
  return cells;
}

}  // namespace scree::lab
