// Puts the pages of shards into one file, with the same page borders as one run.
#pragma once

#include <cstdint>
#include <vector>

#include "format/container/container.h"
#include "format/result.h"
#include "tools/common/jobs/ordered_pool.h"
#include "tools/common/jobs/stage_rates.h"
#include "tools/convert/encode/geometry_writer.h"
#include "tools/convert/passes/shard.h"

namespace scree::convert {

/// Appends the pages of a shard's images. Renumbers images, levels and pages for the file, which already has
/// `first_image` images. Errors: kRange (a page that the shard does not have), kChecksum, and those of the writer.
Result<void> append_images(ShardFile& shard, uint64_t first_image, format::ContainerWriter& writer);

/// Appends the windows of shards, in order. One run fills pages greedily. So once a page of a shard begins where a page
/// of the file begins, all later pages of that shard are pages of the file too. The last one is an exception, because
/// the next shard continues it. Such pages are copied whole; the chunks of all others are added to new pages. Used by
/// one thread; destroy it before the pool.
class MergePass {
 public:
  MergePass(WorkerPool& pool, format::ContainerWriter& writer, int zstd_level, StageTimes& times)
      : geometry_(pool, writer, zstd_level, times, {}) {}

  /// Begins a shard, which must outlive this.
  void begin(const ShardFile& shard);

  /// Adds the chunks of the shard's next window. Errors name the shard: kRange (a chunk outside the shard's pages),
  /// and those of Container::load_page and GeometryWriter.
  Result<void> add(WindowOutcome& window);

  Result<void> finish() { return geometry_.finish(); }

 private:
  Result<void> turn_to(const format::ChunkRecord& chunk);

  GeometryWriter geometry_;
  const ShardFile* shard_ = nullptr;
  uint32_t last_page_ = format::kNone;  // of the shard's geometry
  uint32_t page_ = format::kNone;       // the shard's page of the previous chunk
  uint32_t copy_ = format::kNone;       // the number of that page in the file if it was copied whole, else kNone
  std::vector<std::byte> raw_;          // otherwise the content of the page
};

}  // namespace scree::convert
