#include "tools/convert/windows/measure.h"

#include <algorithm>
#include <atomic>
#include <iterator>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <utility>

#include "tools/convert/windows/derived_tangents.h"
#include "tools/convert/windows/face_normals.h"
#include "tools/convert/windows/locality.h"
#include "tools/convert/windows/read_ahead.h"

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
  bool shows_normals = false;
  bool shows_tangents = false;
  ContentHash content{};
  ContentHash normals{};
  ContentHash tangents{};
  bool waits = false;  // postponed, because its vertices lie too far apart
  VertexUse use;
  std::unique_ptr<HeldWindow> held;
};

struct Scratch {
  Window* window = nullptr;
  std::vector<float> colors;
  std::vector<float> floats;
  std::vector<float> uvs;
  std::vector<float> tangents;
  std::vector<uint32_t> numbers;
};

template <class T>
void add_values(ContentHasher& hasher, std::span<const T> values) {
  const uint64_t count = values.size();
  hasher.add(std::as_bytes(std::span(&count, 1)));
  hasher.add(std::as_bytes(values));
}

/// A hash of the triangles and of the vertices they use, except for normals and tangents. The number of the first
/// vertex in the source does not affect it.
Result<ContentHash> hash_window(const Primitive& primitive, Scratch& scratch) {
  const Window& window = *scratch.window;
  ContentHasher hasher;
  add_values(hasher, window.kept());
  if (primitive.numbers) add_values(hasher, window.numbers());
  scratch.numbers.assign(window.indices().begin(), window.indices().end());
  const std::span<const uint32_t> vertices = window.vertices();
  const uint32_t first = vertices.empty() ? 0 : vertices.front();
  for (uint32_t& number : scratch.numbers) number = (window.is_renumbered() ? vertices[number] : number) - first;
  add_values(hasher, std::span<const uint32_t>(scratch.numbers));
  add_values(hasher, window.positions());
  const auto of = [](const std::optional<Accessor>& accessor) { return accessor ? &*accessor : nullptr; };
  for (const Accessor* accessor : {of(primitive.uv), of(primitive.color), primitive.second_uv()}) {
    scratch.floats.clear();
    if (accessor != nullptr) SCREE_TRY(read_vertices(*accessor, window.vertices(), scratch.floats));
    add_values(hasher, std::span<const float>(scratch.floats));  // an absent attribute adds only its count, 0
  }
  return hasher.value();
}

ContentHash hash_floats(std::span<const float> values) {
  ContentHasher hasher;
  add_values(hasher, values);
  return hasher.value();
}

/// Combines the hashes of a primitive's windows, in order.
ContentHash joined(const ContentHash& before, const ContentHash& window) {
  ContentHasher hasher;
  hasher.add(std::as_bytes(std::span(before)));
  hasher.add(std::as_bytes(std::span(window)));
  return hasher.value();
}

/// Options of measuring one window.
struct WindowTask {
  bool may_wait;               // the window may be postponed if its vertices lie too far apart
  bool has_normals;            // the primitive has normals that may be stored
  std::atomic<bool>* is_flat;  // of the primitive, with Normals::kAuto: all normals so far equal the faces'; once
                               // false, it is not checked again
  const format::SurfaceRecord* surface;     // the primitive's material if tangents may be stored, else null
  std::atomic<bool>* has_derived_tangents;  // as is_flat
  HeldBudget* budget;                       // memory for windows that are held; null: none is held
};

/// Reads a window's normals and tangents, finds out whether they must be stored, and hashes them.
Result<void> measure_directions(const Primitive& primitive, const WindowTask& task, bool looks, bool is_hashed,
                                Scratch& scratch, WindowFacts& facts) {
  const Window& window = *scratch.window;
  const auto read = [&](const Accessor& accessor, std::vector<float>& out) {
    return read_vertices(accessor, window.vertices(), out);
  };
  const bool looks_at_tangents = task.surface != nullptr && *task.has_derived_tangents;
  if (looks || looks_at_tangents || (is_hashed && task.has_normals)) SCREE_TRY(read(*primitive.normal, scratch.floats));
  if (looks && !are_face_normals(window, scratch.floats, *primitive.normal)) *task.is_flat = false;
  if (is_hashed && task.has_normals) facts.normals = hash_floats(scratch.floats);
  if (!looks_at_tangents && !(is_hashed && task.surface != nullptr)) return {};
  SCREE_TRY(read(*primitive.tangent(), scratch.tangents));
  if (is_hashed) facts.tangents = hash_floats(scratch.tangents);
  if (!looks_at_tangents) return {};
  const Accessor& uv = normal_map_uv(primitive, *task.surface);
  SCREE_TRY(read(uv, scratch.uvs));
  if (!are_derived_tangents(window, {scratch.floats, scratch.uvs, scratch.tangents}, *task.surface,
                            *primitive.tangent()))
    *task.has_derived_tangents = false;
  return {};
}

