#include "format/container/check.h"

#include "format/container/checker.h"

namespace scree::format {
namespace {

// Record bytes that are checked together. Meshes and nodes are then still in the second-level cache when the instances
// that refer to them are checked. In files that convert writes, they lie about equally far into their tables.
constexpr uint64_t kPartBytes = 256 << 10;

Result<void> check_in_parts(const TableViews& tables, TableReader& reader, uint64_t parts) {
  Checker checker(tables, reader);
  SCREE_TRY(checker.strings());
  SCREE_TRY(checker.pages());
  for (Part part{0, parts}; part.index < parts; ++part.index) {
    SCREE_TRY(checker.meshes(part));
    if (part.is_last()) SCREE_TRY(checker.groups());
    SCREE_TRY(checker.nodes(part));
    if (part.is_last()) SCREE_TRY(checker.node_instances());
    SCREE_TRY(checker.matrices(part));
    SCREE_TRY(checker.scenes(part));
  }
  SCREE_TRY(checker.scene_roots());
  SCREE_TRY(checker.materials());
  SCREE_TRY(checker.surfaces());
  SCREE_TRY(checker.lights());
  SCREE_TRY(checker.textures());
  SCREE_TRY(checker.images());
  SCREE_TRY(checker.masks());
  SCREE_TRY(checker.cameras());
  return checker.source();
}

}  // namespace

Result<void> Checker::strings() {
  const TableView& strings = tables_.view(TableKind::kStrings);
  if (!strings.first || strings.count == 0) return fail(ErrorCode::kFormat, "the file has no string table");
  if (strings.first[0] != std::byte{0}) return fail(ErrorCode::kFormat, "string table: the string at 0 is not empty");
  if (strings.first[strings.count - 1] != std::byte{0})
    return fail(ErrorCode::kFormat, "string table: the last string has no end");
  string_bytes_ = strings.count;
  return {};
}

Result<void> check_records(const TableViews& tables, TableReader& reader) {
  uint64_t bytes = 0;
  for (const TableKind kind :
       {TableKind::kMeshes, TableKind::kChunks, TableKind::kNodes, TableKind::kInstances, TableKind::kMatrices}) {
    bytes += tables.view(kind).count * tables.view(kind).stride;
  }
  const uint64_t parts = bytes / kPartBytes + 1;
  if (auto checked = check_in_parts(tables, reader, parts); checked || parts == 1) return checked;
  // The reported error is the first one in the order of the tables.
  return check_in_parts(tables, reader, 1);
}

}  // namespace scree::format
