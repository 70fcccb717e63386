// Sorts fixed-size records by bucket through a file: the coarse half of a sort that exceeds memory.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "format/container/part_file.h"
#include "format/result.h"

namespace scree::convert {

/// Records of several buckets, grouped by bucket.
struct Grouped {
  std::vector<std::byte> records;
  std::vector<uint32_t> ends;  // by bucket: its end, in records
};

/// Groups records: start() makes room for one record per entry of `buckets`; then place() returns the index of a
/// bucket's next record. Each thread keeps one for all its lists.
class Grouping {
 public:
  void start(std::span<const uint32_t> buckets, uint32_t bucket_count, uint32_t record_bytes, Grouped& out);
  uint32_t place(uint32_t bucket) { return next_[bucket]++; }

 private:
  std::vector<uint32_t> next_;
};

/// The records of a bucket keep the order in which they were appended. In the file a bucket is a chain of blocks, so
/// its entries need not be counted before. In memory each bucket has one block that is being filled.
class SpillBuckets {
 public:
  static constexpr uint64_t kBlockBytes = 32 << 10;

  /// Writes to `file`, which must outlive this, from `offset` on.
  SpillBuckets(const format::PartFile& file, uint64_t offset, uint32_t buckets, uint32_t record_bytes);

  /// Used by one thread. Errors kFile.
  Result<void> append(const Grouped& grouped);

  /// Writes the blocks in memory. append() must not be called afterwards.
  Result<void> finish();

  uint32_t buckets() const { return static_cast<uint32_t>(chains_.size()); }
  uint64_t count(uint32_t bucket) const { return chains_[bucket].records; }

  /// Reads records from number `first` of a bucket on until `out` is full. Called after finish(); thread-safe. Errors
  /// kFile.
  Result<void> read(uint32_t bucket, uint64_t first, std::span<std::byte> out) const;

  /// Upper bounds of the bytes that `records` take in the file and in memory.
  static uint64_t most_file_bytes(uint64_t records, uint32_t buckets, uint32_t record_bytes);
  static uint64_t most_memory(uint64_t records, uint32_t buckets, uint32_t record_bytes);

 private:
  struct Chain {
    uint64_t records = 0;
    std::vector<uint32_t> blocks;    // numbers of its blocks in the file
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
