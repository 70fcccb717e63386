// Packs clusters: numbers their vertices, orders their triangles, predicts an axis. Source: spec/codecs.md, clusters.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "format/geometry/cluster_codec.h"

namespace scree::format {

/// Most vertices of a cluster with a degenerate triangle (two equal vertices), which may need two more.
inline constexpr uint32_t kMaxDegenerateVertices = kMaxClusterVertices - 2;

enum class PackEffort {
  kFast,  // numbers the vertices once, from one end of the cluster
  kBest,  // tries every vertex as the start and takes the smallest result
};

/// Packs clusters of one list of triangles. Keeps its memory between clusters; use one packer per thread.
class ClusterPacker {
 public:
  /// `indices`: 3 per triangle, each below vertex_count. `offsets`: 3 per vertex, lattice offsets from lattice_min,
  /// each below 2^24. Both must stay valid while the packer is used.
  void begin(std::span<const uint32_t> indices, std::span<const uint32_t> offsets, uint32_t vertex_count,
             PackEffort effort);

  /// Packs as many of the first `triangles` as fit one cluster, and appends it to `out`. `triangles`: numbers of
  /// triangles in `indices`, at least one. Returns how many it packed. A cluster has at most 128 vertices, or
  /// kMaxDegenerateVertices if a triangle in it has two equal corners.
  uint32_t pack(std::span<const uint32_t> triangles, ClusterSet& out);

 private:
  /// One way to number the vertices.
  struct Numbering {
    std::array<uint8_t, kMaxClusterVertices> number;  // per vertex, in order of first use
    std::array<uint8_t, kMaxClusterTriangles> order;  // triangles by largest number
    // By the index in `order`: distances of the second corner (low byte) and the third from the largest number.
    std::array<uint16_t, kMaxClusterTriangles> distances;
    // The number from which steps begin, the largest number of each triangle in order, and copies of the last one.
    std::array<uint8_t, kMaxClusterTriangles + 8> largest;
    uint32_t padding;  // repeats before vertex 0
    uint32_t distance_bits;
    bool wide_steps;
    uint32_t words;  // for steps and distances

    /// The steps of the 8 triangles from an index in `order` on, one per byte; 0 after the last triangle.
    uint64_t steps(uint32_t first) const;
  };

  /// One bit per triangle of the cluster.
  using TriangleSet = std::array<uint64_t, 2>;
  static_assert(kMaxClusterTriangles == 128);

  /// A number of corners, 0 to 3, per triangle of the cluster: its low and its high bit.
  struct CornerCounts {
    TriangleSet ones, twos;

    /// Sums must not exceed 3.
    void add(const CornerCounts& more) {
      for (size_t word = 0; word < 2; ++word) {
        twos[word] ^= more.twos[word] ^ (ones[word] & more.ones[word]);
        ones[word] ^= more.ones[word];
      }
    }
    uint64_t two(size_t word) const { return twos[word] & ~ones[word]; }
    uint64_t any(size_t word) const { return ones[word] | twos[word]; }
    uint64_t three(size_t word) const { return ones[word] & twos[word]; }
  };

  void gather(std::span<const uint32_t> triangles);
  uint32_t number_from(uint32_t start, uint32_t most_bits, Numbering& out) const;
  void order_triangles(Numbering& out) const;
  static void order_fan(Numbering& out, uint32_t begin, uint32_t end);
  void choose_numbering();
  uint32_t* put_triangles(PackedCluster& cluster, uint32_t* words) const;
  uint32_t* put_data(PackedCluster& cluster, std::vector<uint32_t>& vertices, uint32_t* words) const;

  std::span<const uint32_t> indices_;
  std::span<const uint32_t> offsets_;
  PackEffort effort_ = PackEffort::kFast;
  std::vector<uint8_t> slots_;  // per vertex of the list: its number in the cluster

  // The cluster being packed, vertices by first use:
  uint32_t triangle_count_ = 0;
  uint32_t vertex_count_ = 0;
  std::array<uint32_t, kMaxClusterVertices + 3> vertices_;  // in the list; room for a triangle that does not fit
  std::array<std::array<uint8_t, 3>, kMaxClusterTriangles> corners_;
  std::array<CornerCounts, kMaxClusterVertices> at_vertex_{};  // corners at each vertex; none between clusters
  Numbering best_;
  Numbering trial_;
};

}  // namespace scree::format
