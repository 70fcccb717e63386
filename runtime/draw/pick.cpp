#include "runtime/draw/pick.h"

#include <cstddef>
#include <span>
#include <vector>

#include "format/bitpack.h"
#include "format/geometry/chunk_layout.h"

namespace scree::runtime {
namespace {

/// The triangle's number in the source primitive, if the file has it.
Result<std::optional<uint64_t>> source_triangle(const Scene& scene, const kernels::Hit& hit) {
  const format::ChunkRecord& chunk = scene.view().chunks[hit.chunk];
  const format::MeshRecord& mesh = scene.view().meshes[chunk.mesh];
  if (!(mesh.attributes & format::kHasSourceIds)) return std::optional<uint64_t>();
  if (chunk.source_bits == 0) return std::optional<uint64_t>(chunk.source_min);
  std::vector<std::byte> scratch;
  const std::span<const std::byte> page = SCREE_TRY(scene.page(chunk.page, scratch));
  const std::byte* const stream = page.data() + chunk.offset + format::chunk_streams(mesh, chunk).source_ids.offset;
  return std::optional<uint64_t>(chunk.source_min +
                                 format::unpack(stream, uint64_t{hit.triangle} * chunk.source_bits, chunk.source_bits));
}

}  // namespace

uint64_t sample_index(const kernels::View& view, uint32_t samples_per_side, uint32_t x, uint32_t y) {
  const uint64_t column = uint64_t{x} * samples_per_side + samples_per_side / 2;
  const uint64_t row = uint64_t{y} * samples_per_side + samples_per_side / 2;
  return row * view.width + column;
}

Result<std::optional<Pick>> pick_sample(const Scene& scene, const kernels::View& view, uint64_t sample) {
  if (sample == kernels::kBackground) return std::optional<Pick>();
  Pick pick{};
  pick.id = kernels::sample_id(sample);
  pick.hit = kernels::find_triangle(scene.view(), pick.id);
  const format::InstanceRecord& instance = scene.view().instances[pick.hit.instance];
  pick.mesh = instance.mesh;
  pick.node = instance.node;
  pick.node_instance = instance.node_instance;
  pick.mesh_triangle = scene.view().chunks[pick.hit.chunk].first_triangle + pick.hit.triangle;
  pick.source_triangle = SCREE_TRY(source_triangle(scene, pick.hit));
  pick.depth = kernels::depth_of_code(view, kernels::sample_depth_code(sample));
  return std::optional<Pick>(pick);
}

}  // namespace scree::runtime
