// Predicts the position of each vertex of a cluster from earlier vertices, by the triangles. Source: spec/codecs.md,
// split pages.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>

#include "format/geometry/cluster_layout.h"

namespace scree::format {

/// Offsets of a vertex from the chunk's position_min: x, y, z and 0. A vector of four, so that one instruction handles
/// all axes.
using Offsets = int32_t __attribute__((vector_size(16)));

/// The triangles of a cluster, in order.
struct ClusterTriangles {
  static constexpr uint32_t kNoVertex = 0xff;

  uint32_t count;
  std::array<uint8_t, kMaxClusterTriangles + 1> largest;  // the largest vertex of each; kNoVertex after the last
  // The other two vertices, and the vertex on the other side of their edge or kNoVertex: a byte each, the lowest first.
  std::array<uint32_t, kMaxClusterTriangles> corners;
  std::array<uint16_t, kMaxClusterTriangles> back;  // the distances to the other two vertices, a byte each
  std::array<uint8_t, kMaxClusterTriangles> steps;  // from the largest vertex of the triangle before
};

/// Finds the vertices from which each vertex of a cluster is predicted. No step depends on a position, so that steps
/// can overlap. There are few branches, which would often be mispredicted.
class VertexPredictor {
 public:
  /// Begins a cluster. Vertices are below `vertex_count`. Changes the corners of degenerate triangles.
  void begin(ClusterTriangles& triangles, uint32_t vertex_count) {
    const uint32_t count = triangles.count;
    uint32_t has_degenerate = 0;
    for (uint32_t i = 0; i < count; ++i) {
      const uint32_t back = triangles.back[i];
      has_degenerate |= (back & 0xff) == 0 || back >> 8 == 0;
    }
    if (has_degenerate != 0) replace_degenerate(triangles);
    std::fill_n(begins_.begin(), vertex_count, kNone);
    for (uint32_t i = count; i-- > 0;) begins_[triangles.largest[i]] = static_cast<uint8_t>(i);
    for (uint32_t v = 0; v < vertex_count; ++v) {
      const uint32_t begin = begins_[v] % kMaxClusterTriangles;
      const uint32_t next = begin + (triangles.largest[begin + 1] == v ? 1 : 0);
      const uint32_t first = begins_[v] == kNone ? middle(v - 1) : triangles.corners[begin];
      const uint32_t second = begins_[v] == kNone ? first : triangles.corners[next];
      const bool has_first = first >> 16 < v;
      const bool has_second = second >> 16 < v;
      // Without any corner, predicts the middle of the second edge: each end serves as a corner.
      const uint32_t p = has_first ? first : has_second ? second : (second & 0xff) * 0x010101;
      const uint32_t q = has_second ? second : has_first ? first : (second >> 8 & 0xff) * 0x010101;
      std::memcpy(&corners_[0][v], &p, sizeof p);
      std::memcpy(&corners_[1][v], &q, sizeof q);
    }
  }

  /// Expected offsets of a vertex after the first. `at`: the offsets of the vertices before it.
  Offsets expected(uint32_t vertex, const Offsets* at) const {
    const Corner& p = corners_[0][vertex];
    const Corner& q = corners_[1][vertex];
    // The vertex decoded just before is often p[1] or q[1]. Adding these two last shortens the wait for it.
    return (at[p[0]] + at[q[0]] - at[p[2]] - at[q[2]] + at[q[1]] + at[p[1]]) >> 1;
  }

 private:
  /// Vertices 0 and 1 are an edge of the vertex's triangle, and vertex 2 lies on the other side of the edge. The
  /// prediction is 0 + 1 - 2. The fourth number is 0.
  using Corner = std::array<uint8_t, 4>;
  static_assert(sizeof(Corner) == sizeof(uint32_t));
  static constexpr uint8_t kNone = 0xff;

  /// The corner that predicts `vertex` itself.
  static constexpr uint32_t middle(uint32_t vertex) {
    return ClusterTriangles::kNoVertex << 16 | (vertex & 0xff) * 0x0101;
  }

  /// A triangle that has its largest vertex twice predicts as the triangle before with this vertex, or as none.
  static void replace_degenerate(ClusterTriangles& triangles) {
    for (uint32_t i = 0; i < triangles.count; ++i) {
      const uint32_t back = triangles.back[i];
      if ((back & 0xff) != 0 && back >> 8 != 0) continue;
      const uint32_t largest = triangles.largest[i];
      const bool is_first = i == 0 || triangles.largest[i - 1] != largest;
      triangles.corners[i] = is_first ? middle(largest - 1) : triangles.corners[i - 1];
    }
  }

  std::array<uint8_t, kMaxClusterVertices> begins_;  // the first triangle with this largest vertex, or kNone
  // The expected position is the mean of two corners.
  std::array<Corner, kMaxClusterVertices> corners_[2];
};

}  // namespace scree::format
