// The clipping box on the GPU: its visibility buffer equals the CPU's bit for bit, for every encoding, camera and
// stage, in alternating frames with and without a box, with queues that are large enough and queues that have to grow.
#include <vector>

#include "tests/gpu.h"
#include "tests/kernels/cuda/device_copy.h"
#include "tests/kernels/raster/clip_cases.h"
#include "tests/kernels/raster/mask_cases.h"

using namespace scree;
using namespace scree::tests;
using kernels::View;

namespace {

/// Adds spheres, fields and large triangles, none of them masked.
void add_opaque_meshes(SceneBuilder& builder, bool clustered_alone) {
  const auto [clustered, second, third] = encodings_of_scene(clustered_alone);
  const uint32_t both_sides = builder.material(format::kMaterialDoubleSided);
  const uint32_t meshes[] = {builder.mesh(sphere(14, 0.1), clustered), builder.mesh(grid(31, 0.3), second),
                             builder.mesh(grid(1, 0), with(third, both_sides)),
                             builder.mesh(grid(3, 0.2), with(clustered, both_sides)),
                             builder.mesh(sphere(6, 0), with(third, both_sides))};
  place_all(builder, meshes, {1, 0, 0, 0.2, 0, 1, 0, -0.7, 0, 0, 1, 0.3});
}

}  // namespace

TEST_CASE("clipping boxes cut on the GPU as on the CPU", "[cuda][clip]") {
  const bool is_masked = GENERATE(false, true), is_clustered = GENERATE(false, true);
  if (kEmulatesGpu && is_masked == is_clustered) return;  // the emulator is slow
  SceneBuilder builder;
  if (is_masked) {
    add_masked_meshes(builder, is_clustered);
  } else {
    add_opaque_meshes(builder, is_clustered);
  }
  const kernels::SceneView scene = builder.view();
  std::vector<View> whole = masked_views(kEmulatesGpu ? 5 : 1);
  for (const View& view : walk(kEmulatesGpu ? 2 : 60, 0.11, 160, 120)) whole.push_back(view);
  std::vector<View> views = clipped_views(whole);
  // A camera that stands still while a face of the box moves, and the box is switched off and on.
  for (int step = 0; step < (kEmulatesGpu ? 3 : 20); ++step) {
    views.push_back(clipping(whole[0], {{-9, -9, -9}, {9, 0.6 - 0.05 * step, 9}}));
    if (step % 2 == 1) views.push_back(whole[0]);
  }
  if (!has_gpu()) return;
  std::vector<std::vector<uint64_t>> expected;
  for (const View& view : views) expected.push_back(draw(scene, view, 2));
  const DeviceCopy device(scene, builder.pages);
  check_drawn_alike(device, views, expected);
}

TEST_CASE("triangles outside a clipping box are culled on the GPU", "[cuda][clip]") {
  SceneBuilder builder;
  const Encoding clustered{.clusters = Clusters::kClustered};
  const bool has_others = GENERATE(false, true);
  const uint32_t mesh = builder.mesh(sphere(40, 0.05), clustered);
  const uint32_t other = has_others ? builder.mesh(grid(30, 0.1), {}) : mesh;
  for (int i = 0; i < 4; ++i) builder.instance(mesh, builder.matrix({1, 0, 0, 3.0 * i, 0, 1, 0, 0, 0, 0, 1, 0}));
  for (int i = 0; i < 4; ++i) builder.instance(other, builder.matrix({1, 0, 0, 3.0 * i, 0, 1, 0, -3, 0, 0, 1, 0}));
  const kernels::SceneView scene = builder.view();
  if (!has_gpu()) return;
  const DeviceCopy device(scene, builder.pages);
  for (const bool is_orthographic : {false, true}) {
    View whole = look_at({4.5, 8, 20}, {4.5, 0, 0}, 160, 100, 0.1);
    if (is_orthographic) whole = orthographic(whole, 6, 0.1, 60);
    for (const kernels::CudaQueueSizes& sizes : {kernels::CudaQueueSizes(), in_two_passes()}) {
      const auto stats = [&](const View& view) { return device.stats(view, sizes, {}); };
      const kernels::FrameStats all = stats(whole);
      CHECK(all.instances_drawn == 8);
      CHECK(stats(clipping(whole, {{1.9, -1.1, -1.1}, {4.1, 1.1, 1.1}})).instances_drawn == 1);
      const kernels::FrameStats slab = stats(clipping(whole, {{-9, 0.2, -9}, {99, 0.25, 9}}));
      CHECK(slab.instances_drawn == 4);
      CHECK(slab.clusters_drawn > 0);
      CHECK(slab.clusters_drawn < all.clusters_drawn / 2);
      CHECK(stats(clipping(whole, {{-9, 50, -9}, {99, 51, 9}})).instances_drawn == 0);
    }
  }
}
