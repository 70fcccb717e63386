// The comparison of one picture with the reference: a row of `scree-lab --reference` and --curves.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "lab/report/case_result.h"
#include "tools/bench/csv.h"
#include "tools/compare/pixels.h"

namespace scree::lab {

/// The subject of a row.
enum class Study : uint8_t {
  kPositions,    // the error by the width of positions
  kSupersample,  // the difference of 1, 4 and 16 samples per pixel from 64
  kDepth,        // the error of depth codes, with all other steps exact
  kSnapping,     // the error of rounding projected corners, with all other steps exact
};

struct JudgedCase {
  Study study = Study::kPositions;
  std::string scene;
  double scale = 1;
  std::string view;
  uint32_t width = 0;  // pixels
  uint32_t height = 0;
  std::string positions;  // bits or "float32"; "source": the reference rasteriser itself, in one of its modes
  std::string indices;    // "packed", "clustered"; empty for "source"
  uint32_t samples_per_side = 1;
  uint32_t depth_bits = 28;  // 0: double precision
  uint32_t snap = 256;       // steps per pixel; 0: none

  uint64_t unique_triangles = 0;
  uint64_t drawn_triangles = 0;
  uint64_t geometry_bytes = 0;  // indices and positions, or clusters; 0 for "source"
  double position_error = 0;    // largest error of a coordinate that convert found, model units
  double position_bound = 0;    // largest bound that a mesh states
  std::optional<Times>
      drawing;          // ms; on a GPU: culling and all stages by its clock; on a CPU: a frame by the wall clock
  uint32_t frames = 0;  // number of timed frames

  /// Missing for more than one sample per pixel.
  struct Pixels {
    uint64_t covered = 0;  // pixels that the reference covers
    uint64_t wrong = 0;
    std::array<uint64_t, compare::kPixelKinds> kinds{};
    compare::DepthError same;     // over pixels with the same triangle in both
    compare::DepthError surface;  // over all pixels with a surface in both
  };
  std::optional<Pixels> pixels;
  double psnr_db = 0;  // infinity for equal pictures
  double flip_mean = 0;
  double flip_max = 0;

  double bytes_per_triangle() const {
    return static_cast<double>(geometry_bytes) / static_cast<double>(unique_triangles);
  }
};

bench::CsvCells judged_cells(const Machine& machine, const JudgedCase& row);

/// One table per study that has rows.
std::string judged_tables(std::span<const JudgedCase> rows);

}  // namespace scree::lab
