// What `scree-lab --reference` and --curves do once their options are known.
#pragma once

#include "format/result.h"
#include "lab/options.h"

namespace scree::lab {

/// Packs every scene and model in every encoding, draws it where it can (a usable GPU, else the CPU), and judges the
/// pictures by the reference; with options.curves also what depth codes, snapping and numbers of samples cost. Prints
/// tables on stdout and appends the rows to the CSV file. What is written on the way lies in $TMPDIR (else /tmp), one
/// scene and one file of it at a time. Errors: those of the sources, the device, the CSV file.
Result<void> judge_scenes(const LabOptions& options);

}  // namespace scree::lab
