#include "tools/convert/measure.h"

#include <algorithm>
#include <optional>
#include <span>

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
  uint32_t span = 0;
  Box box = empty_box();
  bool white = true;
  ContentHash content{};
};

struct Scratch {
  Window window;
  std::vector<float> colors;
  std::vector<float> floats;
  std::vector<uint32_t> numbers;
};

template <class T>
void add_values(ContentHasher& hasher, std::span<const T> values) {
  const uint64_t count = values.size();
  hasher.add(std::as_bytes(std::span(&count, 1)));
  hasher.add(std::as_bytes(values));
}

/// The triangles, whatever number their first vertex has in the source, and the vertices they use.
Result<ContentHash> hash_window(const Primitive& primitive, bool normals, Scratch& scratch) {
  const Window& window = scratch.window;
  ContentHasher hasher;
  add_values(hasher, window.kept());
  scratch.numbers.assign(window.indices().begin(), window.indices().end());
  const uint32_t first = window.vertices().empty() ? 0 : window.vertices().front();
  for (uint32_t& number : scratch.numbers) number -= first;
  add_values(hasher, std::span<const uint32_t>(scratch.numbers));
  add_values(hasher, window.positions());
  const std::optional<Accessor> none;
  for (const std::optional<Accessor>* accessor :
       {&primitive.uv, &primitive.color, normals ? &primitive.normal : &none}) {
    scratch.floats.clear();
    if (*accessor) {
      const Result<void> read = read_vertices(**accessor, window.vertices(), scratch.floats);
      if (!read) return read.error();
    }
    add_values(hasher, std::span<const float>(scratch.floats));  // of none 0: its count is hashed too
  }
  return hasher.value();
}

/// What of all windows of a primitive in their order.
ContentHash joined(const ContentHash& before, const ContentHash& window) {
  ContentHasher hasher;
  hasher.add(std::as_bytes(std::span(before)));
  hasher.add(std::as_bytes(std::span(window)));
  return hasher.value();
}

Result<WindowFacts> measure_window(const Primitive& primitive, const WindowPlan& plan, const MeasureOptions& options,
                                   Scratch& scratch) {
  Window& window = scratch.window;
  if (const Result<void> loaded =
          window.load(primitive, plan.first, plan.count, options.drop_nonfinite, Window::Find::kVertices);
      !loaded)
    return loaded.error();
  WindowFacts facts;
  facts.kept = window.triangle_count();
  facts.dropped_degenerate = window.dropped_degenerate();
  facts.dropped_nonfinite = window.dropped_nonfinite();
  facts.vertices = static_cast<uint32_t>(window.vertices().size());
  facts.span = static_cast<uint32_t>(window.span());
  facts.box = box_of(window.positions());
  if (primitive.color) {
    if (const Result<void> read = read_vertices(*primitive.color, window.vertices(), scratch.colors); !read)
      return read.error();
    facts.white = std::all_of(scratch.colors.begin(), scratch.colors.end(), [](float value) { return value == 1.0f; });
  }
  if (!options.hashed.empty() && options.hashed[plan.primitive]) {
    const Result<ContentHash> content = hash_window(primitive, options.normals, scratch);
    if (!content) return content.error();
    facts.content = *content;
  }
  return facts;
}

}  // namespace

std::vector<Batch> make_batches(const std::vector<WindowPlan>& windows, uint64_t first) {
  std::vector<Batch> batches;
  for (uint64_t i = first; i < windows.size(); ++i) {
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
                            uint32_t threads, const std::atomic<bool>* stop,
                            const std::function<void(uint64_t)>& progress) {
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
  std::vector<Scratch> scratch(threads);
  const auto work = [&](uint64_t batch, uint32_t worker) -> Result<std::vector<WindowFacts>> {
    std::vector<WindowFacts> facts;
    for (uint64_t i = batches[batch].first; i < batches[batch].first + batches[batch].count; ++i) {
      const WindowPlan& plan = out.windows[i];
      Result<WindowFacts> measured = measure_window(scene.primitives[plan.primitive], plan, options, scratch[worker]);
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
      plan.span = facts[i].span;
      plan.box = facts[i].box;
      Measured& total = out.primitives[plan.primitive];
      total.triangles += facts[i].kept;
      total.dropped_degenerate += facts[i].dropped_degenerate;
      total.dropped_nonfinite += facts[i].dropped_nonfinite;
      total.white = total.white && facts[i].white;
      if (!options.hashed.empty() && options.hashed[plan.primitive])
        total.content = joined(total.content.value_or(ContentHash{}), facts[i].content);
      grow(total.box, facts[i].box);
    }
    done += batches[batch].triangles;
    progress(done);
    return {};
  };
  WorkerPool pool(threads, stop);
  const auto no_cost = [](uint64_t) { return uint64_t{0}; };
  if (const Result<void> run = run_ordered<std::vector<WindowFacts>>(
          pool, batches.size(), {kJobsPerThread * pool.threads(), UINT64_MAX}, work, no_cost, take);
      !run)
    return run.error();
  std::erase_if(out.windows, [](const WindowPlan& window) { return window.kept == 0; });
  return out;
}

}  // namespace scree::convert