Result<WindowFacts> measure_window(const Primitive& primitive, const WindowPlan& plan, const MeasureOptions& options,
                                   const WindowTask& task, Scratch& scratch) {
  Window& window = *scratch.window;
  const bool is_hashed = !options.hashed.empty() && options.hashed[plan.primitive];
  const bool looks = task.has_normals && options.normals == Normals::kAuto && *task.is_flat;
  const Window::Find find = task.budget != nullptr || looks || (task.surface != nullptr && *task.has_derived_tangents)
                                ? Window::Find::kTriangles
                                : Window::Find::kVertices;
  SCREE_TRY(window.load_triangles(primitive, plan.first, plan.count, find));
  WindowFacts facts;
  facts.dropped_degenerate = window.dropped_degenerate();
  if (task.may_wait) {
    const uint64_t read =
        window.span() > kManyVerticesRead * plan.count ? vertices_read(window.vertices()) : window.span();
    const bool is_far = read > kMostVerticesRead * plan.count;
    facts.use.add(plan.count, window.vertices(), is_far);
    facts.waits = is_far || (read > kManyVerticesRead * plan.count && window.vertices().size() > plan.count);
    if (facts.waits) return facts;
  }
  SCREE_TRY(window.load_positions(primitive, options.drop_nonfinite));
  facts.kept = window.triangle_count();
  facts.dropped_nonfinite = window.dropped_nonfinite();
  facts.vertices = static_cast<uint32_t>(window.vertices().size());
  facts.span = static_cast<uint32_t>(window.span());
  facts.box = box_of(window.positions());
  if (primitive.color) {
    SCREE_TRY(read_vertices(*primitive.color, window.vertices(), scratch.colors));
    facts.white = std::all_of(scratch.colors.begin(), scratch.colors.end(), [](float value) { return value == 1.0f; });
  }
  SCREE_TRY(measure_directions(primitive, task, looks, is_hashed, scratch, facts));
  facts.shows_tangents = task.surface != nullptr && !*task.has_derived_tangents;
  facts.shows_normals =
      task.has_normals && (options.normals == Normals::kAlways || !*task.is_flat || facts.shows_tangents);
  if (is_hashed) facts.content = SCREE_TRY(hash_window(primitive, scratch));
  if (task.budget != nullptr && facts.kept > 0) facts.held = HeldWindow::keep(*task.budget, window);
  return facts;
}

class Measurer {
 public:
  Measurer(const SourceScene& scene, const MeasureOptions& options, const MeasureRun& run)
      : scene_(scene),
        options_(options),
        run_(run),
        listener_(run.listener),
        windows_(listener_ == nullptr ? run.pool.threads() : 0),
        scratch_(run.pool.threads()),
        is_flat_(scene.primitives.size()),
        has_derived_tangents_(scene.primitives.size()) {
    out_.primitives.resize(scene.primitives.size());
    for (uint32_t worker = 0; worker < scratch_.size(); ++worker)
      scratch_[worker].window = listener_ == nullptr ? &windows_[worker] : &listener_->window(worker);
    for (std::atomic<bool>& is_flat : is_flat_) is_flat = true;
    for (std::atomic<bool>& has_derived : has_derived_tangents_) has_derived = true;
  }

  Result<Measurement> run(const std::vector<bool>& wanted) {
    for (uint32_t i = 0; i < scene_.primitives.size(); ++i) {
      if (!wanted[i]) continue;
      SCREE_TRY(add_windows(i));
    }
    SCREE_TRY(measure(out_.windows));
    SCREE_TRY(settle_scattered());
    std::erase_if(out_.windows, [](const WindowPlan& window) { return window.kept == 0; });
    return std::move(out_);
  }

 private:
  Result<void> add_windows(uint32_t primitive) {
    const uint64_t triangles = scene_.primitives[primitive].triangle_count();
    // FifoOrder and ChunkRecord count a chunk's corners in 32 bits.
    if (options_.whole_meshes && triangles > UINT32_MAX / 3)
      return Error{ErrorCode::kUnsupported, primitive_place(scene_, primitive) + ": " + std::to_string(triangles) +
                                                " triangles, but one chunk holds at most " +
                                                std::to_string(UINT32_MAX / 3) + " (--chunk-triangles)"};
    const uint64_t step = options_.whole_meshes ? std::max<uint64_t>(triangles, 1) : kWindowTriangles;
    for (uint64_t first = 0; first < triangles; first += step) {
      WindowPlan window;
      window.primitive = primitive;
      window.first = first;
      window.count = std::min(step, triangles - first);
      out_.windows.push_back(window);
    }
    // A single window is ordered by the encoder in any case, and chunks store source triangle numbers in 32 bits.
    if (options_.may_sort && triangles > step && triangles <= uint64_t{1} << 32) uses_[primitive] = {};
    return {};
  }

