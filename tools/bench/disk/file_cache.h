// What of a file lies in the page cache: what a cold load is measured with.
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

}  // namespace scree::bench
