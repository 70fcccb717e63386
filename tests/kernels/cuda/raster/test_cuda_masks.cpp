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

namespace {

/// Every second square of a grid, as on a chess board.
Soup chess_board(uint32_t n) {
  const Soup whole = grid(n, 0);
  Soup soup = whole;
  soup.indices.clear();
  for (uint32_t square = 0; square < n * n; ++square) {
    if ((square / n + square % n) % 2 != 0) continue;
    for (uint32_t i = 0; i < 6; ++i) soup.indices.push_back(whole.indices[6 * square + i]);
  }
  return soup;
}

}  // namespace

// A board is in front of a mesh of small triangles, and every cluster of the mesh shows between its squares. The first
// frame omits the mesh, so the second frame draws the board in its first pass, and the mesh in its second one.
TEST_CASE("hidden triangles are dropped on the GPU if they are masked", "[cuda][mask]") {
  if (!has_gpu()) return;
  const View view = look_at({0, 3, 0}, {0, 0, 0}, 100, 100);
  const std::vector<uint32_t> without_mesh{2};
  const DeviceBits omitted(without_mesh);
  std::vector<uint64_t> pictures[2];
  uint64_t small[2];
  for (const bool is_masked : {false, true}) {
    SceneBuilder builder;
    const Encoding clustered{.clusters = Clusters::kClustered};
    const kernels::MaskView opaque = mask_view(16, 16, 1, 128 * 65536);
    const uint32_t material = builder.masked_material(0, opaque, std::vector<uint8_t>(16 * 16, 255));
    builder.instance(builder.mesh(chess_board(24), clustered), builder.matrix({1, 0, 0, 0, 0, 1, 0, 0.2, 0, 0, 1, 0}));
    builder.instance(builder.mesh(with_uvs(grid(96, 0), 1), is_masked ? with(clustered, material) : clustered),
                     builder.identity());
    const kernels::SceneView scene = builder.view();
    const DeviceCopy device(scene, builder.pages);
    kernels::CudaFrames frames = must(kernels::CudaFrames::create(scene, device.view(), in_two_passes()));
    for (const uint32_t* bits : {omitted.data(), static_cast<const uint32_t*>(nullptr)}) {
      View seen = view;
      seen.omitted = bits;
      pictures[is_masked] = device.picture(
          seen, [&](uint64_t* samples) { small[is_masked] = must(frames.draw(seen, samples, {})).triangles_small; });
    }
    CHECK((pictures[is_masked] == draw(scene, view, 2)));
  }
  CHECK((pictures[0] == pictures[1]));
  CAPTURE(small[0], small[1]);
  CHECK(small[1] < small[0] - small[0] / 4);
}
