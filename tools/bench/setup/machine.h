// What draws the frames that are measured.
#pragma once

#include "format/result.h"
#include "tools/bench/report/case_result.h"

namespace scree::bench {

/// Names the GPU, its driver and this program's commit, and measures a device copy. Errors kDevice: no usable GPU (what
/// to do is said), a CUDA call that failed, a program built without CUDA.
Result<Machine> find_machine();

/// Bytes a second that copies from pinned host memory to the GPU's reach, in GB: 1e9 a second. Errors kDevice, as
/// above.
Result<double> measure_link();

/// The processor by its model's name, in place of a GPU's, and this program's commit; no driver, no copy.
Machine cpu_machine();

}  // namespace scree::bench
