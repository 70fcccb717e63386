// The pages of shards into one file, cut as one run would have cut them.
#pragma once

#include <cstdint>
#include <vector>

#include "format/container/container.h"
#include "format/result.h"
#include "tools/common/ordered_pool.h"
#include "tools/common/stage_rates.h"
#include "tools/convert/encode/geometry_writer.h"
#include "tools/convert/passes/shard.h"

namespace scree::convert {

/// Appends the pages of a shard's images and gives images, levels and pages their numbers in the file, where
/// `first_image` come before. Errors kRange (a page that the shard has not), kChecksum, and those of the writer.
Result<void> append_images(ShardFile& shard, uint64_t first_image, format::ContainerWriter& writer);

/// Windows of shards, in order. One run fills pages greedily, so where a page of a shard begins a page of the file, all
/// that follow in the shard are pages of the file too, but for the last, which the next shard goes on with: they are
/// copied as they are, and the others are taken apart. Used by one thread; destroy it before the pool.
class MergePass {
 public:
  MergePass(WorkerPool& pool, format::ContainerWriter& writer, int zstd_level, StageTimes& times)
      : geometry_(pool, writer, zstd_level, times, {}) {}

  /// Before the windows of a shard, which lives as long as this.
  void begin(const ShardFile& shard);

  /// Places the chunks of one of its windows. Errors kRange: a chunk that does not lie in the shard's pages; those of
  /// Container::load_page and GeometryWriter, the shard named.
  Result<void> add(WindowOutcome& window);

  Result<void> finish() { return geometry_.finish(); }

 private:
  Result<void> turn_to(const format::ChunkRecord& chunk);

  GeometryWriter geometry_;
  const ShardFile* shard_ = nullptr;
  uint32_t last_page_ = format::kNone;  // of the shard's geometry
  uint32_t page_ = format::kNone;       // of the shard, that the chunk before lies in
  uint32_t copy_ = format::kNone;       // its number in the file, where it was copied as it is
  std::vector<std::byte> raw_;          // else what it holds
};

}  // namespace scree::convert
