#include "lab/scenes/visible_cost.h"

#include <cmath>
#include <vector>

#include "kernels/raster/vertex.h"

namespace scree::lab {

// Computes the box like kernels/ on a GPU: a float32 position is rounded once when the transform's centre is
// subtracted.
kernels::RelativeBox float_box(const ChunkBox& box, const kernels::Transform& transform) {
  kernels::RelativeBox relative;
  for (int i = 0; i < 3; ++i) {
    const auto low = static_cast<double>(box.lo[i]);
    const auto high = static_cast<double>(box.hi[i]);
    relative.center[i] = 0.5 * (low + high) - static_cast<double>(transform.center[i]);
    relative.extent[i] = 0.5 * (high - low) + (std::fabs(low) + std::fabs(high)) * (1.0 / (1 << 22));
  }
  return relative;
}

VisibleCost visible_cost(const kernels::SceneView& scene, std::span<const ChunkBox> boxes, const kernels::View& view) {
  const kernels::FrameView frame = kernels::make_frame_view(view);
  std::vector<bool> seen(scene.chunk_count);
  VisibleCost cost;
  for (uint64_t i = 0; i < scene.instance_count; ++i) {
    const format::InstanceRecord& instance = scene.instances[i];
    const format::MeshRecord& mesh = scene.meshes[instance.mesh];
    if (mesh.triangle_count == 0) continue;
    const bool float32 = mesh.position_encoding == format::PositionEncoding::kFloat32;
    const kernels::Transform transform =
        kernels::make_transform(frame, scene.matrices[instance.matrix], mesh.lattice_exponent, float32);
    if (!kernels::may_be_seen(transform, frame, kernels::mesh_box(mesh, transform))) continue;
    for (uint64_t c = mesh.first_chunk; c < mesh.first_chunk + mesh.chunk_count; ++c) {
      const format::ChunkRecord& chunk = scene.chunks[c];
      if (chunk.triangle_count == 0) continue;
      if (mesh.chunk_count > 1 && (!float32 || !boxes.empty()) &&
          !kernels::may_be_seen(transform, frame,
                                float32 ? float_box(boxes[c], transform) : kernels::chunk_box(mesh, chunk, transform)))
        continue;
      ++cost.draws;
      if (seen[c]) continue;
      seen[c] = true;
      cost.bytes += geometry_bytes(mesh, chunk);
    }
  }
  return cost;
}

}  // namespace scree::lab
