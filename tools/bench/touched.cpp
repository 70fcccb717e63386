#include "tools/bench/touched.h"

#include <vector>

#include "kernels/cull.h"
#include "kernels/vertex.h"

namespace scree::bench {

Touched count_touched(const kernels::SceneView& scene, const kernels::View& view) {
  const kernels::FrameView frame = kernels::make_frame_view(view);
  std::vector<bool> seen(scene.chunk_count);
  Touched touched;
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
      if (!float32 && mesh.chunk_count > 1 &&
          !kernels::may_be_seen(transform, frame, kernels::chunk_box(mesh, chunk, transform)))
        continue;
      ++touched.draws;
      if (seen[c]) continue;
      seen[c] = true;
      const format::ChunkStreams streams = format::chunk_streams(mesh, chunk);
      touched.bytes += streams.indices.bytes + streams.positions.bytes;
    }
  }
  return touched;
}

}  // namespace scree::bench
