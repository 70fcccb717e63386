// Cuts lists of triangles into clusters and packs them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "format/geometry/cluster_codec.h"
#include "format/geometry/cluster_pack.h"

namespace scree::tools {

enum class ClusterEffort {
  kFast,  // consecutive triangles: for lists ordered for a vertex cache
  kBest,  // by neighbourhood, with the smallest numbering: scans 4 to 7% smaller in 12 to 16 times the time
};

/// Cuts and packs one list after another and keeps its memory; use one per thread.
class ClusterBuilder {
 public:
  /// The clusters of all triangles, valid until the next call. `indices`: 3 per triangle, each below the number of
  /// vertices. `offsets`: 3 per vertex, lattice offsets below 2^24. `most_triangles`: the most of a cluster, at least
  /// 1. `order`: only for kFast, all triangles in the order in which they are cut; empty: the order of the list.
  const format::ClusterSet& build(std::span<const uint32_t> indices, std::span<const uint32_t> offsets,
                                  ClusterEffort effort, uint32_t most_triangles = format::kMaxClusterTriangles,
                                  std::span<const uint32_t> order = {});

 private:
  std::vector<uint32_t> as_listed_;  // 0, 1, 2 and so on
  format::ClusterPacker packer_;
  format::ClusterSet set_;
};

/// Encodes all triangles of a list as one clustered chunk, for scenes that are made in memory. Sets `bytes` of `record`
/// and the fields that format::describe_clusters() sets. Appends the streams of clusters to `payload`. If `vertices`
/// and `triangles` are not null, they receive the index in the list of each stored vertex and triangle, for the streams
/// of attributes. Arguments as in ClusterBuilder::build(). The payload of 65536 triangles, the largest chunk in
/// practice, is below 2 MiB.
void encode_clustered_chunk(ClusterBuilder& builder, std::span<const uint32_t> indices,
                            std::span<const uint32_t> offsets, ClusterEffort effort, format::ChunkRecord& record,
                            std::vector<std::byte>& payload, std::vector<uint32_t>* vertices = nullptr,
                            std::vector<uint32_t>* triangles = nullptr);

}  // namespace scree::tools
