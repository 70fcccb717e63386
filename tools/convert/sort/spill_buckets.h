// Records of one size that are sorted by the bucket they belong to, through a file: the coarse half of a sort of more
// than fits into memory.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "format/container/part_file.h"
#include "format/result.h"

namespace scree::convert {

/// Records of some buckets, those of each together.
struct Grouped {
  std::vector<std::byte> records;
  std::vector<uint32_t> ends;  // of each bucket, in records
};

/// Puts records into groups: start() makes room for one of each of `buckets`, then place() says where the next record
/// of a bucket goes, in records. Kept for the next list by one thread.
class Grouping {
 public:
  void start(std::span<const uint32_t> buckets, uint32_t bucket_count, uint32_t record_bytes, Grouped& out);
  uint32_t place(uint32_t bucket) { return next_[bucket]++; }

 private:
  std::vector<uint32_t> next_;
};

/// The records of a bucket keep the order in which they were appended. In the file a bucket is a chain of blocks, so
/// that nothing need be counted before; in memory each has one block that is being filled.
class SpillBuckets {
 public:
  static constexpr uint64_t kBlockBytes = 32 << 10;

  /// Writes to `file`, which must live as long, from `offset` on.
  SpillBuckets(const format::PartFile& file, uint64_t offset, uint32_t buckets, uint32_t record_bytes);

  /// Used by one thread. Errors kFile.
  Result<void> append(const Grouped& grouped);

  /// Writes what blocks hold in memory; append() may not be called any more.
  Result<void> finish();

  uint32_t buckets() const { return static_cast<uint32_t>(chains_.size()); }
  uint64_t count(uint32_t bucket) const { return chains_[bucket].records; }

  /// Reads records from number `first` of a bucket on until `out` is full. After finish(); thread-safe. Errors kFile.
  Result<void> read(uint32_t bucket, uint64_t first, std::span<std::byte> out) const;

  /// What `records` take in the file at most, and in memory.
  static uint64_t most_file_bytes(uint64_t records, uint32_t buckets, uint32_t record_bytes);
  static uint64_t most_memory(uint64_t records, uint32_t buckets, uint32_t record_bytes);

 private:
  struct Chain {
    uint64_t records = 0;
    std::vector<uint32_t> blocks;    // in the file
    std::vector<std::byte> filling;  // the block after them
  };

  Result<void> append(Chain& chain, std::span<const std::byte> records);
  Result<void> write_block(Chain& chain);
  uint64_t block_records() const { return kBlockBytes / record_bytes_; }
  uint64_t block_bytes() const { return block_records() * record_bytes_; }

  const format::PartFile& file_;
  uint64_t offset_;
  uint64_t record_bytes_;
  uint32_t next_block_ = 0;
  std::vector<Chain> chains_;
};

}  // namespace scree::convert
