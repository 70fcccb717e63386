// The records of a generated scene, as in its .scree file, and the offsets of its chunks in memory.
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
  uint32_t position_bits = 16;  // per axis of the mesh's lattice; 1 to format::kMaxPositionBits
  bool packed_indices = true;   // false: 32 bits each
  bool clustered = false;       // clusters of lattice positions, which include their indices
};

/// "16-bit, packed", "16-bit, clustered" or "float32, 32-bit": positions, then indices.
std::string encoding_name(const Encoding& encoding);

/// The box of a chunk's vertices.
struct ChunkBox {
  float lo[3];
  float hi[3];
};

/// A scene as tables on the host. All pages are in one arena, each aligned to format::kPageAlignment.
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

  /// The page pointers of an arena that begins at `base`.
  std::vector<const std::byte*> page_pointers(const std::byte* base) const;
  /// `pages`: from page_pointers(). Null: only the records can be read.
  kernels::SceneView view(const std::byte* const* pages) const;
};

/// An instance's matrix as a record.
format::MatrixRecord matrix_record(const synth::SceneInstance& instance);

/// The tables of a scene cut into `plans`. `boxes`: one per chunk. Each mesh gets the finest lattice for its box with
/// the encoding's bits, as in `scree convert`. Errors kRange: a mesh's box needs more than 24 bits.
Result<SceneTables> make_tables(const synth::Scene& scene, std::span<const ChunkPlan> plans,
                                std::span<const ChunkBox> boxes, const Encoding& encoding);

/// Assigns pages and offsets to the chunks again after their `bytes` have changed, and counts the meshes' vertices.
void place_chunks(SceneTables& tables);

/// A chunk's bytes of indices and positions.
uint64_t geometry_bytes(const format::MeshRecord& mesh, const format::ChunkRecord& chunk);

}  // namespace scree::lab
