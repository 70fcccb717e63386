// Lists the files that a conversion reads, and checks that its output may be written.
#pragma once

#include <cstdint>
#include <set>
#include <string>

#include "format/result.h"
#include "tools/gltf/source.h"

namespace scree::convert {

/// All files that a scene is read from: the input and the files it refers to.
std::set<std::string> source_files(const std::string& input, const SourceScene& scene);

/// Total bytes of the files. Errors kFile: a file has vanished, or its size cannot be read.
Result<uint64_t> total_bytes(const std::set<std::string>& files);

/// Fails early instead of at the end of a long run. Errors kFile: `output` is a folder, or no file can be created
/// there.
Result<void> check_output(const std::string& output);

/// Error kUsage if `output`, or a temporary file beside it, is one of `files`, which are read. `kind`: of these files,
/// for the message. `output`: from PartFile::target_of().
Result<void> check_not_read(const std::set<std::string>& files, const std::string& output, const char* kind);

}  // namespace scree::convert
