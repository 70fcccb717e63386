// The computed memory of conversions of scenes that are too large for a test to convert.
#include <vector>

#include "tests/results.h"
#include "tools/common/process/memory_use.h"
#include "tools/convert/passes/memory_plan.h"

using namespace scree;
using namespace scree::convert;

namespace {

constexpr uint64_t kPrimitives = 200;
constexpr uint64_t kTriangles = uint64_t{1} << 31;  // of each primitive

/// Primitives of one glTF mesh, or one mesh per primitive. Their accessors are never read.
SourceScene make_planned_scene(bool in_one_mesh) {
  SourceScene scene{.file_name = "huge.gltf"};
  for (uint32_t i = 0; i < kPrimitives; ++i) {
    Primitive primitive{.group = in_one_mesh ? 0 : i, .positions = {.count = 1000}};
    primitive.indices.emplace().count = 3 * kTriangles;
    scene.primitives.push_back(primitive);
  }
  return scene;
}

/// The smallest --memory, rounded to MiB, with which one thread may encode ahead.
uint64_t least_ahead(const SourceScene& scene) {
  ConvertOptions options;
  const std::vector<bool> wanted(scene.primitives.size(), true);
  uint64_t too_little = 0, enough = uint64_t{1} << 40;
  while (enough - too_little > uint64_t{1} << 20) {
    options.memory = too_little + (enough - too_little) / 2;
    const Result<MemoryPlan> plan = MemoryPlan::make(options, scene, wanted, 0, 1);
    (plan && plan->ahead() ? enough : too_little) = options.memory;
  }
  return enough;
}

}  // namespace

TEST_CASE("memory plan: windows of one glTF mesh wait for each other", "[convert][memory]") {
  const uint64_t apart = least_ahead(make_planned_scene(false)), together = least_ahead(make_planned_scene(true));
  CHECK(apart < uint64_t{1} << 40);
  // Each window is listed three times, in vectors that may be half empty. Process memory varies by some MiB.
  const uint64_t windows = kPrimitives * (kTriangles / kWindowTriangles);
  CHECK(together - apart > windows * 2 * sizeof(WindowPlan));
  CHECK(together - apart < windows * 1024);
}

TEST_CASE("memory plan: windows of indexed triangles count one vertex per triangle if memory is short",
          "[convert][memory]") {
  SourceScene scene = make_planned_scene(false);
  for (Primitive& primitive : scene.primitives) primitive.positions.count = uint64_t{1} << 30;
  const auto largest = [&](uint64_t memory) {
    ConvertOptions options;
    options.memory = memory;
    const MemoryPlan plan = must(MemoryPlan::make(options, scene, std::vector<bool>(kPrimitives, true), 0, 1));
    return must(plan.ahead()).window;
  };
  constexpr uint64_t kSlack = uint64_t{16} << 20;  // process memory varies
  const uint64_t least = least_ahead(scene);
  CHECK(largest(least + kSlack).vertices == kWindowTriangles + 2);
  CHECK(largest(least + kSlack).span == kBitmapSpan);
  CHECK(largest(2 * least).vertices == 3 * kWindowTriangles);
  CHECK(largest(2 * least).span == uint64_t{1} << 30);

  // Without indices, each triangle has its own three vertices.
  for (Primitive& primitive : scene.primitives) primitive.indices.reset();
  CHECK(largest(least_ahead(scene) + kSlack).vertices == 3 * kWindowTriangles);
}

TEST_CASE("memory plan: compressed views take the memory of their index, readers and kept windows",
          "[convert][memory][meshopt]") {
  SourceScene scene = make_planned_scene(false);
  const uint64_t plain = least_ahead(scene);
  constexpr uint64_t kGiB = uint64_t{1} << 30;
  constexpr uint64_t kSlack = uint64_t{16} << 20;  // process memory varies
  const auto more = [&](const PackedViewMemory& views) {
    scene.view_memory = views;
    return least_ahead(scene) - plain;
  };
  CHECK(more({0, kGiB, 0}) + kSlack > kGiB);
  CHECK(more({kGiB, 0, 0}) + kSlack > 2 * kGiB);  // a thread holds one window while another is kept
  const uint64_t kept = more({0, 0, kGiB / 16});
  CHECK(kept + kSlack > kGiB / 16);
  CHECK(kept < kGiB / 16 + kSlack);
}

TEST_CASE(
    "memory plan: the default memory suffices for 16 threads and windows that wait between measuring and encoding",
    "[convert][memory][meshopt]") {
  SourceScene scene = make_planned_scene(false);
  scene.primitives.resize(60);  // each like the largest one of Zorah; together they have more triangles than Zorah
  for (Primitive& primitive : scene.primitives) {
    primitive.positions.count = 16'005'261;
    primitive.indices->count = 3 * uint64_t{32'054'609};
  }
  scene.view_memory = {700'000, uint64_t{24} << 20, uint64_t{256} << 20};
  ConvertOptions options;
  options.memory += tools::memory_use().anonymous;  // memory that earlier tests left
  const MemoryPlan plan =
      must(MemoryPlan::make(options, scene, std::vector<bool>(scene.primitives.size(), true), 0, 16));
  const AheadLimits limits = must(plan.ahead());
  CHECK(limits.threads == 16);
  // A window takes 12 bytes per triangle, and 16 bytes per vertex, with half as many vertices.
  CHECK(limits.held_bytes >= 16 * 20 * kWindowTriangles);
}
