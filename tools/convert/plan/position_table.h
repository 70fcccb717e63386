// Compares the bytes of meshes at the bits chosen by an error bound with their bytes as floats.
#pragma once

#include <cstdint>
#include <map>
#include <string>

#include "format/layout.h"

namespace scree::convert {

class PositionTable {
 public:
  /// Adds one chunk of `mesh`. `is_first`: the first of this mesh. `saved`: additional bytes that it would take with
  /// float32 positions.
  void add(const format::MeshRecord& mesh, bool is_first, const format::ChunkRecord& chunk, int64_t saved);

  struct Row {
    uint64_t meshes = 0;
    uint64_t triangles = 0;
    uint64_t bytes = 0;  // of chunks: positions, indices and attributes, including padding
    int64_t saved = 0;   // additional bytes that they would take with float32 positions
  };
  /// By bits of the mesh's widest axis; 32: floats.
  const std::map<uint32_t, Row>& rows() const { return rows_; }
  /// A line per row, and one for the sum.
  std::string text() const;

 private:
  std::map<uint32_t, Row> rows_;
};

}  // namespace scree::convert
