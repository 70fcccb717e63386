// Keeps a disk busy while threads take ranges of a file in order: the ranges that come next are requested early.
#pragma once

#include <cstdint>
#include <mutex>
#include <vector>

#include "runtime/files/mapped_file.h"

namespace scree::runtime {

/// Bytes that are requested before a thread takes them. A fast disk reads them in 20 ms, so even few threads use its
/// whole rate.
inline constexpr uint64_t kReadAheadBytes = uint64_t{64} << 20;

/// The ranges of items 0, 1, ... of a loop. add() and end_item() may throw std::bad_alloc; only begin() is thread-safe.
class ReadAhead {
 public:
  explicit ReadAhead(const MappedFile& map) : map_(map) {}

  /// Adds a range to the item that is being described.
  void add(uint64_t offset, uint64_t bytes) {
    ranges_.push_back({offset, bytes, all_bytes_});
    all_bytes_ += bytes;
  }
  void end_item() { ends_.push_back(all_bytes_); }

  /// Requests ranges of up to kReadAheadBytes from this item on. To be called when a thread begins with the item.
  void begin(uint64_t item) {
    const std::unique_lock<std::mutex> lock(mutex_, std::try_to_lock);
    if (!lock) return;  // another thread requests them
    const uint64_t until = (item == 0 ? 0 : ends_[item - 1]) + kReadAheadBytes;
    for (; next_ < ranges_.size() && ranges_[next_].before < until; ++next_)
      map_.will_need(ranges_[next_].offset, ranges_[next_].bytes);
  }

 private:
  struct Range {
    uint64_t offset;
    uint64_t bytes;
    uint64_t before;  // bytes of all earlier ranges
  };

  const MappedFile& map_;
  std::vector<Range> ranges_;
  std::vector<uint64_t> ends_;  // by item: bytes of its and all earlier ranges
  uint64_t all_bytes_ = 0;
  size_t next_ = 0;
  std::mutex mutex_;
};

}  // namespace scree::runtime
