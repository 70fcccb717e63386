// The triangles of a cluster in a split page: each is found by its gate, the edge to earlier triangles. Source:
// spec/codecs.md, split pages.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "format/geometry/split_streams.h"
#include "format/geometry/vertex_predictor.h"

namespace scree::format::split_streams {

/// The edges by which the triangles of a cluster can be continued. Vertices are below kMaxClusterVertices.
class OpenEdges {
 public:
  OpenEdges() {
    next_[0] = 1;  // the edge from 0 to 1 is the first gate
    across_.fill(ClusterTriangles::kNoVertex);
  }
  /// The end of the latest edge that begins at `a`; 0 if there is none.
  uint32_t next(uint32_t a) const { return next_[a]; }
  /// The vertex on the other side of that edge, or kNoVertex.
  uint32_t across(uint32_t a) const { return across_[a]; }

  /// Adds a triangle.
  void add(uint32_t largest, uint32_t a, uint32_t b) {
    next_[a] = static_cast<uint8_t>(largest);
    across_[a] = static_cast<uint8_t>(b);
    next_[largest] = static_cast<uint8_t>(b);
    across_[largest] = static_cast<uint8_t>(a);
  }

 private:
  // By the vertex at which an edge begins.
  std::array<uint8_t, kMaxClusterVertices> next_{};
  std::array<uint8_t, kMaxClusterVertices> across_;
};

/// As in ClusterTriangles.
constexpr uint32_t corner_of(uint32_t a, uint32_t b, uint32_t across) {
  return a | b << 8 | across << 16;
}

/// The bytes of a cluster in the streams of gates and of distances.
struct TriangleBytes {
  std::span<const std::byte> gates;
  const std::byte* distances;
  uint32_t distance_bits;
  bool wide_steps;
};

/// How many distances the gates need.
inline uint32_t distances_of(std::span<const std::byte> gates) {
  uint32_t count = 0;
  for (const std::byte gate : gates) count += std::to_integer<uint32_t>(gate) / kExplicitGate;
  return 2 * count;
}

/// Reads the triangles. Returns false if a triangle has vertices that are not below `vertex_count`, or a distance or a
/// step has too many bits; then `triangles` are unspecified.
inline bool read_triangles(const TriangleBytes& bytes, uint32_t vertex_count, ClusterTriangles& triangles) {
  const auto count = static_cast<uint32_t>(bytes.gates.size());
  const std::byte* const gates = bytes.gates.data();
  triangles.count = count;
  uint32_t end = 2;
  uint8_t all_steps = 0;
  for (uint32_t i = 0; i < count; ++i) {
    const auto gate = std::to_integer<uint8_t>(gates[i]);
    const uint8_t step = gate >= kExplicitGate ? gate & 3 : gate != 0;
    triangles.steps[i] = step;
    all_steps |= step;
    end += step;
  }
  if (end >= vertex_count || (all_steps > 1 && !bytes.wide_steps)) return false;

  OpenEdges edges;
  const std::byte* distances = bytes.distances;
  uint32_t largest = 2;
  uint32_t last = 0;  // the last vertex of the triangle before, where a fan continues
  for (uint32_t i = 0; i < count; ++i) {
    const auto gate = std::to_integer<uint32_t>(gates[i]);
    largest += triangles.steps[i];
    uint32_t a, b, across;
    if (gate >= kExplicitGate) [[unlikely]] {
      const auto back_a = std::to_integer<uint32_t>(*distances++);
      const auto back_b = std::to_integer<uint32_t>(*distances++);
      if (std::max(back_a, back_b) > largest) return false;
      a = largest - back_a;
      b = largest - back_b;
      across = ClusterTriangles::kNoVertex;
    } else {
      // Without a branch, which would often be mispredicted. Each triangle waits for `last`.
      const uint32_t continues = 0u - (gate == 0);
      a = (last & continues) | ((largest - gate) % kMaxClusterVertices & ~continues);
      b = edges.next(a);
      across = edges.across(a);
    }
    edges.add(largest, a, b);
    last = b;
    triangles.corners[i] = corner_of(a, b, across);
    triangles.largest[i] = static_cast<uint8_t>(largest);
  }
  triangles.largest[count] = ClusterTriangles::kNoVertex;

  uint8_t past = 0;  // gates past the largest vertex
  uint32_t all_back = 0;
  for (uint32_t i = 0; i < count; ++i) {
    const auto gate = std::to_integer<uint8_t>(gates[i]);
    past |= static_cast<uint8_t>(gate < kExplicitGate && gate > triangles.largest[i]);
    const uint32_t back = triangles.largest[i] * 0x0101u - (triangles.corners[i] & 0xffff);
    all_back |= back;
    triangles.back[i] = static_cast<uint16_t>(back);
  }
  return past == 0 && (all_back | all_back >> 8) % 256 >> bytes.distance_bits == 0;
}

}  // namespace scree::format::split_streams
