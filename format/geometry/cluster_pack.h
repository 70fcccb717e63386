// Packs clusters: numbers their vertices, orders their triangles, predicts an axis. Source: spec/codecs.md, clusters.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "format/geometry/cluster_codec.h"

namespace scree::format {

/// Vertices that a cluster may have: degenerate triangles (two equal vertices) may need two more for themselves.
inline constexpr uint32_t kMaxDegenerateVertices = kMaxClusterVertices - 2;

enum class PackEffort {
  kFast,  // numbers vertices from one end of the cluster
  kBest,  // from every vertex, and takes the smallest
};

/// Packs clusters of one list of triangles. Keeps its memory; one packer a thread.
class ClusterPacker {
 public:
  /// `indices`: 3 a triangle, each below vertex_count; `offsets`: 3 a vertex, lattice offsets from lattice_min, each
  /// below 2^24. Both outlive the packer's use.
  void begin(std::span<const uint32_t> indices, std::span<const uint32_t> offsets, uint32_t vertex_count,
             PackEffort effort);

  /// Appends the cluster of as many of the first of `triangles` (1 and more, numbers in `indices`) as it may have, and
  /// returns how many: those that use at most 128 vertices, or kMaxDegenerateVertices where one has two equal corners.
  uint32_t pack(std::span<const uint32_t> triangles, ClusterSet& out);

 private:
  /// A way to number the vertices.
  struct Numbering {
    std::array<uint8_t, kMaxClusterVertices> number;    // of each vertex in order of first use
    std::array<uint8_t, kMaxClusterTriangles> order;    // triangles by largest number
    std::array<uint8_t, kMaxClusterTriangles> largest;  // of the triangle at each place of `order`
    uint32_t padding;                                   // repeats before vertex 0
    uint32_t distance_bits;
    bool wide_steps;
    uint32_t words;  // of steps and distances
  };

  /// A bit a triangle of the cluster.
  using TriangleSet = std::array<uint64_t, 2>;
  static_assert(kMaxClusterTriangles == 128);

  /// The triangles that have a vertex as their corner 0, 1 and 2.
  using CornerSets = std::array<TriangleSet, 3>;

  static void add(const CornerSets& more, CornerSets& sets) {
    for (size_t i = 0; i < 3; ++i)
      for (size_t word = 0; word < 2; ++word) sets[i][word] |= more[i][word];
  }

  void gather(std::span<const uint32_t> triangles);
  uint32_t number_from(uint32_t start, uint32_t most_bits, Numbering& out);
  void choose_numbering();
  uint32_t* put_triangles(PackedCluster& cluster, uint32_t* words) const;
  uint32_t* put_data(PackedCluster& cluster, std::vector<uint32_t>& vertices, uint32_t* words) const;

  std::span<const uint32_t> indices_;
  std::span<const uint32_t> offsets_;
  PackEffort effort_ = PackEffort::kFast;
  std::vector<uint8_t> slots_;  // of each vertex of the list its number in the cluster

  // Of the cluster that is packed, vertices by first use:
  uint32_t triangle_count_ = 0;
  uint32_t vertex_count_ = 0;
  std::array<uint32_t, kMaxClusterVertices + 3> vertices_;  // in the list; room for a triangle that does not fit
  std::array<std::array<uint8_t, 3>, kMaxClusterTriangles> corners_;
  std::array<CornerSets, kMaxClusterVertices> at_vertex_{};  // empty between clusters
  Numbering best_;
  Numbering trial_;
};

}  // namespace scree::format
