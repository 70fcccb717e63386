#include "tests/runtime/stream/visible_chunks.h"

#include <algorithm>

#include "runtime/threads/parallel.h"

namespace scree::tests {
namespace {

using namespace kernels;

constexpr uint64_t kInstancesAtATime = 512;

}  // namespace

VisibleChunks::VisibleChunks(const kernels::SceneView& scene, const kernels::View& view, uint32_t threads) {
  const FrameView frame = kernels::make_frame_view(view);
  const uint64_t blocks = (scene.instance_count + kInstancesAtATime - 1) / kInstancesAtATime;
  std::vector<std::vector<Place>> found(blocks);
  parallel_for(blocks, threads, [&](uint64_t block) {
    const uint64_t end = std::min((block + 1) * kInstancesAtATime, scene.instance_count);
    for (uint64_t i = block * kInstancesAtATime; i < end; ++i) {
      if (kernels::is_omitted(frame, i)) continue;
      const format::InstanceRecord& instance = scene.instances[i];
      const format::MeshRecord& mesh = scene.meshes[instance.mesh];
      if (mesh.triangle_count == 0 || !kernels::draws_mesh(scene, mesh)) continue;
      const bool float32 = mesh.position_encoding == format::PositionEncoding::kFloat32;
      const Transform transform =
          kernels::make_transform(frame, scene.matrices[instance.matrix], mesh.lattice_exponent, float32);
      if (!kernels::may_be_drawn(transform, frame, kernels::mesh_box(mesh, transform))) continue;
      for (uint64_t c = mesh.first_chunk; c < mesh.first_chunk + mesh.chunk_count; ++c) {
        ScreenBounds bounds;
        if (kernels::find_chunk_bounds(mesh, scene.chunks[c], transform, frame, bounds))
          found[block].push_back({static_cast<uint32_t>(c), bounds});
      }
    }
  });

  first_.assign(scene.chunk_count + 1, 0);
  nearest_.assign(scene.chunk_count, kNotInView);
  for (const std::vector<Place>& places : found) {
    for (const Place& place : places) {
      ++first_[place.chunk + 1];
      nearest_[place.chunk] = std::min(nearest_[place.chunk], place.bounds.nearest_code);
    }
  }
  for (uint64_t c = 0; c < scene.chunk_count; ++c) first_[c + 1] += first_[c];
  places_.resize(first_.back());
  std::vector<uint64_t> next(first_.begin(), first_.end() - 1);
  for (const std::vector<Place>& places : found)
    for (const Place& place : places) places_[next[place.chunk]++] = place.bounds;
  order_ = order_by_depth(nearest_);
}

uint32_t VisibleChunks::nearest_shown(uint32_t chunk, const kernels::DepthPyramid& depths, uint32_t first_level) const {
  uint32_t nearest = kNotInView;
  for (uint64_t i = first_[chunk]; i < first_[chunk + 1]; ++i)
    if (places_[i].nearest_code < nearest && !kernels::is_occluded_by_pyramid(depths, first_level, places_[i]))
      nearest = places_[i].nearest_code;
  return nearest;
}

}  // namespace scree::tests
