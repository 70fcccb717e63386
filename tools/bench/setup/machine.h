// What draws the frames that are measured.
#pragma once

#include "format/result.h"
#include "runtime/draw/device_list.h"
#include "tools/bench/report/case_result.h"

namespace scree::bench {

/// Names `gpu`, the current device, its driver and this program's commit, and measures a device copy. Errors kDevice: a
/// CUDA call that failed, a program built without CUDA.
Result<Machine> find_machine(const runtime::Gpu& gpu);

/// Bytes a second that copies from pinned host memory to the GPU's reach, in GB: 1e9 a second. Errors kDevice, as
/// above.
Result<double> measure_link();

/// The processor by its model's name, in place of a GPU's, and this program's commit; no driver, no copy.
Machine cpu_machine();

}  // namespace scree::bench
