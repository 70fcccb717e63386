// Loading geometry pages and checking what they hold.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "format/container.h"
#include "format/result.h"
#include "runtime/mapped_file.h"

namespace scree::runtime {

/// Raw bytes by page number; null where a page was not loaded.
struct PageSet {
  std::vector<const std::byte*> raw;
  std::vector<std::vector<std::byte>> decoded;  // of compressed pages; `raw` points into it or into the map
  uint64_t page_count = 0;
  uint64_t stored_bytes = 0;
  uint64_t decoded_bytes = 0;
};

/// Checks every stream of a chunk of `mesh` that lies in `page` (raw bytes): sizes, index range, coordinate range,
/// finite floats, unit normals, zero slack. Errors kRange, kTruncated, kTrailing, kFormat, the stream named.
Result<void> check_chunk(const format::MeshRecord& mesh, const format::ChunkRecord& chunk,
                         std::span<const std::byte> page);

/// Loads, on `threads` threads, the pages that hold chunks of the meshes with drawn[mesh], and checks those chunks. The
/// error is that of the first bad page, whatever the number of threads: kChecksum and the others of
/// Container::load_page and check_chunk, mesh, chunk and page named; kMemory. `map` is what `container` was opened on.
Result<PageSet> load_pages(const format::Container& container, const MappedFile& map, const std::vector<bool>& drawn,
                           uint32_t threads);

}  // namespace scree::runtime
