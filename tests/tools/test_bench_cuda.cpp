// Scenes made on the GPU: the host's bytes, and the CPU's picture of them.
#include <algorithm>
#include <cstring>
#include <random>
#include <vector>

#include "runtime/device_scene.h"
#include "tests/catch.h"
#include "tools/bench/frames.h"
#include "tools/bench/generate.h"
#include "tools/bench/resident_scene.h"
#include "tools/bench/views.h"

using namespace scree;
using namespace scree::bench;

namespace {

bool has_device() {
  if (const Result<void> device = runtime::find_device(); !device) {
    CHECK(device.error().code == ErrorCode::kDevice);
    WARN("skipped: " << device.error().message);
    return false;
  }
  return true;
}

constexpr Encoding kEncodings[] = {{false, 16, true}, {true, 16, false}, {false, 24, true}, {false, 8, false}};
constexpr Encoding kClustered[] = {{false, 16, true, true}, {false, 24, true, true}, {false, 8, true, true}};

void check_bytes(const synth::Scene& scene, const Encoding& encoding) {
  INFO(scene.name << " " << encoding_name(encoding));
  const Result<ResidentScene> resident = ResidentScene::generate(scene, encoding);
  REQUIRE(resident);
  const std::vector<ChunkPlan> plans = plan_chunks(scene);
  const std::vector<ChunkBox> boxes = chunk_boxes(scene, plans);
  const Result<std::vector<ChunkBox>> on_device = chunk_boxes_cuda(scene, plans);
  REQUIRE(on_device);
  for (size_t i = 0; i < boxes.size(); ++i) {
    CHECK(std::equal(boxes[i].lo, boxes[i].lo + 3, (*on_device)[i].lo));
    CHECK(std::equal(boxes[i].hi, boxes[i].hi + 3, (*on_device)[i].hi));
  }
  const Result<SceneTables> tables = make_tables(scene, plans, boxes, encoding);
  REQUIRE(tables);
  std::vector<std::byte> expected(tables->arena_bytes);
  fill_chunks(scene, plans, *tables, expected);
  std::vector<std::byte> found;
  REQUIRE(resident->read_pages(found));
  REQUIRE(found.size() == expected.size());
  CHECK(std::memcmp(found.data(), expected.data(), found.size()) == 0);
}

/// The picture of the chunks that lie on the device, drawn there and, copied back, here.
void check_picture(const synth::Scene& scene, const Encoding& encoding) {
  INFO(scene.name << " " << encoding_name(encoding));
  const Result<ResidentScene> resident = ResidentScene::generate(scene, encoding);
  REQUIRE(resident);
  Result<Frames> frames = Frames::create(*resident);
  REQUIRE(frames);
  std::vector<std::byte> storage;
  const auto pages = resident->read_pages(storage);
  REQUIRE(pages);
  const kernels::SceneView host = resident->tables().view(pages->data());
  for (const synth::SceneCamera& camera : scene.cameras) {
    const kernels::View view = scene_view(camera, 961, 541);
    std::vector<uint64_t> expected(size_t{961} * 541);
    REQUIRE(kernels::draw_cpu(host, view, expected, 2));
    FrameMs ms;
    const Result<kernels::FrameStats> stats = frames->draw(view, {}, ms);
    REQUIRE(stats);
    CHECK(ms.frame > 0);
    const Result<std::vector<uint64_t>> samples = frames->samples();
    REQUIRE(samples);
    CHECK(std::equal(samples->begin(), samples->end(), expected.begin(), expected.end()));
  }
}

std::vector<uint64_t> draw(Frames& frames, const kernels::View& view, const Culling& culling) {
  FrameOptions options;
  options.culling = culling;
  FrameMs ms;
  REQUIRE(frames.draw(view, options, ms));
  Result<std::vector<uint64_t>> samples = frames.samples();
  REQUIRE(samples);
  return std::move(*samples);
}

/// Every frame is a jump of the camera, then one where it stands still. What the frames before left behind differs
/// between `used` and `fresh`.
void check_culling(const synth::Scene& scene, int cameras) {
  INFO(scene.name);
  const Result<ResidentScene> resident = ResidentScene::generate(scene, kClustered[0]);
  REQUIRE(resident);
  Result<Frames> used = Frames::create(*resident);
  Result<Frames> fresh = Frames::create(*resident);
  REQUIRE(used);
  REQUIRE(fresh);
  std::mt19937 random(1);
  std::uniform_real_distribution<double> share(0, 1);
  int wrong = 0;
  for (int i = 0; i < cameras; ++i) {
    synth::SceneCamera camera = scene.cameras[0];
    const synth::SceneCamera& other = scene.cameras.back();
    const double t = share(random);
    for (size_t axis = 0; axis < 3; ++axis) {
      camera.eye[axis] += t * (other.eye[axis] - camera.eye[axis]);
      camera.target[axis] += share(random) * (other.target[axis] - camera.target[axis]) +
                             (share(random) - 0.5) * (camera.eye[axis] - camera.target[axis]);
    }
    const kernels::View view = scene_view(camera, 640, 360);
    const std::vector<uint64_t> expected = draw(*fresh, view, {false, false});
    wrong += draw(*used, view, {true, true}) != expected;  // after a jump
    wrong += draw(*used, view, {true, true}) != expected;  // standing still
    wrong += draw(*fresh, view, {true, false}) != expected;
  }
  CHECK(wrong == 0);
}

}  // namespace

TEST_CASE("scenes generated on the GPU have the host's bytes", "[cuda]") {
  if (!has_device()) return;
  for (const Encoding& encoding : kEncodings) {
    for (const synth::MeshOrder order : {synth::MeshOrder::kRow, synth::MeshOrder::kBlock}) {
      check_bytes(synth::terrain_scene(order, 0.004), encoding);  // faces of several chunks
      check_bytes(synth::lantern_scene(order, 0.05), encoding);
      check_bytes(synth::zorahlike_scene(order, 1e-4), encoding);
    }
    check_bytes(synth::sponzalike_scene(1), encoding);
  }
}

TEST_CASE("generated scenes are drawn on the GPU as on the CPU", "[cuda]") {
  if (!has_device()) return;
  for (const Encoding& encoding : kEncodings) {
    check_picture(synth::sponzalike_scene(1), encoding);
    check_picture(synth::terrain_scene(synth::MeshOrder::kRow, 0.002), encoding);
    check_picture(synth::lantern_scene(synth::MeshOrder::kBlock, 0.01), encoding);
  }
  for (const Encoding& encoding : kClustered) {
    check_picture(synth::sponzalike_scene(1), encoding);
    check_picture(synth::terrain_scene(synth::MeshOrder::kRow, 0.03), encoding);  // enough for two passes
    check_picture(synth::lantern_scene(synth::MeshOrder::kBlock, 0.01), encoding);
    check_picture(synth::zorahlike_scene(synth::MeshOrder::kRow, 2e-4), encoding);
  }
}

TEST_CASE("culling of clusters changes no picture", "[cuda]") {
  if (!has_device()) return;
  check_culling(synth::sponzalike_scene(1), 50);
  check_culling(synth::terrain_scene(synth::MeshOrder::kRow, 0.05), 50);
  check_culling(synth::lantern_scene(synth::MeshOrder::kRow, 0.02), 200);
  check_culling(synth::zorahlike_scene(synth::MeshOrder::kRow, 0.002), 200);
}
