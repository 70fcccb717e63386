// Runs `scree-lab` with parsed options.
#pragma once

#include "format/result.h"
#include "lab/options.h"

namespace scree::lab {

/// Measures the cases of the options, prints tables on stdout and appends the rows to the CSV file. Errors kDevice
/// (built without CUDA, no usable GPU, a scene that does not fit), errors of the scene file and of the CSV file.
Result<void> run_bench(const LabOptions& options);

}  // namespace scree::lab
