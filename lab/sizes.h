// Compares the size of geometry packed by scree with other codecs on the same triangles: `scree-lab --sizes`.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "format/result.h"

namespace scree::lab {

/// A model in one encoding. Seconds are processor time of one thread.
struct SizeRow {
  std::string model;
  std::string encoding;  // such as "clustered best", "meshoptimizer", "glTF"
  std::string content;   // "geometry", or "normals": with normals of 12 bits per axis
  int zstd_level = 0;    // 0: none
  uint64_t triangles = 0;
  uint64_t vertices = 0;      // without repetitions
  uint64_t device_bytes = 0;  // in the form for a GPU; 0 if another row has this figure
  uint64_t disk_bytes = 0;    // without tables and headers of the container
  double encode_s = 0;
  double decode_s = 0;  // to plain arrays
};

/// Packs every model (.gltf or .glb) separately on the 16-bit grid: as indexed and clustered pages, raw and with zstd
/// 3, 9 and 19. Also measures the same vertices and triangles in meshoptimizer's index and vertex codecs, and their
/// size in the glTF. If the model has normals, everything is measured with them as well. Errors of convert; kFile.
Result<std::vector<SizeRow>> measure_sizes(const std::vector<std::string>& models);

/// Runs measure_sizes(), prints the rows on stdout and appends them to the CSV file, if one is given.
Result<void> run_sizes(const std::vector<std::string>& models, const std::string& csv);

}  // namespace scree::lab
