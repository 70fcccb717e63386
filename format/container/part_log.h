// What a writer needs to go on with a .part after its process was killed. The .part carries it itself, so that nothing
// else is left behind by a crash: a mark where the finished file has its header, and a log of entries behind all that
// the finished file will have. The finished file has nothing of either.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>

#include "format/container/part_file.h"
#include "format/result.h"

namespace scree::format {

/// Says what a .part is made from and how: one of another id is not gone on with.
using PartId = std::array<uint64_t, 2>;

/// Not thread-safe. The mark is 64 bytes: magic, version, offset of the log, id, checksum. An entry is its kind, its
/// length, a checksum of both and of its bytes, and the bytes; the log ends where that does not hold.
class PartLog {
 public:
  /// Writes the mark; the log begins at `offset`. Errors of PartFile.
  static Result<PartLog> start(const PartFile& file, const PartId& id, uint64_t offset);

  using Take = std::function<void(uint32_t kind, std::span<const std::byte> entry)>;

  /// Calls `take` for the entries of a .part of `id`, in order; what is added goes behind them. Errors kFile (it cannot
  /// be read), kFormat (no mark, or one of another id).
  static Result<PartLog> read(const PartFile& file, const PartId& id, const Take& take);

  /// Where the log begins.
  uint64_t offset() const { return offset_; }

  /// Errors of PartFile.
  Result<void> add(const PartFile& file, uint32_t kind, std::span<const std::byte> entry);

 private:
  uint64_t offset_ = 0;
  uint64_t end_ = 0;
};

}  // namespace scree::format
