// The chunks that a view draws, for tests that check each of their triangles.
#pragma once

#include <cmath>
#include <cstdint>

#include "kernels/raster/vertex.h"
#include "tests/kernels/scene_builder.h"

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

/// Sets up case `round` of a test of culling: adds a turned instance of a mesh, with the world's origin near or a
/// million units away, and returns a camera at `distance` from it. The sides of its picture are odd or even, from
/// `width` x `width` - 20 up to the largest. `unit`: random numbers from -1 to 1.
template <class Unit>
kernels::View place_randomly(SceneBuilder& scene, uint32_t mesh, int round, double distance, double z_near,
                             uint32_t width, const Unit& unit) {
  const double origin = round % 4 == 0 ? 1e6 * unit() : 0.0;
  add_turned_instance(scene, mesh, round, origin, unit);
  const bool is_large = round % 6 == 0;
  const uint32_t height = is_large ? 9001 : width - 20 + static_cast<uint32_t>(round * 7 % 31);
  const double around = unit() * 3;
  return look_at(
      {origin + distance * std::cos(around), -origin + 0.3 * distance * unit(), origin + distance * std::sin(around)},
      {origin + 0.2 * unit(), -origin, origin}, is_large ? 16384 : width + static_cast<uint32_t>(round), height,
      z_near);
}

}  // namespace scree::tests
