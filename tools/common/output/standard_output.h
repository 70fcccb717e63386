// Makes sure that a command's output was written.
#pragma once

#include <cstdio>

#include "format/result.h"

namespace scree::tools {

/// Flushes `out`, standard output or its replacement. Error kFile if that, or an earlier write, failed: a full disk
/// behind a redirection, a closed pipe.
inline Result<void> finish_output(std::FILE* out = stdout) {
  if (std::fflush(out) != 0 || std::ferror(out)) return Error{ErrorCode::kFile, "standard output: cannot write"};
  return {};
}

}  // namespace scree::tools