  /// Measures `windows`, and adds them to their primitives.
  Result<void> measure(std::vector<WindowPlan>& windows) {
    const std::vector<Batch> batches = make_batches(windows);
    const bool is_any_hashed = std::find(options_.hashed.begin(), options_.hashed.end(), true) != options_.hashed.end();
    std::optional<ReadAhead> ahead;
    if (run_.ahead_bytes > 0)
      ahead.emplace(scene_, windows, AheadBytes{run_.ahead_bytes, unpacked_bytes()}, run_.pool.threads(),
                    listener_ != nullptr || is_any_hashed, options_.normals != Normals::kNever);
    HeldBudget* const budget = listener_ == nullptr ? nullptr : &listener_->budget();
    const auto work = [&](uint64_t batch, uint32_t worker) -> Result<std::vector<WindowFacts>> {
      if (ahead) ahead->begun(batches[batch].first);
      const Timed timed(run_.times.measuring, Spent::kNotReading);
      std::vector<WindowFacts> facts;
      for (uint64_t i = batches[batch].first; i < batches[batch].first + batches[batch].count; ++i) {
        const uint32_t primitive = windows[i].primitive;
        const bool has_normals = may_keep_normals(scene_, scene_.primitives[primitive], options_.normals);
        facts.push_back(
            SCREE_TRY_AT(scene_.file_name, measure_window(scene_.primitives[primitive], windows[i], options_,
                                                          {uses_.contains(primitive), has_normals, &is_flat_[primitive],
                                                           has_normals ? surface_of_tangents(primitive) : nullptr,
                                                           &has_derived_tangents_[primitive], budget},
                                                          scratch_[worker])));
      }
      return facts;
    };
    const auto take = [&](uint64_t batch, std::vector<WindowFacts> facts) -> Result<void> {
      for (uint64_t i = 0; i < facts.size(); ++i) {
        note(windows[batches[batch].first + i], facts[i]);
        if (listener_ == nullptr) continue;
        held_.push_back(std::move(facts[i].held));
        SCREE_TRY(give(windows, batches[batch].first + i + 1));
      }
      done_ += batches[batch].triangles;
      run_.times.measured_triangles += batches[batch].triangles;
      run_.progress(done_);
      return {};
    };
    const auto no_cost = [](uint64_t) { return uint64_t{0}; };
    const uint64_t most_jobs = kJobsPerThread * run_.pool.threads();
    return run_ordered<std::vector<WindowFacts>>(run_.pool, batches.size(), {most_jobs, UINT64_MAX}, work, no_cost,
                                                 take, run_.listener);
  }

  /// The kept memory has to hold these windows, as many that were read lately, and the ones that are being read.
  uint64_t unpacked_bytes() const { return scene_.view_memory.kept_bytes / 3; }

  const format::SurfaceRecord* surface_of_tangents(uint32_t primitive) const {
    const Primitive& source = scene_.primitives[primitive];
    return source.tangent() != nullptr ? &*scene_.materials[source.material].surface : nullptr;
  }

  /// Passes on the results up to window `end`: the window itself, or, if it completes a primitive or group, all windows
  /// of that.
  Result<void> give(const std::vector<WindowPlan>& windows, uint64_t end) {
    if (waiting_.contains(windows[end - 1].primitive)) return stop_giving();
    if (!is_whole(windows, end)) return listener_->take_window(out_.primitives, windows[end - 1], held_.back());
    const uint64_t begin = end - held_.size();
    std::vector<WindowPlan> kept;
    for (uint64_t i = begin; i < end; ++i) {
      const auto use = uses_.find(windows[i].primitive);
      if (use != uses_.end() && use->second.has_no_locality()) return stop_giving();
      if (windows[i].kept == 0) continue;
      held_[kept.size()] = std::move(held_[i - begin]);
      kept.push_back(windows[i]);
    }
    std::vector<std::unique_ptr<HeldWindow>> held = std::exchange(held_, {});
    held.resize(kept.size());
    return listener_->take_measured(out_.primitives, kept, held);
  }

  /// Whether window `end` - 1 completes a primitive, or a group if it is hashed.
  bool is_whole(const std::vector<WindowPlan>& windows, uint64_t end) const {
    if (end == windows.size()) return true;
    const uint32_t primitive = windows[end - 1].primitive, next = windows[end].primitive;
    const bool is_hashed = !options_.hashed.empty() && options_.hashed[primitive];
    return next != primitive && !(is_hashed && scene_.primitives[next].group == scene_.primitives[primitive].group);
  }

