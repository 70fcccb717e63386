// The streams of a clustered chunk: triangles and positions, cut into clusters that decode independently. Source:
// spec/codecs.md, clusters.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "format/geometry/cluster_layout.h"
#include "format/geometry/offset_box.h"
#include "format/geometry/position_codec.h"
#include "format/layout.h"
#include "format/result.h"

namespace scree::format {

/// Number of cluster groups for that many clusters.
constexpr uint64_t group_count(uint64_t clusters) {
  return (clusters + kGroupClusters - 1) / kGroupClusters;
}

/// A clustered chunk's values from the records, and its streams, exactly as chunk_streams() gives them.
struct ClusterStreams {
  uint32_t triangle_count = 0;
  uint32_t vertex_count = 0;
  uint32_t cluster_count = 0;
  uint32_t cluster_words = 0;
  MeshLattice lattice;
  PositionRange range;
  std::span<const std::byte> group_bounds;
  std::span<const std::byte> cluster_bounds;
  std::span<const std::byte> clusters;
  std::span<const std::byte> data;
};

/// `payload`: the chunk's bytes, exactly as long as all of its streams.
ClusterStreams cluster_streams_of(const MeshRecord& mesh, const ChunkRecord& chunk, std::span<const std::byte> payload);

/// Outputs of decode_clusters(). An empty span is not written.
struct ClusterOutput {
  std::span<uint32_t> indices;  // 3 * triangle_count, each < vertex_count
  std::span<uint32_t> offsets;  // 3 * vertex_count, from the mesh's lattice_min
  std::span<float> positions;   // 3 * vertex_count, model units
};

/// Decodes all clusters of a chunk. Every check is made, also without outputs. Safe on any input; errors kRange,
/// kTruncated, kTrailing, kReserved (with the cluster), after which the outputs are unspecified. No allocation;
/// reentrant.
Result<void> decode_clusters(const ClusterStreams& streams, const ClusterOutput& out);

/// The same checks without the output, for validating a page.
Result<void> check_clusters(const ClusterStreams& streams);

/// A packed cluster of a ClusterSet.
struct PackedCluster {
  ClusterRecord record;  // without the data's start in `place`; first_triangle and first_vertex are unset
  uint32_t words;        // of data
  uint32_t min[3];       // box of its vertices, lattice offsets
  uint32_t max[3];

  uint32_t triangle_count() const { return cluster_layout(record).triangle_count; }
  uint32_t vertex_count() const { return cluster_layout(record).vertex_count; }
};

/// Packed clusters, in order.
struct ClusterSet {
  std::vector<PackedCluster> clusters;
  std::vector<uint32_t> words;      // of their data
  std::vector<uint32_t> triangles;  // index of each triangle in the packer's input
  std::vector<uint32_t> vertices;   // the same for vertices; vertices that clusters share are repeated

  void clear();
};

/// Consecutive clusters of a set, and the index of their first word.
struct ClusterRun {
  size_t first_cluster = 0;
  size_t cluster_count = 0;
  uint64_t first_word = 0;
};

/// Sets the fields of `record` for a clustered chunk of these clusters: encoding, counts, position range, words.
void describe_clusters(const ClusterSet& set, const ClusterRun& run, ChunkRecord& record);

/// Bytes of the four streams of a chunk with that many clusters and words.
uint64_t cluster_stream_bytes(uint64_t clusters, uint64_t words);

/// Writes the four streams, exactly cluster_stream_bytes(), of the chunk that describe_clusters() described.
void write_clusters(std::span<std::byte> out, const ClusterSet& set, const ClusterRun& run, const ChunkRecord& record);

}  // namespace scree::format
