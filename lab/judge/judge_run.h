// Runs `scree-lab --reference` and --curves with parsed options.
#pragma once

#include "format/result.h"
#include "lab/options.h"

namespace scree::lab {

/// Packs every scene and model in every encoding, draws it (on a usable GPU, else the CPU), and compares the pictures
/// with the reference. With options.curves it also measures the errors of depth codes, snapping and numbers of samples.
/// Prints tables on stdout and appends the rows to the CSV file. Temporary files lie in $TMPDIR (else /tmp), one scene
/// and one packed file at a time. Returns errors of the sources, the device and the CSV file.
Result<void> judge_scenes(const LabOptions& options);

}  // namespace scree::lab
