// The GPU that draws the frames that are measured.
#pragma once

#include "format/result.h"
#include "lab/report/case_result.h"
#include "runtime/draw/device_list.h"

namespace scree::lab {

/// Names `gpu`, the current device, its driver and this program's commit, and measures a device copy. Errors kDevice: a
/// CUDA call that failed, a program built without CUDA.
Result<Machine> find_machine(const runtime::Gpu& gpu);

}  // namespace scree::lab
