// The text of `scree --version`.
#pragma once

#include <string>

namespace scree::tools {

/// Version, commit, compiler, CUDA toolkit and the GPU architectures in the program, one line each.
std::string version_text();

}  // namespace scree::tools
