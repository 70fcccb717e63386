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

/// The triangles of a cluster: the largest vertex of each, and the distances back to the other two.
struct ClusterTriangles {
  uint32_t count;
  uint32_t distance_bits;
  std::array<uint8_t, kMaxClusterTriangles> largest;
  std::array<uint8_t, kMaxClusterTriangles> back[2];
};

/// Finds the vertices from which each vertex of a cluster is predicted. No step depends on a position, so that steps
/// can overlap. There are few branches, which would often be mispredicted.
class VertexPredictor {
 public:
  /// Begins a cluster. The caller ensures that vertices are below `vertex_count`, and that distances are below
  /// 2^distance_bits and at most their triangle's largest vertex.
  void begin(const ClusterTriangles& triangles, uint32_t vertex_count) {
    if (has_degenerate(triangles))
      begin_proper(without_degenerate(triangles), vertex_count);
    else
      begin_proper(triangles, vertex_count);
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
  static constexpr uint32_t kNoVertex = 0xff;

  /// The triangles' edges as numbers: the larger vertex << kBits | the distance to the other.
  struct Edges {
    std::array<uint8_t, kMaxClusterTriangles> largest, a, b;
    std::array<uint8_t, kMaxClusterTriangles> again;  // all ones: the triangle before has the same largest vertex
    std::array<uint16_t, kMaxClusterTriangles> ab;    // the lower byte is the smaller vertex
    std::array<uint16_t, kMaxClusterTriangles> edge_ab, edge_a, edge_b;
  };

  static bool has_degenerate(const ClusterTriangles& triangles) {
    const uint32_t count = triangles.count;
    uint8_t found = 0;
    for (uint32_t i = 0; i < count; ++i) {
      const uint8_t a = triangles.back[0][i];
      const uint8_t b = triangles.back[1][i];
      found |= static_cast<uint8_t>((a == 0) | (b == 0) | (a == b));
    }
    return found != 0;
  }
  static ClusterTriangles without_degenerate(const ClusterTriangles& triangles) {
    ClusterTriangles out;
    out.distance_bits = triangles.distance_bits;
    out.count = 0;
    for (uint32_t i = 0; i < triangles.count; ++i) {
      const uint8_t a = triangles.back[0][i];
      const uint8_t b = triangles.back[1][i];
      out.largest[out.count] = triangles.largest[i];
      out.back[0][out.count] = a;
      out.back[1][out.count] = b;
      out.count += a != 0 && b != 0 && a != b;
    }
    return out;
  }

  void begin_proper(const ClusterTriangles& triangles, uint32_t vertex_count) {
    if (triangles.distance_bits <= 4)  // a smaller table
      find<4>(triangles, vertex_count);
    else
      find<7>(triangles, vertex_count);
  }

  template <uint32_t kBits>
  static void find_edges(const ClusterTriangles& triangles, Edges& edges) {
    const uint32_t count = triangles.count;
    for (uint32_t i = 0; i < count; ++i) {
      const uint8_t largest = triangles.largest[i];
      const uint8_t back_a = triangles.back[0][i];
      const uint8_t back_b = triangles.back[1][i];
      const auto larger = static_cast<uint8_t>(largest - std::min(back_a, back_b));
      const auto smaller = static_cast<uint8_t>(largest - std::max(back_a, back_b));
      edges.largest[i] = largest;
      edges.a[i] = static_cast<uint8_t>(largest - back_a);
      edges.b[i] = static_cast<uint8_t>(largest - back_b);
      edges.ab[i] = static_cast<uint16_t>(smaller | larger << 8);
      edges.edge_ab[i] = static_cast<uint16_t>(larger << kBits | (larger - smaller));
      edges.edge_a[i] = static_cast<uint16_t>(largest << kBits | back_a);
      edges.edge_b[i] = static_cast<uint16_t>(largest << kBits | back_b);
    }
    edges.again[0] = 0;
    for (uint32_t i = 1; i < count; ++i) edges.again[i] = edges.largest[i] == edges.largest[i - 1] ? 0xff : 0;
  }

  template <uint32_t kBits>
  void find(const ClusterTriangles& triangles, uint32_t vertex_count) {
    Edges edges;
    find_edges<kBits>(triangles, edges);
    std::fill_n(opposite_.begin(), size_t{vertex_count} << kBits, static_cast<uint8_t>(kNoVertex));
    for (uint32_t v = 0; v < vertex_count; ++v) {
      found_[0][v] = kNoVertex << 16 | ((v - 1) & 0xff) * 0x0101;  // default: the vertex completes no triangle
      found_[1][v] = kNoVertex << 16;
    }
    uint32_t corners = 0;  // found for `largest`
    for (uint32_t i = 0; i < triangles.count; ++i) {
      const uint32_t largest = edges.largest[i];
      const uint32_t across = opposite_[edges.edge_ab[i]];
      corners &= edges.again[i];
      found_[corners][largest] = edges.ab[i] | across << 16;
      corners += across < largest;  // otherwise the next triangle overwrites it
      opposite_[edges.edge_ab[i]] = static_cast<uint8_t>(largest);
      opposite_[edges.edge_a[i]] = edges.b[i];
      opposite_[edges.edge_b[i]] = edges.a[i];
    }
    for (uint32_t v = 0; v < vertex_count; ++v) {
      const uint32_t first = found_[0][v];
      const uint32_t second = found_[1][v];
      const bool has_first = first >> 16 < v;
      const bool has_second = second >> 16 < v;
      // Without any corner, predicts the middle of the edge found last: each end serves as a corner.
      const uint32_t p = has_first ? first : (first & 0xff) * 0x010101;
      const uint32_t q = has_second ? second : has_first ? first : (first >> 8 & 0xff) * 0x010101;
      std::memcpy(&corners_[0][v], &p, sizeof p);
      std::memcpy(&corners_[1][v], &q, sizeof q);
    }
  }

  // The expected position is the mean of two corners.
  std::array<Corner, kMaxClusterVertices> corners_[2];
  // The corners found for each vertex, as numbers. Only the first two count, since more gain nothing. A corner whose
  // third vertex is not below the vertex itself is only an edge.
  std::array<uint32_t, kMaxClusterVertices> found_[kMaxClusterTriangles + 1];
  // Per edge, the vertex opposite to it in the last triangle that has the edge.
  std::array<uint8_t, kMaxClusterVertices * kMaxClusterVertices> opposite_;
};

}  // namespace scree::format
