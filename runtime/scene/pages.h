// Finds the geometry pages that a scene draws, loads them, and checks their content.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "format/bytes.h"
#include "format/container/container.h"
#include "format/result.h"
#include "runtime/files/mapped_file.h"
#include "runtime/threads/job_progress.h"

namespace scree::runtime {

/// "mesh 12 (Rock), chunk 340 (page 7, byte 65536)", for messages. The name is the glTF mesh's; it is left out if the
/// mesh has none.
std::string chunk_place(const format::Container& container, uint64_t chunk);

/// Checks every stream of a chunk of `mesh` that lies in `page` (raw bytes): sizes, index range, coordinate range,
/// finite floats, unit normals, zero slack. Errors kRange, kTruncated, kTrailing, kFormat, each with the stream.
Result<void> check_chunk(const format::MeshRecord& mesh, const format::ChunkRecord& chunk,
                         std::span<const std::byte> page);

/// The same checks of the streams behind a chunk's clusters. `rest`: the chunk's bytes after its cluster data.
Result<void> check_behind_clusters(const format::MeshRecord& mesh, const format::ChunkRecord& chunk,
                                   std::span<const std::byte> rest);

/// Counts the bytes of a page's chunks. Chunks that together take more than their page overlap.
class PageRoom {
 public:
  explicit PageRoom(uint64_t page_bytes) : left_(format::align_up(page_bytes, format::kChunkAlignment)) {}
  /// Returns false if there is no room for `chunk` beside the ones before.
  bool take(const format::ChunkRecord& chunk) {
    const uint64_t bytes = format::align_up(chunk.bytes, format::kChunkAlignment);
    if (bytes > left_) return false;
    left_ -= bytes;
    return true;
  }

 private:
  uint64_t left_;
};

/// The pages that hold chunks of drawn meshes, in file order, each with those chunks.
class DrawnPages {
 public:
  DrawnPages() = default;
  /// `container`: copied; its bytes must outlive this. drawn[mesh]: whether a mesh is drawn. Throws std::bad_alloc.
  DrawnPages(const format::Container& container, const std::vector<bool>& drawn);

  /// A copy with only the pages for which `is_kept(index)` returns true.
  template <class IsKept>
  DrawnPages subset(const IsKept& is_kept) const {
    DrawnPages kept;
    kept.container_ = container_;
    kept.first_chunk_.push_back(0);
    for (uint64_t i = 0; i < size(); ++i) {
      if (!is_kept(i)) continue;
      kept.chunks_.insert(kept.chunks_.end(), chunks_.begin() + static_cast<ptrdiff_t>(first_chunk_[i]),
                          chunks_.begin() + static_cast<ptrdiff_t>(first_chunk_[i + 1]));
      kept.first_chunk_.push_back(kept.chunks_.size());
    }
    return kept;
  }

  uint64_t size() const { return first_chunk_.empty() ? 0 : first_chunk_.size() - 1; }
  uint32_t page(uint64_t index) const { return chunks_[first_chunk_[index]].page; }
  const format::PageRecord& record(uint64_t index) const { return container_.pages()[page(index)]; }
  const format::Container& container() const { return container_; }
  /// The numbers of the drawn chunks of the page with that index, in ascending order.
  uint64_t chunk_count(uint64_t index) const { return first_chunk_[index + 1] - first_chunk_[index]; }
  uint64_t chunk(uint64_t index, uint64_t i) const { return chunks_[first_chunk_[index] + i].chunk; }

  /// Checks the drawn chunks of the page with that index (not page number). `raw`: the page's raw bytes. Thread-safe.
  /// Errors as check_chunk, and kRange: the chunks take more bytes than the page. Each has mesh, chunk and page.
  Result<void> check(uint64_t index, std::span<const std::byte> raw) const;

 private:
  struct PageChunk {
    uint32_t page;
    uint64_t chunk;
  };

  format::Container container_;
  std::vector<PageChunk> chunks_;      // page by page
  std::vector<uint64_t> first_chunk_;  // by page: index of its first entry in chunks_; one more entry ends the last
};

/// Shares pages among `owners` processes or GPUs. Returns the owner's number for each index in `pages`. In file order
/// each page goes to the owner with the fewest bytes so far, so the result depends only on the file's tables. Throws
/// std::bad_alloc.
std::vector<uint32_t> owners_of_pages(const DrawnPages& pages, uint32_t owners);

/// The part of a scene that one GPU of several gets.
struct PageShare {
  std::span<const uint32_t> owners;  // owners_of_pages()
  uint32_t owner = 0;                // of the pages that it gets
};

/// Raw bytes by page number; null where a page was not loaded.
struct PageSet {
  std::vector<const std::byte*> raw;
  std::vector<std::vector<std::byte>> decoded;  // of compressed pages; `raw` points into it or into the map
  uint64_t page_count = 0;
  uint64_t stored_bytes = 0;
  uint64_t decoded_bytes = 0;
};

/// Loads `pages` on `threads` threads and checks them. Returns the error of the first bad page, for any number of
/// threads: kChecksum and the others of Container::load_page and DrawnPages::check; kMemory. `map`: the file that the
/// container was opened on. `progress`: receives stored bytes, and may stop the loading (kFile).
Result<PageSet> load_pages(const DrawnPages& pages, const MappedFile& map, uint32_t threads,
                           JobProgress* progress = nullptr);

}  // namespace scree::runtime
