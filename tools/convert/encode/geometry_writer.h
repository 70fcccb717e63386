// Writes chunks into pages, and pages into the file, in order.
#pragma once

#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "format/container/container.h"
#include "format/result.h"
#include "tools/common/jobs/ordered_pool.h"
#include "tools/common/jobs/stage_rates.h"
#include "tools/convert/encode/encode.h"

namespace scree::convert {

/// Fills geometry pages with chunks in the order in which they come. A chunk that would make a page exceed
/// kPageTargetBytes starts a new page. Pages are compressed on the pool and written in order by the calling thread.
/// Destroy it before the pool.
class GeometryWriter {
 public:
  /// A page that is not full, which the writer of another pass continues.
  struct OpenPage {
    std::vector<std::byte> bytes;
    std::vector<format::PageClusters> clusters;
    bool is_open = false;  // it has a chunk, which may be empty if all its values are equal
  };

  /// `open`: the page after the pages of `writer`. Nothing else may append pages until finish() or release().
  GeometryWriter(WorkerPool& pool, format::ContainerWriter& writer, int zstd_level, StageTimes& times, OpenPage open)
      : times_(times),
        pages_(pool, true),
        writer_(writer),
        zstd_level_(zstd_level),
        limit_(2 * uint64_t{pool.threads()} + 2),
        open_(std::move(open)),
        number_(writer.page_count()),
        written_(number_) {}

  /// Adds a chunk to a page, and sets page and offset in its record. Errors of ContainerWriter::append.
  Result<void> add(EncodedChunk& chunk);

  /// Whether a chunk of `bytes` fits into the open page behind its other chunks.
  bool fits(uint64_t bytes) const { return open_.is_open && open_.bytes.size() + bytes <= format::kPageTargetBytes; }

  /// Appends a sealed page as a whole. The first of its chunks must not fit() into the open page. Returns the page's
  /// number. Errors of ContainerWriter::append.
  Result<uint32_t> add_page(const format::SealedPage& page);

  /// The number and content of the open page.
  uint32_t page() const { return number_; }
  const OpenPage& open_page() const { return open_; }

  /// Closes the last page and writes all pages that are left.
  Result<void> finish();

  /// Writes all closed pages and returns the last page.
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
