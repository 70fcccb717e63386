#include "tools/convert/measure.h"

#include <algorithm>

namespace scree::convert {
namespace {

constexpr uint64_t kBatchTriangles = 65536;
constexpr uint64_t kBatchWindows = 256;
constexpr uint64_t kJobsPerThread = 3;

struct WindowFacts {
  uint64_t kept = 0;
  uint64_t dropped_degenerate = 0;
  uint64_t dropped_nonfinite = 0;
  uint32_t vertices = 0;
  Box box = empty_box();
  bool white = true;
};

struct Scratch {
  Window window;
  std::vector<float> colors;
};

Result<WindowFacts> measure_window(const Primitive& primitive, const WindowPlan& plan, bool drop_nonfinite,
                                   Scratch& scratch) {
  Window& window = scratch.window;
  if (const Result<void> loaded =
          window.load(primitive, plan.first, plan.count, drop_nonfinite, Window::Find::kVertices);
      !loaded)
    return loaded.error();
  WindowFacts facts;
  facts.kept = window.triangle_count();
  facts.dropped_degenerate = window.dropped_degenerate();
  facts.dropped_nonfinite = window.dropped_nonfinite();
  facts.vertices = static_cast<uint32_t>(window.vertices().size());
  facts.box = box_of(window.positions());
  if (primitive.color) {
    if (const Result<void> read = read_vertices(*primitive.color, window.vertices(), scratch.colors); !read)
      return read.error();
    facts.white = std::all_of(scratch.colors.begin(), scratch.colors.end(), [](float value) { return value == 1.0f; });
  }
  return facts;
}

}  // namespace

std::vector<Batch> make_batches(const std::vector<WindowPlan>& windows) {
  std::vector<Batch> batches;
  for (uint64_t i = 0; i < windows.size(); ++i) {
    if (batches.empty() || batches.back().count >= kBatchWindows ||
        batches.back().triangles + windows[i].count > kBatchTriangles)
      batches.push_back({i, 0, 0});
    ++batches.back().count;
    batches.back().triangles += windows[i].count;
  }
  return batches;
}

std::string primitive_place(const SourceScene& scene, uint32_t primitive) {
  const Primitive& p = scene.primitives[primitive];
  return scene.file_name + ": mesh " + std::to_string(p.mesh) + " primitive " + std::to_string(p.place);
}

Result<Measurement> measure(const SourceScene& scene, const std::vector<bool>& wanted, const MeasureOptions& options,
                            WorkerPool& pool, const std::function<void(uint64_t)>& progress) {
  Measurement out;
  out.primitives.resize(scene.primitives.size());
  for (uint32_t i = 0; i < scene.primitives.size(); ++i) {
    if (!wanted[i]) continue;
    const uint64_t triangles = scene.primitives[i].triangle_count();
    // meshoptimizer and ChunkRecord count the corners of a chunk in 32 bits.
    if (options.whole_meshes && triangles > UINT32_MAX / 3)
      return Error{ErrorCode::kUnsupported, primitive_place(scene, i) + ": " + std::to_string(triangles) +
                                                " triangles, but one chunk holds at most " +
                                                std::to_string(UINT32_MAX / 3) + " (--chunk-triangles)"};
    const uint64_t step = options.whole_meshes ? std::max<uint64_t>(triangles, 1) : kWindowTriangles;
    for (uint64_t first = 0; first < triangles; first += step) {
      WindowPlan window;
      window.primitive = i;
      window.first = first;
      window.count = std::min(step, triangles - first);
      out.windows.push_back(window);
    }
  }

  const std::vector<Batch> batches = make_batches(out.windows);
  std::vector<Scratch> scratch(pool.threads());
  const auto work = [&](uint64_t batch, uint32_t worker) -> Result<std::vector<WindowFacts>> {
    std::vector<WindowFacts> facts;
    for (uint64_t i = batches[batch].first; i < batches[batch].first + batches[batch].count; ++i) {
      const WindowPlan& plan = out.windows[i];
      Result<WindowFacts> measured =
          measure_window(scene.primitives[plan.primitive], plan, options.drop_nonfinite, scratch[worker]);
      if (!measured) return at(scene.file_name, measured.error());
      facts.push_back(*measured);
    }
    return facts;
  };
  uint64_t done = 0;
  const auto take = [&](uint64_t batch, std::vector<WindowFacts> facts) -> Result<void> {
    for (uint64_t i = 0; i < facts.size(); ++i) {
      WindowPlan& plan = out.windows[batches[batch].first + i];
      plan.kept = facts[i].kept;
      plan.vertices = facts[i].vertices;
      plan.box = facts[i].box;
      Measured& total = out.primitives[plan.primitive];
      total.triangles += facts[i].kept;
      total.dropped_degenerate += facts[i].dropped_degenerate;
      total.dropped_nonfinite += facts[i].dropped_nonfinite;
      total.white = total.white && facts[i].white;
      grow(total.box, facts[i].box);
    }
    done += batches[batch].triangles;
    progress(done);
    return {};
  };
  const auto no_cost = [](uint64_t) { return uint64_t{0}; };
  if (const Result<void> run = run_ordered<std::vector<WindowFacts>>(
          pool, batches.size(), {kJobsPerThread * pool.threads(), UINT64_MAX}, work, no_cost, take);
      !run)
    return run.error();
  std::erase_if(out.windows, [](const WindowPlan& window) { return window.kept == 0; });
  return out;
}

}  // namespace scree::convert
