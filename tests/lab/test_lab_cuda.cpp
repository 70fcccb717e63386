// Scenes generated on the GPU equal the host's bytes, and their pictures equal the CPU's.
#include <algorithm>
#include <cstring>
#include <random>
#include <vector>

#include "lab/frames/frames.h"
#include "lab/scenes/generate.h"
#include "lab/scenes/resident_scene.h"
#include "lab/setup/machine.h"
#include "lab/setup/views.h"
#include "runtime/draw/device_list.h"
#include "tests/gpu.h"
#include "tests/lab/host_chunks.h"
#include "tests/results.h"
#include "tests/tools/render/random_view.h"

using namespace scree;
using namespace scree::lab;

namespace {

constexpr Encoding kEncodings[] = {{false, 16, true}, {true, 16, false}, {false, 24, true}, {false, 8, false}};
constexpr Encoding kClustered[] = {{false, 16, true, true}, {false, 24, true, true}, {false, 8, true, true}};

void check_bytes(const synth::Scene& scene, const Encoding& encoding) {
  INFO(scene.name << " " << encoding_name(encoding));
  const ResidentScene resident = must(ResidentScene::generate(scene, encoding));
  const std::vector<ChunkPlan> plans = plan_chunks(scene);
  const std::vector<ChunkBox> boxes = scree::tests::chunk_boxes(scene, plans);
  const std::vector<ChunkBox> on_device = must(chunk_boxes_cuda(scene, plans));
  for (size_t i = 0; i < boxes.size(); ++i) {
    CHECK(std::equal(boxes[i].lo, boxes[i].lo + 3, on_device[i].lo));
    CHECK(std::equal(boxes[i].hi, boxes[i].hi + 3, on_device[i].hi));
  }
  const SceneTables tables = must(make_tables(scene, plans, boxes, encoding));
  std::vector<std::byte> expected(tables.arena_bytes);
  scree::tests::fill_chunks(scene, plans, tables, expected);
  std::vector<std::byte> found;
  REQUIRE(resident.read_pages(found));
  REQUIRE(found.size() == expected.size());
  CHECK(std::memcmp(found.data(), expected.data(), found.size()) == 0);
}

/// Compares the picture of the device's chunks, drawn on the device, with the CPU's picture of their copy.
void check_picture(const synth::Scene& scene, const Encoding& encoding) {
  INFO(scene.name << " " << encoding_name(encoding));
  const ResidentScene resident = must(ResidentScene::generate(scene, encoding));
  Frames frames = must(Frames::create(resident));
  std::vector<std::byte> storage;
  const auto pages = must(resident.read_pages(storage));
  const kernels::SceneView host = resident.tables().view(pages.data());
  for (const synth::SceneCamera& camera : scene.cameras) {
    const kernels::View view = tests::kEmulatesGpu ? scene_view(camera, 161, 91) : scene_view(camera, 961, 541);
    std::vector<uint64_t> expected(size_t{view.width} * view.height);
    REQUIRE(kernels::draw_cpu(host, view, expected, 2));
    FrameMs ms;
    must(frames.draw(view, {}, ms));
    CHECK(ms.frame > 0);
    const std::vector<uint64_t> samples = must(frames.samples());
    CHECK(std::ranges::equal(samples, expected));
  }
}

struct Drawn {
  std::vector<uint64_t> samples;
  uint64_t clusters = 0;
};

Drawn draw(Frames& frames, const kernels::View& view, const Culling& culling) {
  const FrameOptions options{.culling = culling};
  FrameMs ms;
  const kernels::FrameStats stats = must(frames.draw(view, options, ms));
  return {must(frames.samples()), stats.clusters_drawn};
}

/// Each frame after a jump of the camera is followed by one with a still camera. Some are orthographic, and some have
/// another size. `used` and `fresh` differ in the state that earlier frames left. `sizes`: for `used`.
void check_culling(const synth::Scene& scene, int cameras, const kernels::CudaQueueSizes& sizes) {
  const ResidentScene resident = must(ResidentScene::generate(scene, kClustered[0]));
  Frames used = must(Frames::create(resident, sizes)), fresh = must(Frames::create(resident));
  std::mt19937 random(1);
  uint64_t clusters[3] = {};  // with all culling, by bounds only, without culling
  for (int i = 0; i < cameras; ++i) {
    const kernels::View view = tests::kEmulatesGpu ? tests::random_view(scene, random, i, {160, 90}, {61, 101})
                                                   : tests::random_view(scene, random, i, {640, 360}, {333, 517});
    INFO(scene.name << ", camera " << i);
    const Drawn all = draw(fresh, view, {false, false});
    const Drawn jumped = draw(used, view, {true, true}), still = draw(used, view, {true, true});
    const Drawn bounds = draw(fresh, view, {true, false});
    CHECK((jumped.samples == all.samples && still.samples == all.samples && bounds.samples == all.samples));
    clusters[0] += still.clusters;
    clusters[1] += bounds.clusters;
    clusters[2] += all.clusters;
  }
  INFO(scene.name);
  CHECK(clusters[0] < clusters[1]);
  CHECK(clusters[1] < clusters[2]);
}

}  // namespace

