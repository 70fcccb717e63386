// Alpha masks on the GPU: its visibility buffer equals the CPU's bit for bit, for every encoding, camera and stage,
// over a series of frames, with queues that are large enough and queues that have to grow.
#include <vector>

#include "tests/catch.h"
#include "tests/gpu.h"
#include "tests/kernels/cuda/device_copy.h"
#include "tests/kernels/raster/mask_cases.h"

using namespace scree;
using namespace scree::tests;
using kernels::View;

TEST_CASE("masked scenes are drawn alike on the GPU", "[cuda][mask]") {
  const bool is_clustered = GENERATE(false, true);
  SceneBuilder builder;
  add_masked_meshes(builder, is_clustered);
  const kernels::SceneView scene = builder.view();
  std::vector<View> views = masked_views();
  // A walk, because a frame reuses the visibility of the previous one. The emulator is slow, so its walk is short.
  for (int step = 0; step < (kEmulatesGpu ? 5 : 60); ++step) {
    const double turn = 0.11 * step;
    views.push_back(look_at({2 * std::cos(turn), 0.3 + 0.01 * step, 2 * std::sin(turn)}, {0, 0, 0}, 160, 120, 0.2));
  }
  std::vector<std::vector<uint64_t>> expected;
  for (const View& view : views) expected.push_back(draw(scene, view, 2));
  if (!has_gpu()) return;
  const DeviceCopy device(scene, builder.pages);
  kernels::CudaQueueSizes two_passes;
  two_passes.two_pass_groups = two_passes.round_groups = 1;
  kernels::CudaQueueSizes by_warps;
  by_warps.few_groups = 0;
  kernels::CudaQueueSizes no_room{1, 1, 1, 1, 1, 1, 1, 1};
  CHECK((device.draw_in_turn(views) == expected));
  CHECK((device.draw_in_turn(views, by_warps) == expected));
  CHECK((device.draw_in_turn(views, two_passes) == expected));
  CHECK((device.draw_in_turn(views, no_room) == expected));
  kernels::DrawOptions by_kernel;
  by_kernel.stage_times = true;
  by_kernel.sampleless_test = false;
  CHECK((device.draw_in_turn(views, {}, by_kernel) == expected));
}
