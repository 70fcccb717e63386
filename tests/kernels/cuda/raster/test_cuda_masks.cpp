// Alpha masks on the GPU: its visibility buffer equals the CPU's bit for bit, for every encoding, camera and stage,
// over a series of frames, with queues that are large enough and queues that have to grow.
#include <vector>

#include "tests/gpu.h"
#include "tests/kernels/cuda/device_copy.h"
#include "tests/kernels/raster/mask_cases.h"

using namespace scree;
using namespace scree::tests;
using kernels::View;

TEST_CASE("masked scenes are equal on the GPU", "[cuda][mask]") {
  const bool is_clustered = GENERATE(false, true);
  SceneBuilder builder;
  add_masked_meshes(builder, is_clustered);
  const kernels::SceneView scene = builder.view();
  // The emulator is slow.
  std::vector<View> views = masked_views(kEmulatesGpu ? 2 : 1);
  for (const View& view : walk(kEmulatesGpu ? 3 : 60, 0.11, 160, 120)) views.push_back(view);
  if (!has_gpu()) return;
  std::vector<std::vector<uint64_t>> expected;
  for (const View& view : views) expected.push_back(draw(scene, view, 2));
  const DeviceCopy device(scene, builder.pages);
  check_drawn_alike(device, views, expected);
}
