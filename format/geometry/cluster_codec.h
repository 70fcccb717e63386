// The streams of a clustered chunk: triangles and positions, cut into clusters that decode alone.
// Source: spec/codecs.md, clusters.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "format/geometry/cluster_layout.h"
#include "format/geometry/position_codec.h"
#include "format/layout.h"
#include "format/result.h"

namespace scree::format {

/// Groups of so many clusters.
constexpr uint64_t group_count(uint64_t clusters) {
  return (clusters + kGroupClusters - 1) / kGroupClusters;
}

/// What the records say of a clustered chunk, and its streams: exactly chunk_streams() of them.
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

/// `payload`: the chunk's bytes, as many as its streams take together.
ClusterStreams cluster_streams_of(const MeshRecord& mesh, const ChunkRecord& chunk, std::span<const std::byte> payload);

/// What is wanted of a chunk's clusters; empty where it is not.
struct ClusterOutput {
  std::span<uint32_t> indices;  // 3 * triangle_count, each < vertex_count
  std::span<uint32_t> offsets;  // 3 * vertex_count, from the mesh's lattice_min
  std::span<float> positions;   // 3 * vertex_count, model units
};

/// Decodes all clusters of a chunk. All is checked whatever is wanted. Safe on any input; errors kRange, kTruncated,
/// kTrailing, kReserved (cluster named), after which the outputs are unspecified. No allocation; reentrant.
Result<void> decode_clusters(const ClusterStreams& streams, const ClusterOutput& out);

/// The same checks without the output, for validating a page.
Result<void> check_clusters(const ClusterStreams& streams);

/// A box of lattice offsets.
struct OffsetBox {
  uint32_t min[3];
  uint32_t max[3];
};

/// The bounds that hold `box`, relative to `origin`, from which it lies less than 2^24: the finest.
ClusterBounds bounds_of(const OffsetBox& box, const uint32_t origin[3]);

/// A packed cluster of a ClusterSet.
struct PackedCluster {
  ClusterRecord record;  // place: without where the data begin; first_triangle and first_vertex unset
  uint32_t words;        // of data
  uint32_t min[3];       // box of its vertices, lattice offsets
  uint32_t max[3];

  uint32_t triangle_count() const { return cluster_layout(record).triangle_count; }
  uint32_t vertex_count() const { return cluster_layout(record).vertex_count; }
};

/// Packed clusters, one after the other.
struct ClusterSet {
  std::vector<PackedCluster> clusters;
  std::vector<uint32_t> words;      // of their data
  std::vector<uint32_t> triangles;  // which of the triangles given each one is
  std::vector<uint32_t> vertices;   // likewise of the vertices; repeats where clusters share them

  void clear();
};

/// Which clusters of a set, and where their part of its arrays begins.
struct ClusterRun {
  size_t first_cluster = 0;
  size_t cluster_count = 0;
  uint64_t first_word = 0;
};

/// Sets what `record` says of a clustered chunk of these clusters: encoding, counts, position range, words.
void describe_clusters(const ClusterSet& set, const ClusterRun& run, ChunkRecord& record);

/// Bytes of the four streams of a chunk of so many clusters and words.
uint64_t cluster_stream_bytes(uint64_t clusters, uint64_t words);

/// Writes the four streams, exactly cluster_stream_bytes(), of the chunk that describe_clusters() made.
void write_clusters(std::span<std::byte> out, const ClusterSet& set, const ClusterRun& run, const ChunkRecord& record);

}  // namespace scree::format