  Result<void> stop_giving() {
    held_.clear();
    return std::exchange(listener_, nullptr)->stop();
  }

  void note(WindowPlan& plan, const WindowFacts& facts) {
    plan.kept = facts.kept;
    plan.vertices = facts.vertices;
    plan.span = facts.span;
    plan.box = facts.box;
    Measured& total = out_.primitives[plan.primitive];
    total.triangles += facts.kept;
    total.dropped_degenerate += facts.dropped_degenerate;
    total.dropped_nonfinite += facts.dropped_nonfinite;
    total.white = total.white && facts.white;
    total.shows_normals = total.shows_normals || facts.shows_normals;
    total.shows_tangents = total.shows_tangents || facts.shows_tangents;
    if (!options_.hashed.empty() && options_.hashed[plan.primitive]) {
      total.content = joined(total.content.value_or(ContentHash{}), facts.content);
      total.normals = joined(total.normals, facts.normals);
      total.tangents = joined(total.tangents, facts.tangents);
    }
    grow(total.box, facts.box);
    if (const auto use = uses_.find(plan.primitive); use != uses_.end()) use->second.add(facts.use);
    if (facts.waits) waiting_.insert(plan.primitive);
  }

  /// Removes primitives without locality. Other primitives with postponed windows are measured again.
  Result<void> settle_scattered() {
    std::vector<bool> again(scene_.primitives.size());
    for (const auto& [primitive, use] : uses_) {
      if (use.has_no_locality()) {
        out_.scattered.push_back({primitive, use.first, use.span()});
        Measured kept;
        kept.dropped_degenerate = out_.primitives[primitive].dropped_degenerate;
        out_.primitives[primitive] = kept;
      } else if (waiting_.contains(primitive)) {
        again[primitive] = true;
        out_.primitives[primitive] = {};
      }
    }
    const auto is_settled = [&](const WindowPlan& window) {
      const auto use = uses_.find(window.primitive);
      return use == uses_.end() || !(use->second.has_no_locality() || again[window.primitive]);
    };
    std::vector<WindowPlan> windows;
    std::copy_if(out_.windows.begin(), out_.windows.end(), std::back_inserter(windows),
                 [&](const WindowPlan& window) { return again[window.primitive]; });
    std::erase_if(out_.windows, [&](const WindowPlan& window) { return !is_settled(window); });
    uses_.clear();
    if (windows.empty()) return {};
    for (const WindowPlan& window : windows) done_ -= window.count;
    SCREE_TRY(measure(windows));
    out_.windows.insert(out_.windows.end(), windows.begin(), windows.end());
    sort_windows(out_.windows);
    return {};
  }

  const SourceScene& scene_;
  const MeasureOptions& options_;
  const MeasureRun& run_;
  MeasureListener* listener_;  // null after it was stopped
  Measurement out_;
  std::map<uint32_t, VertexUse> uses_;  // of primitives that may be scattered
  std::set<uint32_t> waiting_;          // primitives with postponed windows
  uint64_t done_ = 0;
  std::vector<std::unique_ptr<HeldWindow>> held_;  // windows that the listener has not taken
  std::vector<Window> windows_;                    // by worker, if there is no listener
  std::vector<Scratch> scratch_;
  std::vector<std::atomic<bool>> is_flat_;               // by primitive, over its windows so far
  std::vector<std::atomic<bool>> has_derived_tangents_;  // the same
};

}  // namespace

bool may_keep_normals(const SourceScene& scene, const Primitive& primitive, Normals normals) {
  if (!primitive.normal || normals == Normals::kNever) return false;
  const bool is_unlit = primitive.material != format::kNone &&
                        (scene.materials[primitive.material].record.flags & format::kMaterialUnlit) != 0;
  return normals == Normals::kAlways || !is_unlit;
}

void sort_windows(std::vector<WindowPlan>& windows) {
  std::sort(windows.begin(), windows.end(), [](const WindowPlan& a, const WindowPlan& b) {
    return a.primitive != b.primitive ? a.primitive < b.primitive : a.first < b.first;
  });
}

bool may_join(const Batch& batch, const WindowPlan& window) {
  return batch.count < kBatchWindows && batch.triangles + window.count <= kBatchTriangles;
}

std::vector<Batch> make_batches(const std::vector<WindowPlan>& windows, uint64_t first) {
  std::vector<Batch> batches;
  for (uint64_t i = first; i < windows.size(); ++i) {
    if (batches.empty() || !may_join(batches.back(), windows[i])) batches.push_back({i, 0, 0});
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
                            const MeasureRun& run) {
  return Measurer(scene, options, run).run(wanted);
}

}  // namespace scree::convert
