// The GPU that is measured.
#pragma once

#include "format/result.h"
#include "tools/bench/case_result.h"

namespace scree::bench {

/// Names the GPU, its driver and this program's commit, and measures a device copy. Errors kDevice: no usable GPU (what
/// to do is said), a CUDA call that failed.
Result<Machine> find_machine();

}  // namespace scree::bench
