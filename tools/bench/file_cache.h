// How much of a file lies in the page cache: what a cold load is measured with.
#pragma once

#include <string>

#include "format/result.h"

namespace scree::bench {

/// The share of the file's memory pages that the page cache has, 0 to 1; every page is tested (mincore). 0 for an empty
/// file. Errors kFile, as MappedFile::open; kUnsupported: the system hides it (files of other users).
Result<double> cached_share(const std::string& path);

/// Writes to the disk what is not there yet of the file, and drops its pages from the page cache; returns the share
/// that is there still: 0 but where others map the file, or where memory is the file's only place (tmpfs). Nothing of
/// this process maps it. Errors as cached_share.
Result<double> drop_from_cache(const std::string& path);

/// Reads the file through the page cache; returns the share that is there then: less than 1 where memory is short.
/// Errors as cached_share.
Result<double> bring_to_cache(const std::string& path);

}  // namespace scree::bench
