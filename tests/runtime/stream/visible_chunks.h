// The chunks that may be visible in a view, and the chunks that drawn samples hide: on the CPU, the results of
// kernels::CudaVisibleChunks. Uses only records and reads no page.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "kernels/cull/chunk_screen.h"
#include "kernels/cull/depth_pyramid.h"
#include "kernels/frame.h"
#include "kernels/scene_view.h"
#include "runtime/stream/visible_chunks.h"

namespace scree::tests {

using namespace runtime;

class VisibleChunks {
 public:
  VisibleChunks() = default;

  /// Culls all instances and their chunks conservatively: a chunk that is not listed draws no sample. Uses up to
  /// `threads` threads. The list does not depend on the number of threads. A chunk of float32 positions has the bounds
  /// of its mesh. Fewer than 2^32 chunks. Throws std::bad_alloc.
  VisibleChunks(const kernels::SceneView& scene, const kernels::View& view, uint32_t threads);

  /// Each chunk once, in the order of order_by_depth().
  std::span<const uint32_t> near_to_far() const { return order_; }

  /// The nearest depth code that a chunk may have anywhere; kNotInView for chunks that are not listed.
  uint32_t nearest(uint32_t chunk) const { return nearest_[chunk]; }

  /// The nearest depth code at which a chunk can change a sample of the picture from which `depths` was made, or of a
  /// picture with nearer samples. kNotInView if it can change none: all samples that its instances may cover have
  /// smaller depth codes. `chunk`: one of near_to_far(). Uses the pyramid's levels from `first_level` on.
  uint32_t nearest_shown(uint32_t chunk, const kernels::DepthPyramid& depths, uint32_t first_level = 1) const;

 private:
  /// Bounds of the samples that one instance of a chunk may cover.
  struct Place {
    uint32_t chunk;
    kernels::ScreenBounds bounds;
  };

  std::vector<uint32_t> order_;
  std::vector<uint32_t> nearest_;              // by chunk
  std::vector<kernels::ScreenBounds> places_;  // chunk by chunk
  std::vector<uint64_t> first_;                // by chunk: its first index in places_; one more ends the last
};

}  // namespace scree::tests
