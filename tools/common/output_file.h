// The names of files that a command is to write, checked before its work begins.
#pragma once

#include <string>

#include "format/container/part_file.h"
#include "format/result.h"

namespace scree::tools {

/// Whether `path` may be written; an empty one is no output, and fine. Errors kUsage: it is "-", as standard output is
/// not written to; kFile: with Existing::kRefuse, a file has that name, and --force would replace it.
Result<void> check_output_file(const std::string& path, format::Existing existing);

/// What --force, or its absence, asks for.
inline format::Existing existing_of(bool force) {
  return force ? format::Existing::kReplace : format::Existing::kRefuse;
}

inline constexpr const char* kForceHelp = "Replace a file that has an output's name; without it that is an error";

}  // namespace scree::tools
