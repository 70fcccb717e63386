// What geometry takes as we pack it, beside other codecs on the same triangles: `scree-lab --sizes`.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "format/result.h"
#include "tools/bench/csv.h"

namespace scree::lab {

/// A model in one encoding. Seconds are processor time of one thread.
struct SizeRow {
  std::string model;
  std::string encoding;  // such as "clustered best", "meshoptimizer", "glTF"
  std::string content;   // "geometry", or "normals": with normals of 12 bits an axis
  int zstd_level = 0;    // 0: none
  uint64_t triangles = 0;
  uint64_t vertices = 0;      // equal ones once
  uint64_t device_bytes = 0;  // as a GPU would hold it, 0 where that is another row's
  uint64_t disk_bytes = 0;    // without tables and headers of the container
  double encode_s = 0;
  double decode_s = 0;  // to plain arrays
};

bench::CsvCells size_cells(const SizeRow& row);

/// The rows as a table of bytes a triangle.
std::string sizes_table(const std::vector<SizeRow>& rows);

/// Packs every model (.gltf or .glb) on the 16-bit grid, by itself: indexed and clustered pages, raw and with zstd 3, 9
/// and 19; the same vertices and triangles through meshoptimizer's index and vertex codecs; and what they
/// take in the glTF. With normals again where the model has any. Errors of convert; kFile.
Result<std::vector<SizeRow>> measure_sizes(const std::vector<std::string>& models);

/// measure_sizes(), printed on stdout and appended to the CSV file, where one is named.
Result<void> run_sizes(const std::vector<std::string>& models, const std::string& csv);

}  // namespace scree::lab
