// Makes generated scenes in the clustered encoding on the host, directly from the scene functions. The result equals
// that of `scree convert`.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "format/result.h"
#include "lab/scenes/scene_tables.h"

namespace scree::lab {

/// The tables of a scene and the payload of each of its chunks.
struct ClusteredScene {
  SceneTables tables;
  std::vector<std::vector<std::byte>> payloads;
};

/// Encodes the chunks of `tables` with `threads` threads. `tables`: from make_tables() for `plans` and lattice
/// positions. All payloads are in memory at once. Errors kMemory.
Result<ClusteredScene> encode_clustered(const synth::Scene& scene, std::span<const ChunkPlan> plans, SceneTables tables,
                                        uint32_t threads);

}  // namespace scree::lab
