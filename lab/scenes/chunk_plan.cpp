#include "lab/scenes/chunk_plan.h"

#include <algorithm>
#include <cassert>

namespace scree::lab {
namespace {

constexpr uint32_t kMaxQuads = format::kMaxChunkTriangles / 2;

}  // namespace

std::vector<ChunkPlan> plan_chunks(const synth::Scene& scene) {
  std::vector<ChunkPlan> chunks;
  for (uint32_t m = 0; m < scene.meshes.size(); ++m) {
    const synth::MeshRecipe& mesh = scene.meshes[m];
    const uint32_t faces = synth::face_count(mesh);
    const uint64_t quads_a_face = uint64_t{mesh.n} * mesh.n;
    if (quads_a_face <= kMaxQuads) {
      const uint32_t at_once = std::min(faces, static_cast<uint32_t>(kMaxQuads / quads_a_face));
      const uint32_t count = (faces + at_once - 1) / at_once;
      const uint32_t share = (faces + count - 1) / count;
      for (uint32_t face = 0; face < faces; face += share)
        chunks.push_back({m, face, std::min(share, faces - face), 0, mesh.n});
      continue;
    }
    const uint32_t unit = mesh.order == synth::MeshOrder::kBlock ? 8 : 1;  // rows that must stay together
    assert(mesh.n % unit == 0 && mesh.n * unit <= kMaxQuads);
    const uint32_t units = mesh.n / unit;
    const uint32_t most = kMaxQuads / (mesh.n * unit);
    const uint32_t count = (units + most - 1) / most;
    const uint32_t share = (units + count - 1) / count * unit;
    for (uint32_t face = 0; face < faces; ++face)
      for (uint32_t row = 0; row < mesh.n; row += share)
        chunks.push_back({m, face, 1, row, std::min(share, mesh.n - row)});
  }
  return chunks;
}

}  // namespace scree::lab
