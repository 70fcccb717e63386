// The first pass over the source: checks every triangle and position before anything is written, and finds the ranges
// that the lattice and the attributes of each mesh need.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "format/result.h"
#include "tools/common/content_hash.h"
#include "tools/common/jobs/ordered_pool.h"
#include "tools/common/jobs/stage_rates.h"
#include "tools/convert/windows/held_windows.h"
#include "tools/convert/windows/window.h"
#include "tools/gltf/source.h"

namespace scree::convert {

/// The triangles of a window and, after measuring, its properties.
struct WindowPlan {
  uint32_t primitive = 0;  // in SourceScene::primitives
  uint32_t vertices = 0;   // number of distinct used vertices
  uint32_t span = 0;       // from the smallest of their numbers to the largest
  uint64_t first = 0;      // source triangle
  uint64_t count = 0;      // source triangles
  uint64_t kept = 0;
  Box box = empty_box();
};

/// Which normals of the source are stored.
enum class Normals {
  kAuto,    // of lit meshes with at least one normal that differs from its faces' (face_normals.h)
  kAlways,  // all
  kNever,
};

/// Whether normals of `primitive` are stored, or, with kAuto, may be stored if they differ from the faces'.
bool may_keep_normals(const SourceScene& scene, const Primitive& primitive, Normals normals);

/// The properties of a primitive, found by measuring.
struct Measured {
  uint64_t triangles = 0;  // kept
  uint64_t dropped_degenerate = 0;
  uint64_t dropped_nonfinite = 0;
  Box box = empty_box();               // of the vertices that its kept triangles use
  bool white = true;                   // every used COLOR_0 is exactly (1, 1, 1, 1)
  bool shows_normals = false;          // they are stored: some differ from their faces', or Normals::kAlways
  std::optional<ContentHash> content;  // hash of its triangles and vertices, if MeasureOptions::hashed is set
  ContentHash normals{};               // the same of their normals, if they may be kept
  bool shows_tangents = false;         // they are stored: some differ from the derived ones (derived_tangents.h)
  ContentHash tangents{};              // as `normals`
};

/// A primitive without locality (locality.h). It was not measured, except for dropped_degenerate.
struct ScatteredPrimitive {
  uint32_t primitive = 0;
  uint32_t first_vertex = 0;  // the first that it uses
  uint64_t vertex_count = 0;  // number of vertices from the first to the last
};

struct MeasureOptions {
  bool may_sort = false;  // primitives without locality become Measurement::scattered
  bool drop_nonfinite = false;
  bool whole_meshes = false;  // one window per primitive
  Normals normals = Normals::kAuto;
  std::vector<bool> hashed;  // one flag per primitive; empty: none
};

struct Measurement {
  std::vector<WindowPlan> windows;   // ordered by primitive, then first; windows that keep no triangle are left out
  std::vector<Measured> primitives;  // in the order of SourceScene::primitives
  std::vector<ScatteredPrimitive> scattered;
};

/// Sorts windows by primitive, then first triangle.
void sort_windows(std::vector<WindowPlan>& windows);

/// Consecutive windows that form one job, so that a scene of a million small meshes is not a million jobs.
struct Batch {
  uint64_t first = 0;
  uint64_t count = 0;
  uint64_t triangles = 0;  // of the source
};
/// Whether a window may join the windows of a batch.
bool may_join(const Batch& batch, const WindowPlan& window);
/// The batches of the windows from number `first` on.
std::vector<Batch> make_batches(const std::vector<WindowPlan>& windows, uint64_t first = 0);

/// "city.gltf: mesh 12 primitive 1", with glTF's numbers.
std::string primitive_place(const SourceScene& scene, uint32_t primitive);

/// Receives results while more is being measured, on the same pool.
class MeasureListener : public OtherResults {
 public:
  /// Windows are held while the budget has bytes left.
  virtual HeldBudget& budget() = 0;

  /// The window that a worker of the pool uses for one job after another, whether it measures or not.
  virtual Window& window(uint32_t worker) = 0;

  /// Receives the windows of a primitive or group that is not completely measured yet, one by one in order.
  /// `primitives`: measured up to this window. A window that is taken from `held` is not passed to take_measured()
  /// again. May block, and has errors, like take_measured().
  virtual Result<void> take_window(const std::vector<Measured>& primitives, const WindowPlan& window,
                                   std::unique_ptr<HeldWindow>& held) = 0;

  /// Receives complete primitives in source order; if they are hashed, all of a group at once. `windows`: all of their
  /// windows that keep triangles. `held`: the held content of each, or null. `primitives`: as SourceScene::primitives,
  /// measured up to these. May block until there is room. An error ends measuring.
  virtual Result<void> take_measured(const std::vector<Measured>& primitives, std::span<const WindowPlan> windows,
                                     std::span<std::unique_ptr<HeldWindow>> held) = 0;

  /// The current primitive will be measured again, so no more results follow. Errors as take_measured().
  virtual Result<void> stop() = 0;
};

struct MeasureRun {
  WorkerPool& pool;
  StageTimes& times;
  std::function<void(uint64_t)> progress;  // triangles done so far
  uint64_t ahead_bytes = 0;                // of the source, prefetched before they are read
  MeasureListener* listener = nullptr;
};

/// Measures all `wanted` primitives (others keep 0 triangles). Errors as Window::load with the primitive, for the first
/// one in source order; errors of the listener; kUnsupported: a primitive past 2^32 / 3 triangles with whole_meshes.
Result<Measurement> measure(const SourceScene& scene, const std::vector<bool>& wanted, const MeasureOptions& options,
                            const MeasureRun& run);

}  // namespace scree::convert
