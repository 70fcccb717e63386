// Puts the pages of shards into one file, with the same page borders as one run.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "format/container/container.h"
#include "format/result.h"
#include "tools/common/jobs/ordered_pool.h"
#include "tools/common/jobs/stage_rates.h"
#include "tools/convert/encode/geometry_writer.h"
#include "tools/convert/passes/shard.h"

namespace scree::convert {

/// Appends the pages of all images of the shards, and returns the images: renumbered, with their levels and pages, for
/// the file. `count`: of images. Errors: kRange (a page that a shard does not have), kFormat (another number of
/// images), kChecksum, and those of the writer.
Result<std::vector<StoredImageRecord>> append_images(ShardSet& shards, uint64_t count, format::ContainerWriter& writer);

/// Appends the windows of shards, in order. One run fills pages greedily. So once a page of a shard begins where a page
/// of the file begins, all later pages of that shard are pages of the file too. The last one is an exception, because
/// the next shard continues it. Such pages are copied whole; the chunks of all others are added to new pages. The
/// content of every chunk is checked on the pool. Used by one thread; destroy it before the pool.
class MergePass {
 public:
  MergePass(WorkerPool& pool, format::ContainerWriter& writer, int zstd_level, StageTimes& times)
      : geometry_(pool, writer, zstd_level, times, {}),
        checks_(pool, false),
        most_bytes_(2 * format::kPageTargetBytes * (uint64_t{pool.threads()} + 1)) {}

  /// Begins a shard, which must outlive this. Errors as finish().
  Result<void> begin(const ShardFile& shard);

  /// Adds the chunks of the shard's next window, of `mesh`, which must outlive this and keep its lattice and
  /// attributes. Errors name the shard: kRange, kReserved, kTrailing (a chunk's record, or pages that do not consist of
  /// their chunks), those of Container::load_page and GeometryWriter, and those of finish(), of earlier chunks.
  Result<void> add(WindowOutcome& window, const format::MeshRecord& mesh);

  /// Writes the last page. After that every chunk has been checked. Errors name the shard: those of
  /// runtime::check_chunk.
  Result<void> finish();

 private:
  /// A chunk of the shard's page.
  struct PlacedChunk {
    uint64_t number = 0;  // in the file, for messages
    const format::MeshRecord* mesh = nullptr;
    format::ChunkRecord record;  // as the shard has it
  };

  Result<void> turn_to(const format::ChunkRecord& chunk);
  Result<void> leave_page();

  GeometryWriter geometry_;
  OrderedResults<bool> checks_;  // of pages; a result is true
  uint64_t most_bytes_;          // of pages that are being checked, if there are several
  const ShardFile* shard_ = nullptr;
  uint32_t last_page_ = format::kNone;  // of the shard's geometry
  uint32_t page_ = format::kNone;       // the shard's page of the previous chunk
  uint32_t copy_ = format::kNone;       // the number of that page in the file if it was copied whole, else kNone
  std::shared_ptr<const std::vector<std::byte>> bytes_;  // of the page: as stored if it was copied, else its content
  std::vector<PlacedChunk> chunks_;                      // of the page, so far
  uint64_t page_end_ = 0;                                // of the last of them, in the content of the page
  uint64_t chunk_count_ = 0;                             // of all shards so far
  const format::MeshRecord* mesh_ = nullptr;             // of the previous chunk
  uint64_t mesh_triangles_ = 0;                          // of its chunks so far
};

/// Adds all windows of the shards, in order, and finishes the pass. Changes the shards. `windows`: the source's.
/// `mesh_of`: the mesh of each primitive, an index of `meshes`. `note`: is called for each window that was added; its
/// error ends the merge. Other errors name the shard: kFormat (a window that differs from the source), and those of the
/// pass.
Result<void> merge_windows(ShardSet& shards, std::span<const WindowPlan> windows, std::span<const uint32_t> mesh_of,
                           std::span<const format::MeshRecord> meshes, MergePass& pass,
                           const std::function<Result<void>(const WindowPlan&, const WindowOutcome&)>& note);

}  // namespace scree::convert
