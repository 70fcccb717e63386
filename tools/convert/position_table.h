// What positions take at the bits that an error bound chose, beside what floats would.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <span>
#include <string>

#include "format/layout.h"

namespace scree::convert {

class PositionTable {
 public:
  /// Bytes that the positions of a chunk of `mesh` take in its `payload`.
  static uint64_t position_bytes(const format::MeshRecord& mesh, const format::ChunkRecord& chunk,
                                 std::span<const std::byte> payload);

  /// One chunk of `mesh`, its first or a further one, and its position_bytes().
  void add(const format::MeshRecord& mesh, bool is_first, const format::ChunkRecord& chunk, uint64_t position_bytes);

  struct Row {
    uint64_t meshes = 0;
    uint64_t triangles = 0;
    uint64_t bytes = 0;        // of positions, as stored
    uint64_t float_bytes = 0;  // as floats, a vertex once a chunk
  };
  /// By bits of the mesh's widest axis; 32: floats.
  const std::map<uint32_t, Row>& rows() const { return rows_; }
  /// Lines, a row each and their sum.
  std::string text() const;

 private:
  std::map<uint32_t, Row> rows_;
};

}  // namespace scree::convert
