// The least bytes of a scene that a frame must read.
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

/// Culls on the host like a frame (kernels/cull/cull.h). Reads only the records of `scene`. `boxes`: one per chunk, by
/// which chunks with float32 positions are culled, as on a GPU. If it is empty, they are culled by their mesh's box, as
/// on a CPU.
VisibleCost visible_cost(const kernels::SceneView& scene, std::span<const ChunkBox> boxes, const kernels::View& view);

/// A box of float32 positions in the coordinates of `transform`, which is one of float32 positions.
kernels::RelativeBox float_box(const ChunkBox& box, const kernels::Transform& transform);

}  // namespace scree::lab
