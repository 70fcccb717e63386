#include "tools/clusters/cluster_builder.h"

#include <algorithm>
#include <cassert>
#include <numeric>

#include "tools/clusters/cluster_cut.h"

namespace scree::tools {

const format::ClusterSet& ClusterBuilder::build(std::span<const uint32_t> indices, std::span<const uint32_t> offsets,
                                                ClusterEffort effort, uint32_t most_triangles,
                                                std::span<const uint32_t> order) {
  const auto vertices = static_cast<uint32_t>(offsets.size() / 3);
  set_.clear();
  // Usually sufficient: there are 0.6 to 0.8 vertices and 0.7 to 1.3 words per triangle.
  const size_t triangles = indices.size() / 3;
  set_.triangles.reserve(triangles);
  set_.vertices.reserve(triangles);
  set_.words.reserve(2 * triangles);
  if (effort == ClusterEffort::kBest) {
    packer_.begin(indices, offsets, vertices, format::PackEffort::kBest);
    const ClusterCut cut = cut_by_neighbourhood(indices, vertices, most_triangles);
    size_t first = 0;
    for (const uint32_t end : cut.ends) {
      const auto cluster = std::span<const uint32_t>(cut.triangles).subspan(first, end - first);
      [[maybe_unused]] const uint32_t packed = packer_.pack(cluster, set_);
      assert(packed == cluster.size());
      first = end;
    }
    return set_;
  }
  if (order.empty()) {
    as_listed_.resize(triangles);
    std::iota(as_listed_.begin(), as_listed_.end(), 0u);
    order = as_listed_;
  }
  packer_.begin(indices, offsets, vertices, format::PackEffort::kFast);
  while (!order.empty()) {
    const size_t most = std::min<size_t>(order.size(), most_triangles);
    order = order.subspan(packer_.pack(order.first(most), set_));
  }
  return set_;
}

void encode_clustered_chunk(ClusterBuilder& builder, std::span<const uint32_t> indices,
                            std::span<const uint32_t> offsets, ClusterEffort effort, format::ChunkRecord& record,
                            std::vector<std::byte>& payload, std::vector<uint32_t>* vertices,
                            std::vector<uint32_t>* triangles) {
  const format::ClusterSet& set = builder.build(indices, offsets, effort);
  const format::ClusterRun run{0, set.clusters.size(), 0};
  format::describe_clusters(set, run, record);
  record.bytes = format::cluster_stream_bytes(record.cluster_count, record.cluster_words);
  const size_t before = payload.size();
  payload.resize(before + record.bytes);
  format::write_clusters(std::span<std::byte>(payload).subspan(before), set, run, record);
  if (vertices != nullptr) *vertices = set.vertices;
  if (triangles != nullptr) *triangles = set.triangles;
}

}  // namespace scree::tools
