// What a frame has to read of a scene at least.
#pragma once

#include <cstdint>

#include "kernels/frame.h"

namespace scree::bench {

struct Touched {
  uint64_t draws = 0;  // (instance, chunk) pairs that the frustum test leaves
  uint64_t bytes = 0;  // indices and positions of their chunks, each chunk once
};

/// Culls on the host as a frame does (kernels/cull.h); reads the records of `scene` only.
Touched count_touched(const kernels::SceneView& scene, const kernels::View& view);

}  // namespace scree::bench
