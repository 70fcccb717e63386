// How fast the disk below a file is by itself: what loading and converting are measured against.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "format/result.h"

namespace scree::bench {

/// How raw reads and writes go.
inline constexpr uint64_t kRawBlockBytes = uint64_t{4} << 20;
inline constexpr uint64_t kMostRawBytes = uint64_t{8} << 30;       // read of a file, from its beginning
inline constexpr uint64_t kMostRawWriteBytes = uint64_t{4} << 30;  // written to see how fast that is

/// Bytes that went to or from the disk past the page cache, and how long that took.
struct RawRate {
  uint64_t bytes = 0;
  double seconds = 0;

  double gb_per_s() const { return seconds > 0 ? static_cast<double>(bytes) * 1e-9 / seconds : 0; }
};

/// Reads the file's first kMostRawBytes, `in_flight` blocks at a time, into memory that is thrown away. `in_flight`: at
/// least 1. Errors kUnsupported (the file system has no such reads), kFile, kMemory.
Result<RawRate> read_raw(const std::string& path, uint32_t in_flight);

/// Writes a file of bytes that do not compress, several blocks at a time, until the rate of all that is written holds
/// still (is_steady), and removes it. `most_bytes`: no more than so many (rounded up to whole sectors), nor more than
/// kMostRawWriteBytes. The seconds are those until all of it is on the disk (fsync). Nothing may be at `path`. Errors
/// as read_raw.
Result<RawRate> write_raw(const std::string& path, uint64_t most_bytes);

/// Whether the last two of these rates, each of all that was written until then, changed by less than 2%.
bool is_steady(std::span<const double> rates);

/// What the disk gives below one file, read several times: the median.
class RawReads {
 public:
  /// Drops the file from the page cache and reads it: the first time with 1, 4 and 16 blocks in flight, then as the
  /// fastest of them. `notes`: gets why there are no such reads, once. Errors kFile, kMemory.
  Result<void> read(const std::string& path, std::vector<std::string>& notes);

  /// 0 where nothing was read.
  double gb_per_s() const;
  uint64_t bytes() const { return bytes_; }  // that each read took
  uint32_t in_flight() const { return in_flight_; }

 private:
  std::vector<float> rates_;
  uint64_t bytes_ = 0;
  uint32_t in_flight_ = 0;  // the fastest; 0: not known yet
  bool is_missing_ = false;
};

}  // namespace scree::bench
