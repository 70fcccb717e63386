// The kernels behind generate.h. Every pointer refers to device memory. The calls do not wait for the kernels.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <cstdint>

#include "lab/scenes/chunk_plan.h"
#include "lab/scenes/scene_tables.h"

namespace scree::lab {

/// boxes[i]: the box of chunk i's vertices.
cudaError_t launch_chunk_boxes(const synth::MeshRecipe* recipes, const ChunkPlan* plans, uint32_t count,
                               ChunkBox* boxes);

/// Fills the payloads of chunks 0 to count - 1.
cudaError_t launch_fill_chunks(const synth::MeshRecipe* recipes, const ChunkPlan* plans, uint32_t count,
                               const format::MeshRecord* meshes, const format::ChunkRecord* chunks,
                               const std::byte* const* pages);

}  // namespace scree::lab
