// The results of a conversion, in figures and as text.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "format/container/container.h"
#include "tools/common/jobs/stage_rates.h"
#include "tools/convert/plan/convert_options.h"
#include "tools/convert/plan/position_table.h"
#include "tools/gltf/source.h"

namespace scree::convert {

struct ConvertReport {
  std::string output;
  uint64_t input_bytes = 0;  // of the input and its buffer and image files
  uint64_t output_bytes = 0;
  uint64_t geometry_bytes = 0;    // of the output's geometry pages
  uint64_t image_bytes = 0;       // of its image pages and mask pages
  uint64_t masks = 0;             // materials drawn with an alpha mask
  uint64_t mask_bytes = 0;        // of the mask pages
  uint64_t blended = 0;           // materials whose surfaces may blend
  uint64_t opaque_masks = 0;      // materials whose alpha masks hide no texel, drawn as opaque ones
  std::vector<LeftOut> left_out;  // of the source; equal parts stored once are not listed
  uint64_t meshes = 0;
  uint64_t chunks = 0;
  uint64_t triangles = 0;              // stored
  uint64_t triangles_drawn = 0;        // over all instances of all scenes
  PositionTable positions;             // only with an error bound
  double position_error = 0;           // largest found, model units, per axis
  double position_error_bound = 0;     // largest stated in a mesh record
  double relative_position_error = 0;  // largest found / diagonal of the mesh's box
  double seconds = 0;
  uint64_t peak_bytes = 0;  // of the whole process, resident and not backed by a file: RssAnon + RssShmem
  uint32_t threads = 0;     // number of encoding threads
  uint32_t threads_asked = 0;
  uint32_t resumed_pages = 0;       // reused from an earlier run
  uint64_t dropped_degenerate = 0;  // triangles of strips and fans with two equal indices
  uint64_t dropped_nonfinite = 0;
  uint64_t sorted_triangles = 0;   // of primitives without locality
  uint64_t sort_file_bytes = 0;    // upper bound of their temporary file
  uint64_t windows = 0;            // of the stored meshes
  uint64_t windows_ahead = 0;      // encoded before all were measured
  uint64_t windows_guessed = 0;    // encoded before their own mesh was measured completely
  uint64_t windows_discarded = 0;  // encoded in vain, because their mesh differs from the statements of the source
  StageRates rates;
  std::vector<std::string> warnings;  // one line each
};

/// Adds the counts, errors and bytes of the tables and pages of a finished output.
void add_results(const format::TableSet& tables, const format::ContainerWriter& writer, ConvertReport& report);

/// Two lines: "a.glb -> a.scree: 1.41 MiB -> 283 KiB, ratio 5.10", then triangles, error, time and memory; a third
/// if something was left out. `stats`: adds a line with the rate of every stage.
std::string describe(const ConvertOptions& options, const ConvertReport& report, bool stats);

/// One JSON object and a line break.
std::string json_report(const ConvertOptions& options, const ConvertReport& report);

}  // namespace scree::convert
