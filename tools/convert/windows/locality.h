// Whether triangles that lie together in the source use vertices that lie together there. Where they do not, windows in
// the source's order share no vertices, and each reads all of them: time grows with the square of the primitive, and
// every vertex is stored in many chunks. Such a primitive is sorted first (sort_primitive.h).
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>

namespace scree::convert {

/// Vertices that reading those of an ascending list takes: gaps of up to a page of positions are read with them,
/// however the accessor lies.
inline uint64_t vertices_read(std::span<const uint32_t> ascending) {
  constexpr uint32_t kGap = 4096 / 12;
  uint64_t count = ascending.size();
  for (size_t i = 1; i < ascending.size(); ++i) {
    const uint32_t gap = ascending[i] - ascending[i - 1];
    count += gap <= kGap ? gap - 1 : 0;
  }
  return count;
}

/// Vertices read per triangle from which on sorting takes less time than reading: 100 MB of positions a window, twice.
/// In order it is 0.5 to 1, and 3 where no vertex is shared.
inline constexpr uint64_t kMostVerticesRead = 32;

/// The same from which on a window that shares no vertices is not read before it is known whether it will be sorted.
inline constexpr uint64_t kManyVerticesRead = 4;

/// Vertices per triangle from which on no other primitive's are sorted with them.
inline constexpr uint64_t kMostVertices = 4;

/// What the windows of a primitive use of its vertices.
struct VertexUse {
  uint64_t triangles = 0;
  uint64_t far_triangles = 0;  // of windows that read more than kMostVerticesRead vertices a triangle
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

  /// Whether windows use the vertices more than 1.5 times over (1.0 to 1.1 in order, 2 to 6 in a random one), or most
  /// of them would read too many. Not where the vertices are much more than the triangles: then most are another
  /// primitive's.
  bool has_no_locality() const {
    if (span() > kMostVertices * triangles) return false;
    return 2 * distinct > 3 * span() || 2 * far_triangles > triangles;
  }
};

}  // namespace scree::convert
