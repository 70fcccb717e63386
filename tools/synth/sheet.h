// A bumpy closed surface with any number of triangles and vertices, made row by row.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "format/vec3.h"

namespace scree::synth {

/// The grid of quads that a sheet consists of. Rows of vertices go from 0 to `rows`; each has `columns` + 1 vertices,
/// the last one fewer if the last row of quads is incomplete. Vertices beyond the grid become copies of the first
/// vertices of rows, which the quads below use: a seam, as in models with discontinuous texture coordinates or normals.
/// Triangles beyond the quads repeat some of them, facing backwards. Vertices are numbered by first use, as an
/// optimiser would do.
class SheetGrid {
 public:
  /// A sheet with exactly these counts. `triangles` >= 1, `vertices` >= 4; both below 2^32.
  SheetGrid(uint64_t triangles, uint64_t vertices);

  uint64_t triangles() const { return triangles_; }
  uint64_t vertices() const { return vertices_; }
  uint32_t columns() const { return columns_; }
  uint32_t rows() const { return rows_; }

  /// Vertices of row `row` (0 to rows()), without copies.
  uint32_t row_vertices(uint32_t row) const { return row < full_rows_ + 1 ? columns_ + 1 : last_quads_ + 1; }
  /// The number of vertices of row `row` (< rows()) that the quads below it use first: all vertices of row 0, copies in
  /// other rows.
  uint32_t upper_vertices(uint32_t row) const;
  /// The number of vertices at the end that no triangle uses: copies of the last one.
  uint64_t spare_vertices() const { return vertices_ - first_vertex(rows_); }

  /// The three vertices of a triangle (< triangles()), counter-clockwise from outside.
  void corners(uint64_t triangle, uint32_t out[3]) const;

  /// Calls visit(row, x, is_copy) for all vertices in their order.
  template <class Visit>
  void visit_vertices(const Visit& visit) const {
    for (uint32_t y = 0; y < rows_; ++y) {
      const uint32_t upper = upper_vertices(y), lower = row_vertices(y + 1);
      for (uint32_t x = 0; x < std::max(upper, lower); ++x) {
        if (x < lower) visit(y + 1, x, false);
        if (x < upper) visit(y, x, y != 0);
      }
    }
    for (uint64_t i = 0; i < spare_vertices(); ++i) visit(rows_, row_vertices(rows_) - 1, false);
  }

 private:
  /// The first vertex that the quads below row `row` use first.
  uint64_t first_vertex(uint32_t row) const;

  uint64_t triangles_, vertices_;
  uint64_t front_triangles_ = 0;
  uint64_t copies_ = 0;  // in all rows
  uint32_t columns_ = 1, rows_ = 1, full_rows_ = 1, last_quads_ = 0;
};

/// The surface: a box (round8 = 0) to a sphere (8) of radius 1 with bumps, by MeshRecipe's noise.
struct SheetShape {
  uint32_t seed = 0;
  uint32_t round8 = 0;
  uint32_t octaves = 5;
  double amplitude = 0.1;
  double frequency = 2;
};

/// The attributes of a vertex.
enum class SheetStream : uint8_t { kPositions, kNormals, kUvs, kTangents };

/// Floats per vertex: 3, 3, 2, 4.
uint32_t stream_width(SheetStream stream);

/// A stream of all vertices, stream_width() floats each. Memory: a few rows beside the result. The result is the same
/// on every machine, because only + - * / and sqrt are used.
std::vector<float> make_stream(const SheetGrid& grid, const SheetShape& shape, SheetStream stream);

/// All indices, three per triangle.
std::vector<uint32_t> make_indices(const SheetGrid& grid);

}  // namespace scree::synth
