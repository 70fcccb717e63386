// A bumpy closed surface with any number of triangles and vertices, made row by row.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "tools/synth/scene_functions.h"
#include "tools/synth/vec3.h"

namespace scree::synth {

/// The grid of quads that a sheet consists of. Rows of vertices go from 0 to `rows`; each has `columns` + 1 vertices,
/// the last one fewer if the last row of quads is incomplete. Quads use copies of the first vertices of the row above
/// them: a seam, as models have where texture coordinates or normals break. What the triangles still exceed the quads
/// by shows some of them once more, from behind. Vertices are numbered by first use, as optimisers number them.
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
  /// Vertices that the quads below row `row` (< rows()) use first, of that row: all of row 0, copies of the others.
  uint32_t upper_vertices(uint32_t row) const;
  /// The last vertices of a sheet that are in no triangle: copies of its last one.
  uint64_t spare_vertices() const { return vertices_ - first_vertex(rows_); }

  /// The three vertices of a triangle (< triangles()), counter-clockwise from outside.
  void corners(uint64_t triangle, uint32_t out[3]) const;

  /// Calls visit(row, x) for all vertices in their order; with `is_copy` for copies.
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
  uint64_t copies_ = 0;  // of all rows
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

/// What a vertex has.
enum class SheetStream : uint8_t { kPositions, kNormals, kUvs, kTangents };

/// Floats of a vertex: 3, 3, 2, 4.
uint32_t stream_width(SheetStream stream);

/// A stream of all vertices, width floats each. Holds some rows beside the result. The bytes are the same everywhere:
/// + - * / and sqrt only.
std::vector<float> make_stream(const SheetGrid& grid, const SheetShape& shape, SheetStream stream);

/// All indices, three per triangle.
std::vector<uint32_t> make_indices(const SheetGrid& grid);

}  // namespace scree::synth
