#include "tools/convert/position_table.h"

#include <algorithm>

#include "format/bytes.h"
#include "format/chunk_layout.h"
#include "tools/common/human.h"
#include "tools/common/options.h"
#include "tools/inspect/text_table.h"

namespace scree::convert {
namespace {

constexpr uint32_t kFloatBits = 32;

}  // namespace

/// Of a clustered chunk what is left when its clusters' indices are taken off.
uint64_t PositionTable::position_bytes(const format::MeshRecord& mesh, const format::ChunkRecord& chunk,
                                       std::span<const std::byte> payload) {
  const format::ChunkStreams streams = format::chunk_streams(mesh, chunk);
  if (chunk.encoding != format::ChunkEncoding::kClustered) return streams.positions.bytes;
  uint64_t index_words = 0;
  for (uint64_t i = 0; i < chunk.cluster_count; ++i) {
    const auto record = format::load<format::ClusterRecord>(payload.data() + streams.clusters.offset +
                                                            i * sizeof(format::ClusterRecord));
    const format::ClusterLayout layout = format::cluster_layout(record);
    index_words += layout.positions - layout.steps;
  }
  return streams.cluster_data.bytes - 4 * index_words;
}

void PositionTable::add(const format::MeshRecord& mesh, bool is_first, const format::ChunkRecord& chunk,
                        uint64_t position_bytes) {
  const uint32_t bits = mesh.position_encoding == format::PositionEncoding::kFloat32
                            ? kFloatBits
                            : *std::max_element(std::begin(mesh.lattice_bits), std::end(mesh.lattice_bits));
  Row& row = rows_[bits];
  row.meshes += is_first ? 1 : 0;
  row.triangles += chunk.triangle_count;
  row.bytes += position_bytes;
  row.float_bytes += uint64_t{12} * chunk.vertex_count;
}

std::string PositionTable::text() const {
  inspect::TextTable table;
  table.row({"bits an axis", "meshes", "triangles", "positions", "as float32", "saved"});
  table.rule();
  const auto add = [&](const std::string& name, const Row& row) {
    const uint64_t saved = row.float_bytes - std::min(row.bytes, row.float_bytes);
    table.row({name, tools::grouped(row.meshes), tools::grouped(row.triangles), tools::format_bytes(row.bytes),
               tools::format_bytes(row.float_bytes), tools::format_bytes(saved)});
  };
  Row all;
  for (const auto& [bits, row] : rows_) {
    add(bits == kFloatBits ? "float32" : std::to_string(bits), row);
    all.meshes += row.meshes;
    all.triangles += row.triangles;
    all.bytes += row.bytes;
    all.float_bytes += row.float_bytes;
  }
  table.rule();
  add("all", all);
  return table.text();
}

}  // namespace scree::convert
