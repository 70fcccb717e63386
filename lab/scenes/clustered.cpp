#include "lab/scenes/clustered.h"

#include <algorithm>
#include <new>

#include "format/geometry/quantize.h"
#include "runtime/threads/parallel.h"
#include "tools/clusters/cluster_builder.h"
#include "tools/clusters/fifo_order.h"

namespace scree::lab {
namespace {

/// Memory for encoding a chunk; one per thread.
struct Scratch {
  std::vector<uint32_t> indices;
  tools::FifoOrder fifo;
  std::vector<uint32_t> ordered;
  std::vector<uint32_t> offsets;
  tools::ClusterBuilder builder;
};

void fill(const synth::MeshRecipe& recipe, const ChunkPlan& plan, const format::MeshRecord& mesh, Scratch& s) {
  const uint32_t vertices = chunk_vertices(recipe, plan);
  const uint32_t quads = chunk_quads(recipe, plan);
  s.offsets.resize(3 * size_t{vertices});
  s.indices.resize(6 * size_t{quads});
  for (uint32_t v = 0; v < vertices; ++v) {
    const synth::Float3 p = chunk_position(recipe, plan, v);
    const float parts[3] = {p.x, p.y, p.z};
    for (size_t axis = 0; axis < 3; ++axis) {
      s.offsets[3 * size_t{v} + axis] =
          static_cast<uint32_t>(format::quantize(parts[axis], mesh.lattice_exponent) - mesh.lattice_min[axis]);
    }
  }
  for (uint32_t quad = 0; quad < quads; ++quad) {
    chunk_quad_indices(recipe, plan, quad, s.indices.data() + 6 * size_t{quad});
  }
}

std::vector<std::byte> encode(const synth::MeshRecipe& recipe, const ChunkPlan& plan, const format::MeshRecord& mesh,
                              format::ChunkRecord& chunk, Scratch& s) {
  fill(recipe, plan, mesh, s);
  const auto vertices = static_cast<uint32_t>(s.offsets.size() / 3);
  s.ordered.clear();
  for (const uint32_t triangle : s.fifo.run(s.indices, vertices)) {
    const auto corner = s.indices.begin() + 3 * static_cast<ptrdiff_t>(triangle);
    s.ordered.insert(s.ordered.end(), corner, corner + 3);
  }
  std::vector<std::byte> payload;
  tools::encode_clustered_chunk(s.builder, s.ordered, s.offsets, tools::ClusterEffort::kFast, chunk, payload);
  return payload;
}

}  // namespace

Result<ClusteredScene> encode_clustered(const synth::Scene& scene, std::span<const ChunkPlan> plans, SceneTables tables,
                                        uint32_t threads) {
  ClusteredScene out{.tables = std::move(tables)};
  std::vector<format::ChunkRecord>& chunks = out.tables.chunks;
  try {
    out.payloads.resize(plans.size());
    // Several chunks per share, so that a thread's scratch memory is used for all of them.
    constexpr uint64_t kShare = 16;
    runtime::parallel_for((plans.size() + kShare - 1) / kShare, threads, [&](uint64_t share) {
      Scratch scratch;
      for (uint64_t i = share * kShare; i < std::min<uint64_t>((share + 1) * kShare, plans.size()); ++i) {
        out.payloads[i] =
            encode(scene.meshes[plans[i].mesh], plans[i], out.tables.meshes[plans[i].mesh], chunks[i], scratch);
      }
    });
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::kMemory, "not enough memory to encode the scene; a smaller --scale needs less"};
  }
  place_chunks(out.tables);
  return out;
}

}  // namespace scree::lab
