// Geometry pages on disk: clusters as what they were packed from, in streams of like bytes. Packed bits show zstd
// nothing; these do. Source: spec/codecs.md, split pages.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "format/result.h"

namespace scree::format {

/// The clusters of a chunk in a page: where its payload begins in the page's raw bytes, and how many it has.
struct PageClusters {
  uint64_t offset;
  uint32_t cluster_count;
};

/// A split page takes at most this times the bytes of the page.
inline constexpr uint64_t kMaxSplitRatio = 2;

/// A page as zstd gets it.
struct SplitPage {
  std::vector<std::byte> bytes;       // empty where the page cannot be split
  std::vector<uint64_t> stream_ends;  // in `bytes`, of streams whose bytes are of one kind
};

/// Splits a page of valid chunks; `clusters` are in the order in which they lie. The page cannot be split where
/// join_page() would not give back every byte (another writer's clusters need not be the tightest), where the streams
/// take more than kMaxSplitRatio times its bytes, where it has 2 GiB or more, and where memory is short.
SplitPage split_page(std::span<const std::byte> page, std::span<const PageClusters> clusters);

/// Puts a split page together: writes all of `page`. Safe on any bytes, but checks only what it needs: what comes out
/// is to be checked as any page. Takes 1.1 MiB of memory a thread, whatever the page. Errors kTruncated, kTrailing,
/// kRange, kReserved, kMemory, after which the page is unspecified; reentrant.
Result<void> join_page(std::span<const std::byte> split, std::span<std::byte> page);

}  // namespace scree::format
