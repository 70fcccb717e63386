// Who draws: the words of --backend and what they come to on this machine.
#pragma once

#include <string>

#include "format/result.h"

namespace scree::tools {

enum class BackendChoice { kAuto, kCpu, kCuda };

/// "auto", "cpu" or "cuda". Errors kUsage.
Result<BackendChoice> parse_backend(const std::string& word);

/// Whether a GPU is to draw; kAuto takes one that is there. Errors, of kCuda alone, as runtime::find_device().
Result<bool> wants_gpu(BackendChoice backend);

}  // namespace scree::tools
