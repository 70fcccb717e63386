// Cuts lists of triangles into clusters of at most 128 triangles and 128 vertices.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace scree::tools {

/// A partition of a list's triangles into clusters.
struct ClusterCut {
  std::vector<uint32_t> triangles;  // triangle numbers, cluster by cluster
  std::vector<uint32_t> ends;       // end of each cluster in `triangles`
};

/// Grows clusters from triangle to neighbouring triangle; each begins beside the previous one. This gives few vertices
/// per cluster and small boxes for any order of the input. Memory: about 50 bytes per triangle.
ClusterCut cut_by_neighbourhood(std::span<const uint32_t> indices, uint32_t vertex_count, uint32_t most_triangles);

}  // namespace scree::tools
