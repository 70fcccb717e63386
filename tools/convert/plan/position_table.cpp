#include "tools/convert/plan/position_table.h"

#include <algorithm>
#include <cstdlib>

#include "tools/common/options/options.h"
#include "tools/common/output/human.h"
#include "tools/common/output/text_table.h"

namespace scree::convert {
namespace {

constexpr uint32_t kFloatBits = 32;

}  // namespace

void PositionTable::add(const format::MeshRecord& mesh, bool is_first, const format::ChunkRecord& chunk,
                        int64_t saved) {
  const uint32_t bits = mesh.position_encoding == format::PositionEncoding::kFloat32
                            ? kFloatBits
                            : *std::max_element(std::begin(mesh.lattice_bits), std::end(mesh.lattice_bits));
  Row& row = rows_[bits];
  row.meshes += is_first ? 1 : 0;
  row.triangles += chunk.triangle_count;
  row.bytes += chunk.bytes;
  row.saved += saved;
}

std::string PositionTable::text() const {
  inspect::TextTable table;
  table.row({"bits per axis", "meshes", "triangles", "bytes", "as float32", "saved"});
  table.rule();
  const auto add = [&](const std::string& name, const Row& row) {
    const std::string sign = row.saved < 0 ? "-" : "";
    table.row({name, tools::grouped(row.meshes), tools::grouped(row.triangles), tools::format_bytes(row.bytes),
               tools::format_bytes(row.bytes + static_cast<uint64_t>(row.saved)),
               sign + tools::format_bytes(static_cast<uint64_t>(std::abs(row.saved)))});
  };
  Row all;
  for (const auto& [bits, row] : rows_) {
    add(bits == kFloatBits ? "float32" : std::to_string(bits), row);
    all.meshes += row.meshes;
    all.triangles += row.triangles;
    all.bytes += row.bytes;
    all.saved += row.saved;
  }
  table.rule();
  add("all", all);
  return table.text();
}

}  // namespace scree::convert
