// The records of a generated scene, as a .scree file of it would hold them, and where its chunks lie in memory.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "format/layout.h"
#include "format/result.h"
#include "kernels/scene_view.h"
#include "lab/scenes/chunk_plan.h"

namespace scree::lab {

/// How vertices and indices are stored.
struct Encoding {
  bool float32 = false;
  uint32_t position_bits = 16;  // an axis, of the mesh's lattice; 1 to format::kMaxPositionBits
  bool packed_indices = true;   // false: 32 bits each
  bool clustered = false;       // of lattice positions: clusters, which have indices of their own
};

/// "16-bit, packed", "16-bit, clustered" or "float32, 32-bit": positions, then indices.
std::string encoding_name(const Encoding& encoding);

/// The box of a chunk's vertices.
struct ChunkBox {
  float lo[3];
  float hi[3];
};

/// One scene as tables on the host. Pages lie in one arena, each format::kPageAlignment-aligned.
struct SceneTables {
  std::vector<format::MeshRecord> meshes;
  std::vector<format::ChunkRecord> chunks;
  std::vector<format::InstanceRecord> instances;
  std::vector<uint64_t> instance_base;
  std::vector<format::MatrixRecord> matrices;
  std::vector<ChunkBox> boxes;        // of the chunks
  std::vector<uint64_t> page_offset;  // bytes in the arena
  uint64_t arena_bytes = 0;
  uint64_t geometry_bytes = 0;  // of the chunks: indices and positions, or clusters

  /// The pointers of `pages` to fill for an arena at `base`.
  std::vector<const std::byte*> page_pointers(const std::byte* base) const;
  /// `pages`: as page_pointers() gives them; null: only the records can be read.
  kernels::SceneView view(const std::byte* const* pages) const;
};

/// The tables of a scene cut as `plans` say; `boxes`: one a chunk. Each mesh gets the finest lattice of the encoding's
/// bits over its own box, as `scree convert` gives it. Errors kRange: a mesh's box needs more than 24 bits.
Result<SceneTables> make_tables(const synth::Scene& scene, std::span<const ChunkPlan> plans,
                                std::span<const ChunkBox> boxes, const Encoding& encoding);

/// Gives the chunks, whose `bytes` have changed, their places anew, and counts the meshes' vertices.
void place_chunks(SceneTables& tables);

/// What a chunk takes for indices and positions.
uint64_t geometry_bytes(const format::MeshRecord& mesh, const format::ChunkRecord& chunk);

/// The boxes, and then the bytes of all chunks, made on the host: for small scenes and tests. `arena`: arena_bytes,
/// 16-byte aligned, zeroed.
std::vector<ChunkBox> chunk_boxes(const synth::Scene& scene, std::span<const ChunkPlan> plans);
void fill_chunks(const synth::Scene& scene, std::span<const ChunkPlan> plans, const SceneTables& tables,
                 std::span<std::byte> arena);

}  // namespace scree::lab
