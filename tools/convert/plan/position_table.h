// What meshes take at the bits that an error bound chose, beside what they would with floats.
#pragma once

#include <cstdint>
#include <map>
#include <string>

#include "format/layout.h"

namespace scree::convert {

class PositionTable {
 public:
  /// One chunk of `mesh`, its first or a further one, that would take `saved` bytes more with float32 positions.
  void add(const format::MeshRecord& mesh, bool is_first, const format::ChunkRecord& chunk, int64_t saved);

  struct Row {
    uint64_t meshes = 0;
    uint64_t triangles = 0;
    uint64_t bytes = 0;  // of chunks: positions, indices and attributes, padding included
    int64_t saved = 0;   // that they would take more with float32 positions
  };
  /// By bits of the mesh's widest axis; 32: floats.
  const std::map<uint32_t, Row>& rows() const { return rows_; }
  /// Lines, a row each and their sum.
  std::string text() const;

 private:
  std::map<uint32_t, Row> rows_;
};

}  // namespace scree::convert
