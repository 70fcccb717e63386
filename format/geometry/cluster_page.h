// The form of geometry pages on disk: the values of clusters before packing, in streams of similar bytes. zstd
// compresses these streams, but not packed bits. Source: spec/codecs.md, split pages.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "format/result.h"

namespace scree::format {

/// The clusters of a chunk in a page: offset of the chunk's payload in the page's raw bytes, and the number of
/// clusters.
struct PageClusters {
  uint64_t offset;
  uint32_t cluster_count;
};

/// Most bytes of a split page per byte of the page.
inline constexpr uint64_t kMaxSplitRatio = 2;

/// A page before it is compressed with zstd.
struct SplitPage {
  std::vector<std::byte> bytes;       // empty where the page cannot be split
  std::vector<uint64_t> stream_ends;  // offsets in `bytes` where each stream ends; a stream has bytes of one kind
};

/// Splits a page of valid chunks; `clusters` are in file order. The page cannot be split in these cases:
/// - join_page() would not restore every byte, since another writer's clusters need not be the tightest;
/// - the streams take more than kMaxSplitRatio times its bytes;
/// - it has 2 GiB or more;
/// - memory is short.
SplitPage split_page(std::span<const std::byte> page, std::span<const PageClusters> clusters);

/// Joins a split page: writes all of `page`. Safe on any bytes. The result has to be checked like any page, since only
/// the streams are checked here. Takes 2.1 MiB of memory per thread for any page. Errors kTruncated, kTrailing, kRange,
/// kReserved, kMemory, after which the page is unspecified. Reentrant.
Result<void> join_page(std::span<const std::byte> split, std::span<std::byte> page);

}  // namespace scree::format
