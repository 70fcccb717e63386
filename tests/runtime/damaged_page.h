// Split pages with a wrong byte and a right checksum, so that only the checks of their contents can find it.
#pragma once

#include <zstd.h>

#include <algorithm>
#include <cstddef>
#include <random>
#include <vector>

#include "format/container/checksum.h"
#include "format/container/container.h"
#include "tests/catch.h"

namespace scree::tests {

/// Changes a byte of a split page before it is written: one of the first 2,000 behind its head.
inline void damage_split_page(format::SealedPage& page, std::mt19937& random) {
  std::vector<std::byte> split(ZSTD_getFrameContentSize(page.stored.data(), page.stored.size()));
  REQUIRE(ZSTD_decompress(split.data(), split.size(), page.stored.data(), page.stored.size()) == split.size());
  split[60 + random() % std::min<size_t>(split.size() - 60, 2000)] ^= static_cast<std::byte>(1 + random() % 255);
  page.stored.resize(ZSTD_compressBound(split.size()));
  page.stored.resize(ZSTD_compress(page.stored.data(), page.stored.size(), split.data(), split.size(), 1));
  page.record.stored_bytes = page.stored.size();
  page.record.checksum = format::checksum(page.stored);
}

}  // namespace scree::tests
