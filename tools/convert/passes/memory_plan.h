// What a conversion takes, reckoned from the scene before it begins, so that ConvertOptions::memory holds for any
// scene: it decides how many threads work at a time and how much they may have in flight, and nothing else, so that it
// never shows in the bytes.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "format/result.h"
#include "tools/convert/plan/convert_options.h"
#include "tools/convert/sort/sort_primitive.h"
#include "tools/convert/windows/measure.h"
#include "tools/gltf/source.h"

namespace scree::convert {

/// The largest of each over all windows: what the scratch memory of a thread grows to.
struct WindowNeeds {
  uint64_t triangles = 0;
  uint64_t vertices = 0;  // distinct ones
  uint64_t span = 0;      // from the smallest vertex number to the largest, at most
  uint64_t chunks = 0;    // that all windows together become, about
};

/// Whether primitives without locality are sorted (sort_primitive.h): not where the source's order is kept, or windows
/// are whole meshes.
bool may_sort(const ConvertOptions& options);

/// What one stage may do.
struct StageLimits {
  uint32_t threads = 1;
  uint64_t flight_bytes = 0;  // of results on their way to the file
};

struct AheadLimits {
  uint32_t threads = 1;
  uint64_t flight_bytes = 0;  // of encoded windows
  uint64_t held_bytes = 0;    // of measured windows that wait
  WindowNeeds window;         // the largest that is encoded
};

class MemoryPlan {
 public:
  /// `wanted`: flags for the primitives that are converted; `threads`: as many as are asked for; `image_bytes`: what
  /// checking or packing one image takes at most. Error kUsage: ConvertOptions::memory is below the least that is
  /// needed, which the message says; it counts on every corner of a window having a vertex of its own.
  static Result<MemoryPlan> make(const ConvertOptions& options, const SourceScene& scene,
                                 const std::vector<bool>& wanted, uint64_t image_bytes, uint32_t threads);

  StageLimits measure() const;
  SortLimits sort(const SortNeeds& needs) const;
  /// flight_bytes: for images, at most `most`.
  StageLimits images(uint64_t most) const;
  /// Where measuring and encoding go on at once, what they may; nothing where that would leave threads without work.
  /// Where they suffice only so, windows of indexed triangles count with a vertex a triangle, as nearly all have less;
  /// AheadLimits::window says so.
  std::optional<AheadLimits> ahead() const;
  /// More than the chunks of a primitive will take in the file.
  uint64_t most_stored_bytes(const Primitive& primitive) const;

  /// `windows`: as they were measured. flight_bytes: for encoded windows.
  StageLimits encode(const std::vector<WindowPlan>& windows) const;

 private:
  uint64_t free_bytes(uint64_t beside = 0) const;  // what is left beside so much
  std::optional<AheadLimits> ahead_of(const WindowNeeds& window) const;
  uint64_t window_bytes(const WindowNeeds& needs) const;
  uint64_t measure_thread_bytes(const WindowNeeds& needs) const;
  uint64_t encode_thread_bytes(const WindowNeeds& needs) const;
  uint64_t encoded_bytes(const WindowNeeds& needs) const;
  uint64_t page_bytes(const WindowNeeds& needs) const;
  uint64_t table_bytes(const WindowNeeds& needs) const;

  uint64_t memory_ = 0;
  uint64_t primitives_ = 0;
  uint64_t windows_ = 0;
  uint64_t group_windows_ = 0;  // most of one glTF mesh
  uint32_t threads_ = 1;
  uint64_t chunk_triangles_ = 0;
  int zstd_level_ = 0;
  bool clustered_ = false;
  bool source_ids_ = false;
  uint32_t id_bits_ = 0;
  uint64_t vertex_bits_ = 0;           // most that are stored
  uint64_t attribute_components_ = 0;  // most of one attribute
  PackedViewMemory views_;
  WindowNeeds most_;   // of any window, by what the document says
  WindowNeeds usual_;  // as most_, where triangles share vertices
};

/// Page cache for what is read ahead, which is no memory of the process, of `memory` in all.
uint64_t read_ahead_bytes(uint64_t memory);

/// Memory for windows of unpacked buffer views that are kept, of `memory` in all.
uint64_t kept_view_bytes(uint64_t memory);

}  // namespace scree::convert
