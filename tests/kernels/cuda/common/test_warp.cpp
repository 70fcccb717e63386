// The code for older GPUs (kernels/cuda/common/warp.cuh), on any GPU of compute capability 8.0 and newer, or an
// emulated one. The build option SCREE_CUDA_PATH makes whole frames use it.
#include "tests/catch.h"
#include "tests/gpu.h"
#include "tests/kernels/cuda/common/warp_cases.h"

TEST_CASE("a warp's reduction by one instruction equals the one by shuffles", "[cuda]") {
  if (!scree::tests::has_gpu()) return;
  CHECK(scree::tests::check_lane_sums() == "");
}

TEST_CASE("a warp stages the same pieces with cp.async and through registers", "[cuda]") {
  if (!scree::tests::has_gpu()) return;
  CHECK(scree::tests::check_stage_copies() == "");
}