TEST_CASE("scenes generated on the GPU and on the host have the same bytes", "[cuda]") {
  if (!tests::has_gpu()) return;
  for (const Encoding& encoding : kEncodings) {
    for (const synth::MeshOrder order : {synth::MeshOrder::kRow, synth::MeshOrder::kBlock}) {
      if (tests::kEmulatesGpu && order == synth::MeshOrder::kBlock) break;
      check_bytes(synth::terrain_scene(order, 0.004), encoding);  // faces of several chunks
      check_bytes(synth::lantern_scene(order, 0.05), encoding);
      check_bytes(synth::zorahlike_scene(order, 1e-4), encoding);
    }
    check_bytes(synth::sponzalike_scene(1), encoding);
  }
}

TEST_CASE("generated scenes are drawn on the GPU as on the CPU", "[cuda]") {
  if (!tests::has_gpu()) return;
  for (const Encoding& encoding : kEncodings) {
    check_picture(synth::sponzalike_scene(tests::kEmulatesGpu ? 0.1 : 1), encoding);
    check_picture(synth::terrain_scene(synth::MeshOrder::kRow, 0.002), encoding);
    if (tests::kEmulatesGpu) continue;
    check_picture(synth::lantern_scene(synth::MeshOrder::kBlock, 0.01), encoding);
  }
  if (tests::kEmulatesGpu) return;
  for (const Encoding& encoding : kClustered) {
    check_picture(synth::sponzalike_scene(1), encoding);
    check_picture(synth::terrain_scene(synth::MeshOrder::kRow, 0.03), encoding);  // enough triangles for two passes
    check_picture(synth::lantern_scene(synth::MeshOrder::kBlock, 0.01), encoding);
    check_picture(synth::zorahlike_scene(synth::MeshOrder::kRow, 2e-4), encoding);
  }
}

TEST_CASE("lab: the measured GPU has a name and a rate of copies", "[cuda]") {
  if (!tests::has_gpu()) return;
  const runtime::Gpu gpu = must(runtime::use_gpu());
  const Machine machine = must(find_machine(gpu));
  CHECK(machine.device == gpu.name);
  CHECK(machine.copy_gb_per_s > 1);
}

TEST_CASE("culling of clusters changes no picture", "[cuda]") {
  if (!tests::has_gpu()) return;
  kernels::CudaQueueSizes rounds;  // holds everything
  rounds.two_pass_groups = 1;
  rounds.round_groups = 1;
  kernels::CudaQueueSizes tight = rounds;  // frames are drawn again until their queues are large enough
  tight.medium = tight.large = tight.tiles = tight.clusters = tight.to_clip = 1;
  kernels::CudaQueueSizes empty = tight;
  empty.medium = empty.large = empty.tiles = empty.clusters = empty.to_clip = 0;
  if (tests::kEmulatesGpu) {
    check_culling(synth::sponzalike_scene(0.1), 4, tight);
    check_culling(synth::lantern_scene(synth::MeshOrder::kBlock, 0.001), 2, empty);
    return;
  }
  check_culling(synth::sponzalike_scene(1), 200, rounds);
  check_culling(synth::sponzalike_scene(1), 10, tight);
  check_culling(synth::terrain_scene(synth::MeshOrder::kRow, 0.05), 200, {});
  check_culling(synth::terrain_scene(synth::MeshOrder::kRow, 0.01), 50, rounds);
  check_culling(synth::lantern_scene(synth::MeshOrder::kRow, 0.02), 200, rounds);
  check_culling(synth::lantern_scene(synth::MeshOrder::kBlock, 0.02), 20, empty);
  check_culling(synth::zorahlike_scene(synth::MeshOrder::kRow, 0.002), 200, rounds);
  check_culling(synth::zorahlike_scene(synth::MeshOrder::kRow, 0.002), 20, {});
}

// With one round, nothing is drawn when clusters are tested, so only clusters outside the view are culled. Every other
// culled cluster was hidden by clusters of an earlier round.
TEST_CASE("a first frame culls clusters that earlier clusters hide", "[cuda]") {
  if (!tests::has_gpu()) return;
  const double scale = tests::kEmulatesGpu ? 0.001 : 0.2;  // more clusters than are drawn at a time
  const synth::Scene scene = synth::lantern_scene(synth::MeshOrder::kRow, scale);
  const ResidentScene resident = must(ResidentScene::generate(scene, kClustered[0]));
  const kernels::CudaQueueSizes sizes{.two_pass_groups = 1, .round_groups = ~uint64_t{0}};
  std::mt19937 random(1);
  for (int i = 0; i < 2; ++i) {
    Frames frames = must(Frames::create(resident, sizes));
    const kernels::View view = tests::random_view(scene, random, i, {160, 90}, {61, 101});
    const Drawn bounds = draw(frames, view, {true, false}), first = draw(frames, view, {true, true});
    INFO("camera " << i << ": " << first.clusters << " of " << bounds.clusters);
    CHECK((first.samples == bounds.samples));
    CHECK(first.clusters > 0);
    CHECK(first.clusters < bounds.clusters);
  }
}
