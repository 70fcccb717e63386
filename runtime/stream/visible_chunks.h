// Which chunks a view may show, how near they come, and which of them hide behind what is drawn already. From records
// alone: no page is read.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "kernels/cull/chunk_screen.h"
#include "kernels/cull/depth_pyramid.h"
#include "kernels/frame.h"
#include "kernels/scene_view.h"

namespace scree::runtime {

/// No depth code.
inline constexpr uint32_t kNotInView = UINT32_MAX;

/// The chunks that have a code (by chunk, the nearest that it may have), by that; of equal ones the smaller number
/// comes first. Throws std::bad_alloc.
std::vector<uint32_t> order_by_depth(std::span<const uint32_t> nearest_codes);

class VisibleChunks {
 public:
  VisibleChunks() = default;

  /// Culls all instances and their chunks on up to `threads` threads, conservatively: what is not listed draws no
  /// sample. The list does not depend on the number of threads. A chunk of float32 positions is where its mesh is.
  /// Fewer than 2^32 chunks. Throws std::bad_alloc.
  VisibleChunks(const kernels::SceneView& scene, const kernels::View& view, uint32_t threads);

  /// Each chunk once, as order_by_depth() has them.
  std::span<const uint32_t> near_to_far() const { return order_; }

  /// The nearest depth code that a chunk may have anywhere; kNotInView of those that are not listed.
  uint32_t nearest(uint32_t chunk) const { return nearest_[chunk]; }

  /// The nearest that it may have where it can change a sample of the picture that `depths` was made from, or of a
  /// nearer one; kNotInView where it cannot: all that its instances may cover has smaller depth codes. `chunk`: one of
  /// near_to_far(). The pyramid's levels from `first_level` on are asked.
  uint32_t nearest_shown(uint32_t chunk, const kernels::DepthPyramid& depths, uint32_t first_level = 1) const;

 private:
  /// What one instance's chunk may cover.
  struct Place {
    uint32_t chunk;
    kernels::ScreenBounds bounds;
  };

  std::vector<uint32_t> order_;
  std::vector<uint32_t> nearest_;              // by chunk
  std::vector<kernels::ScreenBounds> places_;  // chunk by chunk
  std::vector<uint64_t> first_;                // of a chunk, in places_; one more ends the last
};

}  // namespace scree::runtime
