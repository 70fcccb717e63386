// What a command prints has gone out, or it says that it has not.
#pragma once

#include <cstdio>

#include "format/result.h"

namespace scree::tools {

/// Writes what is buffered for `out`, standard output or what stands for it. Error kFile where that, or anything
/// printed before it, did not go out: a full disk behind a redirection, a closed pipe.
inline Result<void> finish_output(std::FILE* out = stdout) {
  if (std::fflush(out) != 0 || std::ferror(out)) return Error{ErrorCode::kFile, "standard output: cannot write"};
  return {};
}

}  // namespace scree::tools
