// How kernels read the scene and the draw list.
#pragma once

#include "kernels/cuda/common/backend.cuh"
#include "kernels/cuda/frame/draw_list.h"
#include "kernels/cull/cull.h"

namespace scree::kernels {

__device__ inline bool is_double_sided(const SceneView& scene, const format::MeshRecord& mesh) {
  return mesh.material != format::kNone && (scene.materials[mesh.material].flags & format::kMaterialDoubleSided) != 0;
}

__device__ inline format::ClusterBounds load_bounds(const format::ClusterBounds* from) {
  const uint4 words = __ldg(reinterpret_cast<const uint4*>(from));
  return {{words.x, words.y, words.z}, words.w};
}

/// The smallest known box of a chunk's vertices.
__device__ inline RelativeBox drawn_box(const DrawList& list, const format::MeshRecord& mesh,
                                        const format::ChunkRecord& chunk, uint32_t chunk_number,
                                        const Transform& transform) {
  if (mesh.position_encoding != format::PositionEncoding::kFloat32) return chunk_box(mesh, chunk, transform);
  RelativeBox box;
  const ChunkBounds& bounds = list.bounds[chunk_number];
  for (int i = 0; i < 3; ++i) {
    const auto low = static_cast<double>(bounds.min[i]);
    const auto high = static_cast<double>(bounds.max[i]);
    box.center[i] = 0.5 * (low + high) - static_cast<double>(transform.center[i]);
    // Subtracting the center from a position rounds once.
    box.extent[i] = 0.5 * (high - low) + (abs_of(low) + abs_of(high)) * (1.0 / (1 << 22));
  }
  return box;
}

/// The index of the last draw whose work_before is <= `work`, by a warp: 32 probes per step. `first` returns a draw's
/// work_before.
template <class First>
__device__ inline uint32_t find_draw(uint32_t count, uint64_t work, uint32_t lane, const First& first) {
  uint32_t low = 0;
  while (count > 1) {
    const uint32_t step = (count + kWarpLanes - 1) / kWarpLanes;
    const uint64_t probe = uint64_t{lane} * step;
    const bool before = probe < count && first(low + static_cast<uint32_t>(probe)) <= work;
    const auto last = static_cast<uint32_t>(__popc(__ballot_sync(~0u, before))) - 1;
    low += last * step;
    count = min_of(step, count - last * step);
  }
  return low;
}

}  // namespace scree::kernels
