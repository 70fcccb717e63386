// The bytes of a scene that a frame has to read at least.
#pragma once

#include <cstdint>
#include <span>

#include "kernels/cull/cull.h"
#include "kernels/frame.h"
#include "lab/scenes/scene_tables.h"

namespace scree::lab {

struct VisibleCost {
  uint64_t draws = 0;  // (instance, chunk) pairs that pass the frustum test
  uint64_t bytes = 0;  // indices and positions of their chunks, each chunk once
};

/// Culls on the host as a frame does (kernels/cull/cull.h). Reads only the records of `scene`. `boxes`: one per chunk,
/// by which chunks of float32 positions are culled as well, as in a GPU's frame. If empty, chunks of float32 positions
/// are culled by their mesh, as on a CPU.
VisibleCost visible_cost(const kernels::SceneView& scene, std::span<const ChunkBox> boxes, const kernels::View& view);

/// A box of float32 positions in the coordinates of `transform`, which is one of float32 positions.
kernels::RelativeBox float_box(const ChunkBox& box, const kernels::Transform& transform);

}  // namespace scree::lab
