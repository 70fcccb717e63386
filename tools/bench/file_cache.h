// What of a file lies in the page cache, and how fast the disk below it is: what a cold load is measured with.
#pragma once

#include <cstdint>
#include <string>

#include "format/result.h"

namespace scree::bench {

/// The share of the file's memory pages that the page cache has, 0 to 1, every page looked at (mincore). 0 for an empty
/// file. What the system hides (files of other users) counts as cached. Errors kFile, as MappedFile::open.
Result<double> cached_share(const std::string& path);

/// Writes what of the file is not on the disk yet, and asks for its pages to leave the page cache; says which share
/// is there still: 0 but where others map the file, or where memory is the file's only place (tmpfs). Nothing of this
/// process maps it. Errors kFile.
Result<double> drop_from_cache(const std::string& path);

/// Reads the file through the page cache; says which share is there then: less than 1 where memory is short. Errors
/// kFile.
Result<double> bring_to_cache(const std::string& path);

/// How raw reads go.
inline constexpr uint64_t kRawBlockBytes = uint64_t{4} << 20;
inline constexpr uint64_t kMostRawBytes = uint64_t{8} << 30;  // of a file, from its beginning

/// Bytes and seconds of reading a file past the page cache, its first kMostRawBytes, `in_flight` blocks at a time,
/// into memory that is thrown away.
struct RawRead {
  uint64_t bytes = 0;
  double seconds = 0;

  double gb_per_s() const { return seconds > 0 ? static_cast<double>(bytes) * 1e-9 / seconds : 0; }
};

/// `in_flight`: at least 1. Errors kUnsupported (the file system has no such reads), kFile, kMemory.
Result<RawRead> read_raw(const std::string& path, uint32_t in_flight);

}  // namespace scree::bench
