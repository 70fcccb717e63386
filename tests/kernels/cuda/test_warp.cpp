// The code for older GPUs (kernels/cuda/warp.cuh), on any GPU of compute capability 8.0 and newer, or an emulated one.
// The build option SCREE_CUDA_PATH makes whole frames use it.
#include "tests/catch.h"
#include "tests/gpu.h"
#include "tests/kernels/cuda/warp_cases.h"

TEST_CASE("a warp joins its lanes' values by one instruction as by shuffles", "[cuda]") {
  if (!scree::tests::has_gpu()) return;
  CHECK(scree::tests::check_lane_sums() == "");
}

TEST_CASE("a warp stages runs of pieces past its registers as through them", "[cuda]") {
  if (!scree::tests::has_gpu()) return;
  CHECK(scree::tests::check_stage_copies() == "");
}
