// The chunks that a view draws, for tests that check each of their triangles.
#pragma once

#include <cstdint>

#include "kernels/raster/vertex.h"

namespace scree::tests {

/// Calls visit(mesh, chunk, transform) for every chunk of every instance. The transform includes its error bound.
template <class Visit>
void for_each_drawn_chunk(const kernels::SceneView& scene, const kernels::FrameView& view, const Visit& visit) {
  for (uint64_t n = 0; n < scene.instance_count; ++n) {
    const format::InstanceRecord& instance = scene.instances[n];
    const format::MeshRecord& mesh = scene.meshes[instance.mesh];
    for (uint64_t c = mesh.first_chunk; c < mesh.first_chunk + mesh.chunk_count; ++c) {
      const format::ChunkRecord& chunk = scene.chunks[c];
      kernels::Transform transform =
          kernels::make_transform(view, scene.matrices[instance.matrix], mesh.lattice_exponent,
                                  mesh.position_encoding == format::PositionEncoding::kFloat32);
      kernels::set_error(transform, kernels::vertex_box(mesh, chunk, transform));
      visit(mesh, chunk, transform);
    }
  }
}

}  // namespace scree::tests
