// The peers of scree-lab: the explanation of differences between two pictures, and, with a driver, pictures drawn by
// Vulkan compared with the CPU's.
#include <algorithm>
#include <vector>

#include "lab/peer/coverage.h"
#include "lab/peer/peer_case.h"
#include "lab/scenes/scene_tables.h"
#include "lab/setup/views.h"
#include "tests/lab/host_chunks.h"
#include "tests/lab/refused.h"
#include "tests/results.h"

using namespace scree;
using namespace scree::lab;
using tests::refused;

namespace {

// The address sanitizer's leak check would find leaks of the drivers (Mesa 22.3.6 leaks when a GPU is opened and
// closed).
#if defined(__SANITIZE_ADDRESS__)
constexpr bool kFindsLeaks = true;
#else
constexpr bool kFindsLeaks = false;
#endif

/// scree's picture of the scene's float32 vertices, drawn by the CPU.
std::vector<uint64_t> draw_on_cpu(const synth::Scene& scene, const kernels::View& view) {
  const std::vector<ChunkPlan> plans = plan_chunks(scene);
  const SceneTables tables = must(
      make_tables(scene, plans, scree::tests::chunk_boxes(scene, plans), {.float32 = true, .packed_indices = false}));
  struct alignas(16) Block {
    std::byte bytes[16];
  };
  std::vector<Block> arena((tables.arena_bytes + 15) / 16);
  scree::tests::fill_chunks(scene, plans, tables, {arena.data()->bytes, arena.size() * 16});
  const auto pages = tables.page_pointers(arena.data()->bytes);
  std::vector<uint64_t> samples(size_t{view.width} * view.height);
  REQUIRE(kernels::draw_cpu(tables.view(pages.data()), view, samples, 2));
  return samples;
}

std::vector<uint64_t> ids_of(const std::vector<uint64_t>& samples) {
  std::vector<uint64_t> ids(samples.size());
  std::transform(samples.begin(), samples.end(), ids.begin(), kernels::sample_id);
  return ids;
}

uint64_t count_covered(const std::vector<uint64_t>& ids) {
  return ids.size() - static_cast<uint64_t>(std::count(ids.begin(), ids.end(), kernels::kIdMask));
}

/// Measures the peer with all cameras. `edge_share`: the largest share of samples that may differ from the CPU's
/// picture.
void check_pictures(Peer& peer, const synth::Scene& scene, double edge_share) {
  REQUIRE(peer.load(scene, 2));
  for (const synth::SceneCamera& camera : scene.cameras) {
    ScreePicture picture{scene_view(camera, 321, 181), {}, {}};
    picture.samples = draw_on_cpu(scene, picture.view);
    picture.result.view = camera.name;
    picture.result.drawn_triangles = scene.drawn_triangles();
    const std::vector<CaseResult> results = must(measure_peer(peer, scene, picture, 2, 1));
    REQUIRE(results.size() == 2);
    for (const CaseResult& result : results) {
      const Coverage& coverage = result.peer->coverage;
      INFO(scene.name << " " << camera.name << " " << result.indices << ": " << coverage.same << " same, "
                      << coverage.edge << " at edges, " << coverage.depth << " by depth (gap " << coverage.depth_gap
                      << "), " << coverage.other << " others");
      CHECK(coverage.same > 0);
      CHECK(coverage.other == 0);
      CHECK(static_cast<double>(coverage.edge + coverage.depth) <=
            edge_share * static_cast<double>(coverage.covered()));
      CHECK(coverage.covered() >= result.covered_samples);
      CHECK(result.view == camera.name);
      CHECK(result.frames >= 1);
      CHECK(result.wall->minimum > 0);
      CHECK(result.geometry_bytes > 12 * scene.unique_triangles());
      CHECK(result.device_bytes > result.geometry_bytes + 12 * picture.samples.size());
      CHECK(result.stats.instances_drawn > 0);
      CHECK(result.stats.instances_drawn <= scene.instances.size());
      CHECK(result.stats.draws <= 2 * scene.meshes.size());
      CHECK(result.stats.triangles <= scene.drawn_triangles());
    }
    CHECK(results[0].indices == "VK-ID");
    CHECK(results[1].indices == "VK-PIP");
  }
  peer.unload();
  CHECK(peer.device_bytes() == 0);
}

}  // namespace

