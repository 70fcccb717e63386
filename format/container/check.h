// Used by Container::open: the addresses of a file's tables, and the check of every field of every record. Chunks that
// are in no table yet are checked alone.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "format/container/container.h"
#include "format/fail.h"
#include "format/layout.h"
#include "format/result.h"

namespace scree::format {

inline constexpr uint32_t kKnownTableKinds = 23;  // TableKind values are below this

/// The tables of a file by kind. Kinds that the file lacks are empty.
struct TableViews {
  std::array<TableView, kKnownTableKinds> views{};
  uint64_t tables_offset = 0;  // bytes from the start of the file to the first table, where pages and their padding end
  bool newer_minor = false;    // the file is of a newer minor version than this reader
  bool is_second = false;      // the file is of major version kSecondMajor

  const TableView& view(TableKind kind) const { return views[static_cast<uint32_t>(kind)]; }

  template <class Record>
  Table<Record> table(TableKind kind) const {
    return Table<Record>(view(kind));
  }
};

/// Receives from check_records() the range of records that it reads next, one block ahead.
class TableReader {
 public:
  /// Announces that the records up to `record` are read next. Returns the record, above `record`, for which the next
  /// call is due.
  virtual uint64_t announce(TableKind kind, uint64_t record) = 0;

 protected:
  ~TableReader() = default;
};

/// Checks every field of every record (spec/container.md, tables). The tables must lie in the file, be aligned and have
/// at least the record sizes of their kinds. Nothing else is assumed, not even their checksums. `reader` is called
/// before a record of a large table is read for the first time. Allocates only for an error's text. Errors kRange,
/// kReserved, kFormat.
Result<void> check_records(const TableViews& tables, TableReader& reader);

/// Checks every field of a chunk, as check_records() does. `index`: of the chunk, for messages. `pages`: of the file
/// that has its page. `mesh`: number `mesh_index`, valid; its chunks before this one have `first_triangle` triangles.
/// Errors kRange, kReserved.
std::optional<Error> check_chunk_record(uint64_t index, const ChunkRecord& chunk, const Table<PageRecord>& pages,
                                        const MeshRecord& mesh, uint64_t mesh_index, uint64_t first_triangle);

}  // namespace scree::format
