#include "tools/synth/sheet.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <utility>

#include "tools/synth/gltf_parts.h"

namespace scree::synth {
namespace {

constexpr float kSeamShift = 0.5f;  // shift of a copy's texture coordinates

uint64_t root(uint64_t square) {
  auto side = static_cast<uint64_t>(std::sqrt(static_cast<double>(square)));
  while (side * side > square) --side;
  while ((side + 1) * (side + 1) <= square) ++side;
  return side;
}

/// The point of the sphere for a point of the square [-1, 1]^2: an octahedron's faces, unfolded (its border closes).
Vec3 direction(double a, double b) {
  Vec3 d{a, b, 1 - std::abs(a) - std::abs(b)};
  if (d[2] < 0) {
    d[0] = (1 - std::abs(b)) * (a < 0 ? -1 : 1);
    d[1] = (1 - std::abs(a)) * (b < 0 ? -1 : 1);
  }
  return normalized(d);
}

/// The positions of the vertices of a sheet's rows.
class Surface {
 public:
  Surface(const SheetGrid& grid, const SheetShape& shape) : grid_(grid), shape_(shape) {}

  std::vector<Vec3> row(uint32_t y) const {
    std::vector<Vec3> points(grid_.row_vertices(y));
    for (uint32_t x = 0; x < points.size(); ++x) points[x] = point(x, y);
    return points;
  }

 private:
  Vec3 point(uint32_t x, uint32_t y) const {
    const Vec3 d = direction(2.0 * x / grid_.columns() - 1.0, 2.0 * y / grid_.rows() - 1.0);
    double sum = 0, height = 1, frequency = shape_.frequency;
    for (uint32_t octave = 0; octave < shape_.octaves; ++octave, height *= 0.5, frequency *= 2)
      sum += height * noise3(shape_.seed + octave * 7919u, d[0] * frequency + 1024.0, d[1] * frequency + 1024.0,
                             d[2] * frequency + 1024.0);
    const double radius = 1 + shape_.amplitude * sum;
    const double box = 1 / std::max({std::abs(d[0]), std::abs(d[1]), std::abs(d[2])});
    return d * ((box + (1 - box) * shape_.round8 * 0.125) * radius);
  }

