// Test kernels for kernels/cuda/common/warp.cuh.
#pragma once

#include <string>

namespace scree::tests {

/// Joins lanes' values by one instruction and by shuffles. Returns the errors; empty if both are right.
std::string check_lane_sums();

/// Stages runs of pieces with cp.async and through registers. Returns the errors; empty if both are right.
std::string check_stage_copies();

}  // namespace scree::tests
