// Makes generated scenes in device memory: the scene functions write the bytes of chunks directly.
#pragma once

#include <span>
#include <vector>

#include "format/result.h"
#include "lab/scenes/scene_tables.h"

namespace scree::lab {

/// The boxes of all chunks, made on the current device. Errors kDevice.
Result<std::vector<ChunkBox>> chunk_boxes_cuda(const synth::Scene& scene, std::span<const ChunkPlan> plans);

/// Makes the bytes of all chunks on the current device. `meshes`, `chunks`, `pages`: the tables' records and page
/// pointers, in device memory. The pages must be zeroed. Errors kDevice.
Result<void> fill_chunks_cuda(const synth::Scene& scene, std::span<const ChunkPlan> plans,
                              const format::MeshRecord* meshes, const format::ChunkRecord* chunks,
                              const std::byte* const* pages);

}  // namespace scree::lab
