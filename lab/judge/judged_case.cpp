#include "lab/judge/judged_case.h"

#include <cmath>
#include <vector>

#include "tools/common/output/human.h"
#include "tools/common/output/text_table.h"

namespace scree::lab {
namespace {

using compare::PixelKind;
using inspect::TextTable;
using tools::grouped;
using tools::short_number;

constexpr std::array kWrongKinds{PixelKind::kBackground, PixelKind::kOtherMesh, PixelKind::kApart,
                                 PixelKind::kNeighbour};

uint64_t count_of(const JudgedCase::Pixels& pixels, PixelKind kind) {
  return pixels.kinds[static_cast<size_t>(kind)];
}

std::string psnr(const JudgedCase& row) {
  return std::isinf(row.psnr_db) ? "equal" : short_number(row.psnr_db);
}

/// The part of a row that distinguishes it from others of the same scene and view.
std::string drawn_as(const JudgedCase& row) {
  if (row.study == Study::kDepth) return std::to_string(row.depth_bits) + "-bit depth";
  if (row.study == Study::kSnapping) return "1/" + std::to_string(row.snap) + " pixel";
  std::string name = row.positions + (row.positions == "float32" ? ", " : "-bit, ") + row.indices;
  if (row.study == Study::kSupersample) {
    const std::string side = std::to_string(row.samples_per_side);
    name += ", " + side + "x" + side;
  }
  return name;
}

std::string scene_of(const JudgedCase& row) {
  return row.scene + (row.scale == 1 ? "" : " x" + short_number(row.scale)) + ", " + row.view;
}

/// The table of a study's pixel errors, one row per drawing.
std::string pixel_table(std::span<const JudgedCase> rows, Study study) {
  TextTable table(2);
  table.row({"scene, view", "drawn", "B/tri", "ms", "error", "bound", "covered", "wrong", "share", "background", "mesh",
             "apart", "neighbour", "depth max", "depth RMS", "PSNR dB", "FLIP"});
  table.rule();
  for (const JudgedCase& row : rows) {
    if (row.study != study || !row.pixels) continue;
    const bool is_file = row.geometry_bytes != 0;
    const double covered = static_cast<double>(std::max<uint64_t>(row.pixels->covered, 1));
    std::vector<std::string> cells{
        scene_of(row),
        drawn_as(row),
        is_file ? short_number(row.bytes_per_triangle()) : "-",
        row.drawing ? short_number(row.drawing->median) : "-",
        is_file ? short_number(row.position_error) : "-",
        is_file ? short_number(row.position_bound) : "-",
        grouped(row.pixels->covered),
        grouped(row.pixels->wrong),
        short_number(100 * static_cast<double>(row.pixels->wrong) / covered) + "%",
    };
    for (const PixelKind kind : kWrongKinds) cells.push_back(grouped(count_of(*row.pixels, kind)));
    cells.push_back(short_number(row.pixels->surface.max()));
    cells.push_back(short_number(row.pixels->surface.rms()));
    cells.push_back(psnr(row));
    cells.push_back(short_number(row.flip_mean));
    table.row(std::move(cells));
  }
  return table.text();
}

std::string sample_table(std::span<const JudgedCase> rows) {
  TextTable table(2);
  table.row({"scene, view", "drawn", "ms", "PSNR dB", "FLIP, mean", "FLIP, largest"});
  table.rule();
  for (const JudgedCase& row : rows)
    if (row.study == Study::kSupersample)
      table.row({scene_of(row), drawn_as(row), row.drawing ? short_number(row.drawing->median) : "-", psnr(row),
                 short_number(row.flip_mean), short_number(row.flip_max)});
  return table.text();
}

const char* study_name(Study study) {
  constexpr const char* kNames[] = {"positions", "samples", "depth", "snapping"};
  return kNames[static_cast<size_t>(study)];
}

}  // namespace

bench::CsvCells judged_cells(const Machine& machine, const JudgedCase& row) {
  using bench::csv_number;
  const bool is_file = row.geometry_bytes != 0;
  const auto of_file = [&](const std::string& text) { return is_file ? text : std::string(); };
  const auto of_pixels = [&](auto value) { return row.pixels ? csv_number(value(*row.pixels)) : std::string(); };
  const auto of_times = [&](double Times::*member) {
    return row.drawing ? csv_number((*row.drawing).*member) : std::string();
  };
  bench::CsvCells cells{
      {"commit", machine.commit},
      {"device", is_file ? machine.device : "reference"},
      {"driver", of_file(machine.driver)},
      {"study", study_name(row.study)},
      {"scene", row.scene},
      {"scale", csv_number(row.scale)},
      {"view", row.view},
      {"width", csv_number(uint64_t{row.width})},
      {"height", csv_number(uint64_t{row.height})},
      {"positions", row.positions},
      {"indices", row.indices},
      {"samples_per_side", csv_number(uint64_t{row.samples_per_side})},
      {"depth_bits", csv_number(uint64_t{row.depth_bits})},
      {"snap", csv_number(uint64_t{row.snap})},
      {"unique_triangles", csv_number(row.unique_triangles)},
      {"drawn_triangles", csv_number(row.drawn_triangles)},
      {"geometry_bytes", of_file(csv_number(row.geometry_bytes))},
      {"bytes_per_triangle", of_file(csv_number(row.bytes_per_triangle()))},
      {"position_error", of_file(csv_number(row.position_error))},
      {"position_bound", of_file(csv_number(row.position_bound))},
      {"frames", csv_number(uint64_t{row.frames})},
      {"draw_ms", of_times(&Times::median)},
      {"draw_min_ms", of_times(&Times::minimum)},
      {"draw_spread_ms", of_times(&Times::spread)},
      {"covered_pixels", of_pixels([](const auto& pixels) { return pixels.covered; })},
      {"wrong_pixels", of_pixels([](const auto& pixels) { return pixels.wrong; })},
  };
  for (const PixelKind kind : kWrongKinds)
    cells.emplace_back(std::string("wrong_") + compare::kind_key(kind),
                       of_pixels([&](const auto& pixels) { return count_of(pixels, kind); }));
  cells.emplace_back("coincident_pixels",
                     of_pixels([](const auto& pixels) { return count_of(pixels, PixelKind::kCoincident); }));
  cells.emplace_back("depth_error_max", of_pixels([](const auto& pixels) { return pixels.surface.max(); }));
  cells.emplace_back("depth_error_rms", of_pixels([](const auto& pixels) { return pixels.surface.rms(); }));
  cells.emplace_back("same_depth_error_max", of_pixels([](const auto& pixels) { return pixels.same.max(); }));
  cells.emplace_back("same_depth_error_rms", of_pixels([](const auto& pixels) { return pixels.same.rms(); }));
  cells.emplace_back("psnr_db", csv_number(row.psnr_db));
  cells.emplace_back("flip_mean", csv_number(row.flip_mean));
  cells.emplace_back("flip_max", csv_number(row.flip_max));
  return cells;
}

std::string judged_tables(std::span<const JudgedCase> rows) {
  std::string text;
  const auto has = [&](Study study) {
    for (const JudgedCase& row : rows)
      if (row.study == study) return true;
    return false;
  };
  if (has(Study::kPositions))
    text += "Positions: against the source's own vertices, errors in model units, depths relative\n" +
            pixel_table(rows, Study::kPositions);
  if (has(Study::kSnapping))
    text += "\nSnapping of projected corners, all else in double precision\n" + pixel_table(rows, Study::kSnapping);
  if (has(Study::kDepth)) text += "\nDepth codes, all else in double precision\n" + pixel_table(rows, Study::kDepth);
  if (has(Study::kSupersample)) text += "\nSamples, against 8 x 8 samples of the reference\n" + sample_table(rows);
  return text;
}

}  // namespace scree::lab
