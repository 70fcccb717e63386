// The explanation of differences between two pictures of a scene.
#include <algorithm>
#include <numeric>
#include <vector>

#include "lab/peer/coverage.h"
#include "lab/scenes/scene_tables.h"
#include "lab/setup/views.h"
#include "tests/catch.h"

using namespace scree;
using namespace scree::lab;

namespace {

/// scree's picture of the scene's float32 vertices, drawn by the CPU.
std::vector<uint64_t> draw_on_cpu(const synth::Scene& scene, const kernels::View& view) {
  const std::vector<ChunkPlan> plans = plan_chunks(scene);
  const Result<SceneTables> tables =
      make_tables(scene, plans, chunk_boxes(scene, plans), {.float32 = true, .packed_indices = false});
  REQUIRE(tables);
  struct alignas(16) Block {
    std::byte bytes[16];
  };
  std::vector<Block> arena((tables->arena_bytes + 15) / 16);
  fill_chunks(scene, plans, *tables, {arena.data()->bytes, arena.size() * 16});
  const auto pages = tables->page_pointers(arena.data()->bytes);
  std::vector<uint64_t> samples(size_t{view.width} * view.height);
  REQUIRE(kernels::draw_cpu(tables->view(pages.data()), view, samples, 2));
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

}  // namespace

TEST_CASE("lab: differences between two pictures are explained by exact geometry", "[lab]") {
  const synth::Scene scene = synth::sponzalike_scene(1);
  const kernels::View view = scene_view(scene.cameras[0], 160, 90);
  const std::vector<uint64_t> samples = draw_on_cpu(scene, view);
  std::vector<uint64_t> ids = ids_of(samples);
  const Coverage equal = compare_coverage(scene, view, samples, ids);
  CHECK(equal.same == count_covered(ids));
  CHECK(equal.covered() == equal.same);

  // A triangle that does not cover the sample, and a hole, are wrong; most samples lie far from all edges.
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

  // Without the instances of columns and drapes, samples show triangles behind them, which they covered too.
  std::vector<uint32_t> omitted((scene.instances.size() + 31) / 32);
  for (size_t i = 10; i < scene.instances.size(); ++i) omitted[i / 32] |= 1u << (i % 32);
  kernels::View emptier = view;
  emptier.omitted = omitted.data();
  const Coverage behind = compare_coverage(scene, view, samples, ids_of(draw_on_cpu(scene, emptier)));
  CHECK(behind.depth > 1000);
  CHECK(behind.depth_gap > 0.01);
  CHECK(behind.other == 0);
}
