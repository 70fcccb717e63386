// Cuts lists of triangles into clusters of at most 128 triangles and 128 vertices.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace scree::tools {

/// Every triangle of a list in one cluster.
struct ClusterCut {
  std::vector<uint32_t> triangles;  // their numbers, cluster by cluster
  std::vector<uint32_t> ends;       // of each cluster in `triangles`
};

/// Clusters that grow from triangle to neighbouring triangle, each beside the one before: fewer vertices a cluster and
/// smaller boxes, whatever order the triangles come in. Memory: about 50 bytes a triangle.
ClusterCut cut_by_neighbourhood(std::span<const uint32_t> indices, uint32_t vertex_count, uint32_t most_triangles);

}  // namespace scree::tools
