// Describes the GPU on which the measured frames are drawn.
#pragma once

#include "format/result.h"
#include "lab/report/case_result.h"
#include "runtime/draw/device_list.h"

namespace scree::lab {

/// Describes `gpu`, the current device, its driver and this program's commit, and measures a device copy. Errors
/// kDevice: a failed CUDA call, a program built without CUDA.
Result<Machine> find_machine(const runtime::Gpu& gpu);

}  // namespace scree::lab
