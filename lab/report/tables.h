// Measured cases as tables on a console.
#pragma once

#include <span>
#include <string>

#include "lab/report/case_result.h"

namespace scree::lab {

/// Milliseconds per stage, and speed.
std::string times_table(std::span<const CaseResult> cases);
/// Sizes, culled and drawn triangles, and the bytes read relative to the machine's copy rate.
std::string counts_table(std::span<const CaseResult> cases, const Machine& machine);
/// Mean and worst frame of camera paths.
std::string path_table(std::span<const CaseResult> cases);
/// Speed, size and error side by side.
std::string sweep_table(std::span<const CaseResult> cases);

/// The peers among the cases beside scree's float32 frames of the same views.
std::string peer_table(std::span<const CaseResult> cases);

}  // namespace scree::lab
