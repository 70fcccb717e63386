// Detects whether neighbouring triangles of the source use neighbouring vertices. If they do not, windows in the
// source's order share no vertices, and each reads all of them. Then the time is quadratic in the size of the
// primitive, and every vertex is stored in many chunks. Such a primitive is sorted first (sort_primitive.h).
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>

namespace scree::convert {

/// The number of vertices that are read for an ascending list. Gaps of up to a page of tightly packed positions count
/// as read, whatever the accessor's layout.
inline uint64_t vertices_read(std::span<const uint32_t> ascending) {
  constexpr uint32_t kGap = 4096 / 12;
  uint64_t count = ascending.size();
  for (size_t i = 1; i < ascending.size(); ++i) {
    const uint32_t gap = ascending[i] - ascending[i - 1];
    count += gap <= kGap ? gap - 1 : 0;
  }
  return count;
}

/// If a window reads more vertices per triangle than this, sorting is faster: 100 MB of positions would be read per
/// window, twice. An ordered primitive reads 0.5 to 1, and 3 if no vertex is shared.
inline constexpr uint64_t kMostVerticesRead = 32;

/// If a window without shared vertices would read more vertices per triangle than this, it is not read before it is
/// decided whether to sort.
inline constexpr uint64_t kManyVerticesRead = 4;

/// A primitive with more vertices per triangle than this is not sorted, because most vertices belong to other
/// primitives.
inline constexpr uint64_t kMostVertices = 4;

/// The windows' use of a primitive's vertices.
struct VertexUse {
  uint64_t triangles = 0;
  uint64_t far_triangles = 0;  // of windows that read more than kMostVerticesRead vertices per triangle
  uint64_t distinct = 0;       // vertices of each window, summed
  uint32_t first = UINT32_MAX;
  uint32_t last = 0;

  void add(uint64_t window_triangles, std::span<const uint32_t> ascending, bool is_far) {
    triangles += window_triangles;
    far_triangles += is_far ? window_triangles : 0;
    distinct += ascending.size();
    if (ascending.empty()) return;
    first = std::min(first, ascending.front());
    last = std::max(last, ascending.back());
  }

  void add(const VertexUse& other) {
    triangles += other.triangles;
    far_triangles += other.far_triangles;
    distinct += other.distinct;
    first = std::min(first, other.first);
    last = std::max(last, other.last);
  }

  /// Vertices from the first to the last.
  uint64_t span() const { return last < first ? 0 : uint64_t{last} - first + 1; }

  /// Whether windows use the vertices more than 1.5 times (1.0 to 1.1 in order, 2 to 6 in random order), or most
  /// windows would read too many. False if there are many more vertices than triangles: then most belong to another
  /// primitive.
  bool has_no_locality() const {
    if (span() > kMostVertices * triangles) return false;
    return 2 * distinct > 3 * span() || 2 * far_triangles > triangles;
  }
};

}  // namespace scree::convert
