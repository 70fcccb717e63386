// The chunks that lab/scenes/generate.h makes on a GPU, made on the host.
#pragma once

#include <algorithm>
#include <cassert>
#include <cmath>
#include <span>
#include <vector>

#include "lab/scenes/chunk_fill.h"
#include "lab/scenes/scene_tables.h"

namespace scree::tests {

using namespace lab;

/// The boxes of all chunks.
inline std::vector<ChunkBox> chunk_boxes(const synth::Scene& scene, std::span<const ChunkPlan> plans) {
  std::vector<ChunkBox> boxes;
  for (const ChunkPlan& plan : plans) {
    const synth::MeshRecipe& recipe = scene.meshes[plan.mesh];
    ChunkBox box{{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
    for (uint32_t vertex = 0; vertex < chunk_vertices(recipe, plan); ++vertex) {
      const synth::Float3 p = chunk_position(recipe, plan, vertex);
      const float parts[3] = {p.x, p.y, p.z};
      for (int axis = 0; axis < 3; ++axis) {
        box.lo[axis] = std::min(box.lo[axis], parts[axis]);
        box.hi[axis] = std::max(box.hi[axis], parts[axis]);
      }
    }
    boxes.push_back(box);
  }
  return boxes;
}

/// Makes the bytes of all chunks. `arena`: arena_bytes, aligned to 16 bytes and zeroed.
inline void fill_chunks(const synth::Scene& scene, std::span<const ChunkPlan> plans, const SceneTables& tables,
                        std::span<std::byte> arena) {
  assert(arena.size() >= tables.arena_bytes);
  for (size_t i = 0; i < plans.size(); ++i) {
    const format::ChunkRecord& chunk = tables.chunks[i];
    const synth::MeshRecipe& recipe = scene.meshes[plans[i].mesh];
    std::byte* const payload = arena.data() + tables.page_offset[chunk.page] + chunk.offset;
    for (uint32_t group = 0; group < quad_groups(chunk); ++group) fill_indices(recipe, plans[i], chunk, group, payload);
    for (uint32_t group = 0; group < vertex_groups(chunk); ++group)
      fill_positions(recipe, plans[i], tables.meshes[plans[i].mesh], chunk, group, payload);
  }
}

}  // namespace scree::tests
