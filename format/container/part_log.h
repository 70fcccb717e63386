// The data that a writer needs to continue a .part after its process was killed: a mark where the finished file has its
// header, and a log of entries behind all content of the finished file. They lie in the .part itself, so that a crash
// leaves no other file behind. The finished file has neither.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>

#include "format/container/part_file.h"
#include "format/result.h"

namespace scree::format {

/// Identifies the input and the settings that a .part is made from. A .part with another id is not continued.
using PartId = std::array<uint64_t, 2>;

/// Not thread-safe. The mark is 64 bytes: magic, version, offset of the log, id, checksum. An entry is its kind, its
/// length, a checksum of both and of the entry's bytes, then the bytes. The log ends at the first entry that fails its
/// checksum.
class PartLog {
 public:
  /// Writes the mark; the log begins at `offset`. Errors as PartFile.
  static Result<PartLog> start(const PartFile& file, const PartId& id, uint64_t offset);

  using Take = std::function<void(uint32_t kind, std::span<const std::byte> entry)>;

  /// Calls `take` for the entries of a .part with this `id`, in order; add() appends behind them. Errors kFile (it
  /// cannot be read), kFormat (no mark, or another id).
  static Result<PartLog> read(const PartFile& file, const PartId& id, const Take& take);

  /// Offset of the log in the .part, bytes.
  uint64_t offset() const { return offset_; }

  /// Appends an entry. Errors as PartFile.
  Result<void> add(const PartFile& file, uint32_t kind, std::span<const std::byte> entry);

 private:
  uint64_t offset_ = 0;
  uint64_t end_ = 0;
};

}  // namespace scree::format
