// Chunks into pages, pages into the file, in order.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "format/container.h"
#include "format/result.h"
#include "tools/convert/encode.h"
#include "tools/convert/ordered_pool.h"

namespace scree::convert {

/// Fills geometry pages with chunks in the order they come; a page is closed before a chunk would take it past
/// kPageTargetBytes. Pages are compressed on the pool and written in order by the calling thread. Destroy it before the
/// pool.
class GeometryWriter {
 public:
  /// `first_page`: the number of pages that `writer` has; nobody else appends any until finish().
  GeometryWriter(WorkerPool& pool, format::ContainerWriter& writer, uint32_t first_page, int zstd_level)
      : pages_(pool, true),
        writer_(writer),
        zstd_level_(zstd_level),
        limit_(2 * uint64_t{pool.threads()} + 2),
        number_(first_page),
        written_(first_page) {}

  /// Places a chunk: sets page and offset of its record. Errors of ContainerWriter::append.
  Result<void> add(EncodedChunk& chunk);

  /// Time in calls that write, and in threads that check-sum and compress.
  double write_seconds() const { return 1e-9 * static_cast<double>(writing_.load()); }
  double seal_seconds() const { return 1e-9 * static_cast<double>(sealing_.load()); }

  /// Closes the last page and writes what is left.
  Result<void> finish();

 private:
  Result<void> seal();
  Result<void> write_one();

  // Nanoseconds; outlive the jobs of pages_.
  std::atomic<uint64_t> writing_{0};
  std::atomic<uint64_t> sealing_{0};
  OrderedResults<format::SealedPage> pages_;
  format::ContainerWriter& writer_;
  int zstd_level_;
  uint64_t limit_;
  std::vector<std::byte> page_;
  std::vector<format::PageClusters> clusters_;  // of the open page
  bool open_ = false;                           // page_ holds a chunk, which may be empty: all its values equal
  uint32_t number_;                             // of the open page
  uint32_t written_;                            // pages in the file
};

}  // namespace scree::convert
