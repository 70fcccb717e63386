// Computes the memory of a conversion from the scene before it begins, so that ConvertOptions::memory holds for any
// scene. The plan only decides how many threads work at a time and how much may be in flight, so it never affects the
// bytes of the output.
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

/// The largest value of each over all windows. The scratch memory of a thread grows to these.
struct WindowNeeds {
  uint64_t triangles = 0;
  uint64_t vertices = 0;  // distinct ones
  uint64_t span = 0;      // upper bound of the largest vertex number less the smallest
  uint64_t chunks = 0;    // approximate number over all windows
};

/// Whether primitives without locality are sorted (sort_primitive.h): not if the source's order is kept, or windows are
/// whole meshes.
bool may_sort(const ConvertOptions& options);

/// Limits of one stage.
struct StageLimits {
  uint32_t threads = 1;
  uint64_t flight_bytes = 0;  // of results in flight to the file
};

struct AheadLimits {
  uint32_t threads = 1;
  uint64_t flight_bytes = 0;  // of encoded windows
  uint64_t held_bytes = 0;    // of measured windows that are held
  WindowNeeds window;         // the largest window that may be encoded
};

class MemoryPlan {
 public:
  /// `wanted`: flags of the primitives to be converted. `threads`: the requested number. `image_bytes`: most memory for
  /// checking or packing one image. Error kUsage: ConvertOptions::memory is below the minimum, which the message gives.
  /// The minimum assumes that every corner of a window has its own vertex.
  static Result<MemoryPlan> make(const ConvertOptions& options, const SourceScene& scene,
                                 const std::vector<bool>& wanted, uint64_t image_bytes, uint32_t threads);

  StageLimits measure() const;
  SortLimits sort(const SortNeeds& needs) const;
  /// Limits for images; flight_bytes is at most `most`.
  StageLimits images(uint64_t most) const;
  /// Limits for measuring and encoding at the same time; nullopt if that would leave threads without work. If memory
  /// would not suffice otherwise, windows of indexed triangles count as one vertex per triangle, since nearly all have
  /// fewer. AheadLimits::window has the resulting limit.
  std::optional<AheadLimits> ahead() const;
  /// An upper bound of the bytes of a primitive's chunks in the file.
  uint64_t most_stored_bytes(const Primitive& primitive) const;

  /// `windows`: as measured. flight_bytes: for encoded windows.
  StageLimits encode(const std::vector<WindowPlan>& windows) const;

 private:
  uint64_t free_bytes(uint64_t beside = 0) const;  // memory that is left beside `beside` bytes
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
  uint64_t group_windows_ = 0;  // largest number of one glTF mesh
  uint32_t threads_ = 1;
  uint64_t chunk_triangles_ = 0;
  int zstd_level_ = 0;
  bool clustered_ = false;
  bool source_ids_ = false;
  uint32_t id_bits_ = 0;
  uint64_t vertex_bits_ = 0;           // most stored bits of a vertex
  uint64_t attribute_components_ = 0;  // of the attributes that are in memory together
  PackedViewMemory views_;
  WindowNeeds most_;   // maximum of any window, from the document
  WindowNeeds usual_;  // as most_, if triangles share vertices
};

/// Page cache for reading ahead, which is not memory of the process. `memory`: the total.
uint64_t read_ahead_bytes(uint64_t memory);

/// Memory for unpacked windows of buffer views. `memory`: the total.
uint64_t kept_view_bytes(uint64_t memory);

}  // namespace scree::convert
