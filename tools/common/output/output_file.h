// Checks the names of a command's output files before its work begins.
#pragma once

#include <string>

#include "format/container/part_file.h"
#include "format/result.h"

namespace scree::tools {

/// Checks whether `path` may be written. An empty path means no output and is accepted. Errors kUsage: it is "-", but
/// standard output is not supported; kFile: a folder or a device has that name, or, with Existing::kRefuse, any file.
Result<void> check_output_file(const std::string& path, format::Existing existing);

/// Error kUsage if an output of `command`, which writes a .scree file, has the extension of a glTF.
Result<void> check_no_gltf(const std::string& path, const char* command);

/// The meaning of the flag --force.
inline format::Existing existing_of(bool force) {
  return force ? format::Existing::kReplace : format::Existing::kRefuse;
}

inline constexpr const char* kForceHelp = "Replace existing output files (without this, an existing file is an error)";

}  // namespace scree::tools
