// Controls how much of a file is in the page cache, to measure cold loads.
#pragma once

#include <string>

#include "format/result.h"

namespace scree::bench {

/// The share of the file's memory pages in the page cache, 0 to 1; every page is tested (mincore). 0 for an empty file.
/// Errors kFile, as MappedFile::open; kUnsupported: the system does not report it (files of other users).
Result<double> cached_share(const std::string& path);

/// Writes unwritten pages of the file to the disk and drops its pages from the page cache. Returns the share that
/// remains: 0 unless others map the file, or memory is its only storage (tmpfs). This process must not map it. Errors
/// as cached_share.
Result<double> drop_from_cache(const std::string& path);

/// Reads the file through the page cache. Returns the share that is then cached: less than 1 if memory is short. Errors
/// as cached_share.
Result<double> bring_to_cache(const std::string& path);

}  // namespace scree::bench