  const SheetGrid& grid_;
  const SheetShape& shape_;
};

/// Three neighbouring rows; the outer two are empty past the sheet's ends.
struct Rows {
  std::vector<Vec3> above, at, below;
};

Vec3 across(const Rows& rows, size_t x) {
  return rows.at[std::min(x + 1, rows.at.size() - 1)] - rows.at[x == 0 ? 0 : x - 1];
}

Vec3 along(const Rows& rows, size_t x) {
  const std::vector<Vec3>& next = x < rows.below.size() ? rows.below : rows.at;
  const std::vector<Vec3>& last = x < rows.above.size() ? rows.above : rows.at;
  return next[x] - last[x];
}

/// `vector` with length 1, or `other` if it has none.
Vec3 unit_or(const Vec3& vector, const Vec3& other) {
  return dot(vector, vector) > 1e-30 ? normalized(vector) : other;
}

Vec3 normal(const Rows& rows, size_t x) {
  return unit_or(cross(across(rows, x), along(rows, x)), normalized(rows.at[x]));
}

Vec3 tangent(const Rows& rows, size_t x) {
  const Vec3 n = normal(rows, x), t = across(rows, x);
  const Vec3 other = std::abs(n[0]) < 0.7 ? Vec3{1, 0, 0} : Vec3{0, 1, 0};
  return unit_or(t - n * dot(t, n), normalized(other - n * dot(other, n)));
}

}  // namespace

SheetGrid::SheetGrid(uint64_t triangles, uint64_t vertices) : triangles_(triangles), vertices_(vertices) {
  assert(triangles >= 1 && vertices >= 4);
  const uint64_t quads = (triangles + 1) / 2;
  columns_ = static_cast<uint32_t>(std::clamp<uint64_t>(root(std::min(quads, vertices)), 1, vertices / 2 - 1));
  // Full rows, as far as quads and vertices suffice; then a part of a row.
  full_rows_ = static_cast<uint32_t>(std::min(quads / columns_, vertices / (columns_ + 1) - 1));
  const uint64_t left = vertices - uint64_t{columns_ + 1} * (full_rows_ + 1);
  const uint64_t quads_left = quads - uint64_t{columns_} * full_rows_;
  last_quads_ = static_cast<uint32_t>(std::min({quads_left, left == 0 ? 0 : left - 1, uint64_t{columns_} - 1}));
  rows_ = full_rows_ + (last_quads_ != 0 ? 1 : 0);
  front_triangles_ = std::min(triangles, 2 * (uint64_t{columns_} * full_rows_ + last_quads_));
  const uint64_t in_rows = uint64_t{columns_ + 1} * (full_rows_ + 1) + (last_quads_ != 0 ? last_quads_ + 1 : 0);
  copies_ = std::min(vertices - in_rows, uint64_t{rows_ - 1} * (columns_ + 1));
}

uint32_t SheetGrid::upper_vertices(uint32_t row) const {
  if (row == 0) return columns_ + 1;
  const uint64_t inner = rows_ - 1;
  return static_cast<uint32_t>(copies_ / inner + (row - 1 < copies_ % inner ? 1 : 0));
}

uint64_t SheetGrid::first_vertex(uint32_t row) const {
  if (row == 0) return 0;
  const uint64_t inner = rows_ - 1, before = row - 1;  // rows that may have copies
  const uint64_t copies = inner == 0 ? 0 : copies_ / inner * before + std::min(before, copies_ % inner);
  return uint64_t{row} * (columns_ + 1) + row_vertices(row) + copies;
}

void SheetGrid::corners(uint64_t triangle, uint32_t out[3]) const {
  const bool is_back = triangle >= front_triangles_;
  if (is_back) triangle = (triangle - front_triangles_) % front_triangles_;
  const uint64_t quad = triangle / 2;
  const auto y = static_cast<uint32_t>(quad / columns_), x = static_cast<uint32_t>(quad % columns_);
  // Vertices of the two rows alternate, beginning with the lower one.
  const auto lower = [&](uint32_t row, uint32_t column) {
    return static_cast<uint32_t>(first_vertex(row) + column + std::min(column, upper_vertices(row)));
  };
  const auto upper = [&](uint32_t column) {
    return column < upper_vertices(y)
               ? static_cast<uint32_t>(first_vertex(y) + column + std::min(column + 1, row_vertices(y + 1)))
               : lower(y - 1, column);
  };
  // The first triangle shares an edge with the previous quad, so that index codecs can use it.
  out[0] = triangle % 2 == 0 ? lower(y, x) : upper(x);
  out[1] = triangle % 2 == 0 ? upper(x) : upper(x + 1);
  out[2] = lower(y, x + 1);
  if (is_back) std::swap(out[1], out[2]);
}

uint32_t stream_width(SheetStream stream) {
  constexpr uint32_t kWidths[] = {3, 3, 2, 4};
  return kWidths[static_cast<size_t>(stream)];
}

std::vector<float> make_stream(const SheetGrid& grid, const SheetShape& shape, SheetStream stream) {
  const Surface surface(grid, shape);
  const uint32_t width = stream_width(stream);
  const bool has_uvs = stream == SheetStream::kUvs;
  const double repeat = 1 + shape.seed % 3;  // each side of the surface repeats a picture once to three times
  Rows rows;
  uint32_t next_row = 0;
  if (!has_uvs) rows.below = surface.row(0);
  // Computes the values of the next row.
  const auto make_row = [&] {
    const uint32_t y = next_row++;
    std::vector<float> values;
    const auto put = [&](const Vec3& point) {
      for (const double part : point) values.push_back(static_cast<float>(part));
    };
    if (!has_uvs) {
      rows.above = std::exchange(rows.at, std::move(rows.below));
      rows.below = y < grid.rows() ? surface.row(y + 1) : std::vector<Vec3>{};
    }
    for (uint32_t x = 0; x < grid.row_vertices(y); ++x) switch (stream) {
        case SheetStream::kPositions:
          put(rows.at[x]);
          break;
        case SheetStream::kNormals:
          put(normal(rows, x));
          break;
        case SheetStream::kUvs:
          values.push_back(static_cast<float>(repeat * x / grid.columns()));
          values.push_back(static_cast<float>(repeat * (1.0 - static_cast<double>(y) / grid.rows())));
          break;
        case SheetStream::kTangents:
          put(tangent(rows, x));
          values.push_back(1);
      }
    return values;
  };
  std::vector<float> out;
  out.reserve(grid.vertices() * width);
  std::vector<float> upper, lower = make_row();
  grid.visit_vertices([&](uint32_t row, uint32_t x, bool is_copy) {
    if (row == next_row) upper = std::exchange(lower, make_row());
    const std::vector<float>& values = row + 1 == next_row ? lower : upper;
    for (uint32_t i = 0; i < width; ++i) out.push_back(values[uint64_t{x} * width + i]);
    if (has_uvs && is_copy) out[out.size() - 2] += kSeamShift;
  });
  return out;
}

std::vector<uint32_t> make_indices(const SheetGrid& grid) {
  std::vector<uint32_t> indices(grid.triangles() * 3);
  for (uint64_t t = 0; t < grid.triangles(); ++t) grid.corners(t, &indices[t * 3]);
  return indices;
}

}  // namespace scree::synth