TEST_CASE("lab: a peer draws generated scenes with float32 positions", "[lab]") {
  LabWords words;
  words.peer = "vulkan";
  CHECK(must(parse_options(words)).has_peer);
  CHECK_FALSE(parse_options({})->has_peer);
  const auto with = [&](auto member, auto value) {
    LabWords changed = words;
    changed.*member = value;
    return changed;
  };
  CHECK(refused(with(&LabWords::peer, "opengl")).find("not vulkan") != std::string::npos);
  CHECK(refused(with(&LabWords::files, std::vector<std::string>{"a.scree"})).find("--scene") != std::string::npos);
  CHECK(refused(with(&LabWords::positions, "16")).find("float32") != std::string::npos);
  CHECK(refused(with(&LabWords::path, true)).find("--path") != std::string::npos);
  CHECK(refused(with(&LabWords::reference, true)).find("--reference") != std::string::npos);
  CHECK(refused(with(&LabWords::scenes, "textured")).find("--scene textured allows only") != std::string::npos);
}

TEST_CASE("lab: differences between two pictures are explained by exact geometry", "[lab]") {
  const synth::Scene scene = synth::sponzalike_scene(1);
  const kernels::View view = scene_view(scene.cameras[0], 160, 90);
  const std::vector<uint64_t> samples = draw_on_cpu(scene, view);
  std::vector<uint64_t> ids = ids_of(samples);
  const Coverage equal = compare_coverage(scene, view, samples, ids);
  CHECK(equal.same == count_covered(ids));
  CHECK(equal.covered() == equal.same);

  // A triangle that does not cover the sample is wrong, and so is a hole. Most samples lie far from all edges.
  std::vector<uint64_t> moved = ids;
  std::rotate(moved.begin(), moved.begin() + view.width / 2, moved.end());
  const Coverage rotated = compare_coverage(scene, view, samples, moved);
  CHECK(rotated.covered() == equal.same);
  CHECK(rotated.other > 0);
  CHECK(rotated.other > 10 * (rotated.edge + rotated.depth));
  const Coverage empty = compare_coverage(scene, view, samples, std::vector<uint64_t>(ids.size(), kernels::kIdMask));
  CHECK(empty.same == 0);
  CHECK(empty.other > 10 * empty.edge);

  // The same scene seen by cameras a hundredth of a sample apart differs only at edges.
  kernels::View near_view = view;
  for (int i = 0; i < 3; ++i) near_view.forward[i] += view.right[i] * 0.005 * view.half_width * 2 / view.width;
  const Coverage shifted = compare_coverage(scene, view, samples, ids_of(draw_on_cpu(scene, near_view)));
  CHECK(shifted.edge > 0);
  CHECK(shifted.other == 0);
  CHECK(shifted.same + shifted.edge + shifted.depth == shifted.covered());

  // Without the instances of columns and drapes, samples show the triangles behind them.
  std::vector<uint32_t> omitted((scene.instances.size() + 31) / 32);
  for (size_t i = 10; i < scene.instances.size(); ++i) omitted[i / 32] |= 1u << (i % 32);
  kernels::View emptier = view;
  emptier.omitted = omitted.data();
  const Coverage behind = compare_coverage(scene, view, samples, ids_of(draw_on_cpu(scene, emptier)));
  CHECK(behind.depth > 1000);
  CHECK(behind.depth_gap > 0.01);
  CHECK(behind.other == 0);
}

TEST_CASE("lab: Vulkan draws the CPU's picture, except at edges", "[lab][peer]") {
  if (kFindsLeaks) {
    WARN("skipped: drivers leak memory");
    return;
  }
  const Result<std::unique_ptr<Peer>> opened = open_vulkan_peer("");
  if (!opened) {
    CHECK(opened.error().code == ErrorCode::kDevice);
    WARN("skipped: " << opened.error().message);
    return;
  }
  Peer& peer = **opened;
  CHECK_FALSE(peer.device().empty());
  synth::Scene huge = synth::sponzalike_scene(1);
  huge.meshes.assign(100'000, synth::terrain_scene(synth::MeshOrder::kRow, 1).meshes[0]);
  const auto loaded = refusal(peer.load(huge, 2));
  CHECK(loaded.code == ErrorCode::kMemory);
  CHECK(loaded.message.find("takes 54.5 TiB of device memory") != std::string::npos);
  INFO(loaded.message);
  check_pictures(peer, synth::sponzalike_scene(1), 0.001);
  check_pictures(peer, synth::terrain_scene(synth::MeshOrder::kRow, 0.001), 0.005);
  check_pictures(peer, synth::lantern_scene(synth::MeshOrder::kBlock, 0.001), 0.005);
  synth::Scene halls = synth::zorahlike_scene(synth::MeshOrder::kRow, 1e-4);  // some instances are mirrored
  for (size_t i = 0; i < halls.instances.size() / 16; ++i) halls.instances[i] = halls.instances[16 * i];
  halls.instances.resize(halls.instances.size() / 16);
  check_pictures(peer, halls, 0.01);
}
