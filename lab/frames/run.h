// What `scree-lab` does once its options are known.
#pragma once

#include "format/result.h"
#include "lab/options.h"

namespace scree::lab {

/// Measures what the options name, prints tables on stdout and appends the rows to the CSV file. Errors kDevice: built
/// without CUDA, no usable GPU, a scene that does not fit; those of the file and of the CSV file.
Result<void> run_bench(const LabOptions& options);

}  // namespace scree::lab
