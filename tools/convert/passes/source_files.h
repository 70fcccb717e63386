// Which files a conversion reads, and whether it may write where it is to.
#pragma once

#include <cstdint>
#include <set>
#include <string>

#include "format/result.h"
#include "tools/gltf/source.h"

namespace scree::convert {

/// All files that a scene is read from: the input and what it names.
std::set<std::string> source_files(const std::string& input, const SourceScene& scene);

/// Bytes of all of them. Errors kFile: one is not there any more, or does not say.
Result<uint64_t> total_bytes(const std::set<std::string>& files);

/// Fails early where the end of a long run would. Errors kFile: `output` is a folder, or lies where nothing can be
/// made.
Result<void> check_output(const std::string& output);

/// Error kUsage where `output`, or what is written beside it on the way, is one of `files`.
Result<void> check_not_source(const std::set<std::string>& files, const std::string& output);

}  // namespace scree::convert
