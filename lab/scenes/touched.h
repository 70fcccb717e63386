// What a frame has to read of a scene at least.
#pragma once

#include <cstdint>
#include <span>

#include "kernels/frame.h"
#include "lab/scenes/scene_tables.h"

namespace scree::lab {

struct Touched {
  uint64_t draws = 0;  // (instance, chunk) pairs that the frustum test leaves
  uint64_t bytes = 0;  // indices and positions of their chunks, each chunk once
};

/// Culls on the host as a frame does (kernels/cull/cull.h); reads the records of `scene` only. `boxes`: one a chunk,
/// with which chunks of float32 positions are culled too, as a GPU's frame does; empty: only whole meshes of those, as
/// on a CPU.
Touched count_touched(const kernels::SceneView& scene, std::span<const ChunkBox> boxes, const kernels::View& view);

}  // namespace scree::lab
