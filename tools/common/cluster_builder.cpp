#include "tools/common/cluster_builder.h"

#include <algorithm>

#include "tools/common/cluster_cut.h"

namespace scree::tools {

const format::ClusterSet& ClusterBuilder::build(std::span<const uint32_t> indices, std::span<const uint32_t> offsets,
                                                ClusterEffort effort, uint32_t most_triangles) {
  const auto vertices = static_cast<uint32_t>(offsets.size() / 3);
  const bool best = effort == ClusterEffort::kBest;
  const ClusterCut cut =
      best ? cut_by_neighbourhood(indices, vertices, most_triangles) : cut_in_order(indices, vertices, most_triangles);
  set_.clear();
  packer_.begin(indices, offsets, vertices, best ? format::PackEffort::kBest : format::PackEffort::kFast);
  size_t first = 0;
  for (const uint32_t end : cut.ends) {
    packer_.pack(std::span<const uint32_t>(cut.triangles).subspan(first, end - first), set_);
    first = end;
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
