// Chunks into pages, pages into the file, in order.
#pragma once

#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "format/container/container.h"
#include "format/result.h"
#include "tools/common/ordered_pool.h"
#include "tools/common/stage_rates.h"
#include "tools/convert/encode/encode.h"

namespace scree::convert {

/// Fills geometry pages with chunks in the order they come; a page is closed before a chunk would take it past
/// kPageTargetBytes. Pages are compressed on the pool and written in order by the calling thread. Destroy it before the
/// pool.
class GeometryWriter {
 public:
  /// A page that is not full, for a writer of another pool to go on with.
  struct OpenPage {
    std::vector<std::byte> bytes;
    std::vector<format::PageClusters> clusters;
    bool is_open = false;  // it holds a chunk, which may be empty: all its values equal
  };

  /// `open`: behind the pages that `writer` has; nobody else appends any until finish() or release().
  GeometryWriter(WorkerPool& pool, format::ContainerWriter& writer, int zstd_level, StageTimes& times, OpenPage open)
      : times_(times),
        pages_(pool, true),
        writer_(writer),
        zstd_level_(zstd_level),
        limit_(2 * uint64_t{pool.threads()} + 2),
        open_(std::move(open)),
        number_(writer.page_count()),
        written_(number_) {}

  /// Places a chunk: sets page and offset of its record. Errors of ContainerWriter::append.
  Result<void> add(EncodedChunk& chunk);

  /// Whether a chunk of so many bytes would join others in a page.
  bool fits(uint64_t bytes) const {
    return open_.is_open && open_.bytes.size() + bytes <= format::kPageTargetBytes;
  }

  /// A page that is sealed already, in place of its chunks, whose first no longer fits(). Returns its number. Errors of
  /// ContainerWriter::append_stored.
  Result<uint32_t> add_page(const format::PageRecord& page, const format::ContainerWriter::Read& read);

  /// Where the next chunk comes at the earliest: that page's number, and what is in it already.
  uint32_t page() const { return number_; }
  const OpenPage& open_page() const { return open_; }

  /// Closes the last page and writes what is left.
  Result<void> finish();

  /// Writes what is closed, and gives the last page away.
  Result<OpenPage> release();

 private:
  Result<void> seal();
  Result<void> write_all();
  Result<void> write_one();

  StageTimes& times_;
  OrderedResults<format::SealedPage> pages_;
  format::ContainerWriter& writer_;
  int zstd_level_;
  uint64_t limit_;
  OpenPage open_;
  uint32_t number_;   // of the open page
  uint32_t written_;  // pages in the file
};

}  // namespace scree::convert
