// Lists of triangles as packed clusters: cut, then packed.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "format/geometry/cluster_codec.h"
#include "format/geometry/cluster_pack.h"

namespace scree::tools {

enum class ClusterEffort {
  kFast,  // consecutive triangles: for lists in an order for vertex caches
  kBest,  // by neighbourhood, numbered the smallest way: scans 4 to 7% smaller in 12 to 16 times the time
};

/// Cuts and packs one list after the other and keeps its memory; one a thread.
class ClusterBuilder {
 public:
  /// The clusters of all triangles, valid until the next call. `indices`: 3 a triangle, each below the number of
  /// vertices; `offsets`: 3 a vertex, lattice offsets below 2^24. `most_triangles`: of a cluster, 1 and up. `order`:
  /// for kFast, all triangles in the order in which they are cut; empty: as they are in the list.
  const format::ClusterSet& build(std::span<const uint32_t> indices, std::span<const uint32_t> offsets,
                                  ClusterEffort effort, uint32_t most_triangles = format::kMaxClusterTriangles,
                                  std::span<const uint32_t> order = {});

 private:
  std::vector<uint32_t> as_listed_;  // 0, 1, 2 and so on
  format::ClusterPacker packer_;
  format::ClusterSet set_;
};

/// A clustered chunk of all triangles of a list, for scenes that are made in memory. Sets of `record` what
/// format::describe_clusters() sets, and `bytes`; appends the streams of clusters to `payload` and says in `vertices`
/// and `triangles`, where they are not null, which of the list's each one is, for the streams of attributes. As
/// ClusterBuilder::build(); the payload of the largest chunk that is sensible, 65536 triangles, is below 2 MiB.
void encode_clustered_chunk(ClusterBuilder& builder, std::span<const uint32_t> indices,
                            std::span<const uint32_t> offsets, ClusterEffort effort, format::ChunkRecord& record,
                            std::vector<std::byte>& payload, std::vector<uint32_t>* vertices = nullptr,
                            std::vector<uint32_t>* triangles = nullptr);

}  // namespace scree::tools
