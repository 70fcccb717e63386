// The measured scenes cut into chunks, with a closed formula for every vertex and index of a chunk, so that a GPU can
// make a chunk with all its threads. For host and device, so that the tests run the same functions.
#pragma once

#include <cstdint>
#include <vector>

#include "format/hd.h"
#include "format/layout.h"
#include "tools/synth/scene_functions.h"
#include "tools/synth/scenes.h"

namespace scree::lab {

/// Whole faces of a mesh, or some rows of quads of one face. Its triangles are consecutive in the scene's order, and
/// its vertices form one grid per face. In block order the number of rows is a multiple of eight.
struct ChunkPlan {
  uint32_t mesh;
  uint32_t first_face;
  uint32_t face_count;
  uint32_t first_row;  // of quads
  uint32_t row_count;
};

SCREE_HD inline uint32_t chunk_quads(const synth::MeshRecipe& mesh, const ChunkPlan& chunk) {
  return chunk.face_count * chunk.row_count * mesh.n;
}
SCREE_HD inline uint32_t chunk_vertices(const synth::MeshRecipe& mesh, const ChunkPlan& chunk) {
  return chunk.face_count * (chunk.row_count + 1) * (mesh.n + 1);
}
SCREE_HD inline uint64_t chunk_first_quad(const synth::MeshRecipe& mesh, const ChunkPlan& chunk) {
  return (uint64_t{chunk.first_face} * mesh.n + chunk.first_row) * mesh.n;
}

/// A point of a mesh's grids.
struct GridPoint {
  uint32_t face;
  uint32_t x;
  uint32_t y;
};

/// The number of a grid point in the chunk. Row order: row by row. Block order: the blocks' vertices, then the row
/// above the last block, then the last column.
SCREE_HD inline uint32_t chunk_vertex_number(const synth::MeshRecipe& mesh, const ChunkPlan& chunk, GridPoint at) {
  const uint32_t n = mesh.n;
  const uint32_t rows = chunk.row_count;
  const uint32_t y = at.y - chunk.first_row;
  const uint32_t base = (at.face - chunk.first_face) * (rows + 1) * (n + 1);
  if (mesh.order == synth::MeshOrder::kRow) return base + y * (n + 1) + at.x;
  if (at.x == n) return base + rows * n + n + y;
  if (y == rows) return base + rows * n + at.x;
  return base + ((y >> 3) * (n >> 3) + (at.x >> 3)) * 64u + (y & 7u) * 8u + (at.x & 7u);
}

/// The inverse: the grid point of vertex `number` (< chunk_vertices) of the chunk.
SCREE_HD inline GridPoint chunk_vertex(const synth::MeshRecipe& mesh, const ChunkPlan& chunk, uint32_t number) {
  const uint32_t n = mesh.n;
  const uint32_t rows = chunk.row_count;
  const uint32_t per_face = (rows + 1) * (n + 1);
  const uint32_t face = number / per_face;
  const uint32_t rest = number - face * per_face;
  GridPoint at{chunk.first_face + face, 0, 0};
  if (mesh.order == synth::MeshOrder::kRow) {
    at.x = rest % (n + 1);
    at.y = rest / (n + 1);
  } else if (rest < rows * n) {
    const uint32_t block = rest >> 6;
    at.x = (block % (n >> 3)) * 8u + (rest & 7u);
    at.y = (block / (n >> 3)) * 8u + ((rest >> 3) & 7u);
  } else if (rest < rows * n + n) {
    at.x = rest - rows * n;
    at.y = rows;
  } else {
    at.x = n;
    at.y = rest - (rows * n + n);
  }
  at.y += chunk.first_row;
  return at;
}

/// The position of vertex `number` of the chunk, equal bit for bit to that in the scene.
SCREE_HD inline synth::Float3 chunk_position(const synth::MeshRecipe& mesh, const ChunkPlan& chunk, uint32_t number) {
  const GridPoint at = chunk_vertex(mesh, chunk, number);
  const synth::Double3 p = synth::surface_position(mesh, at.face, static_cast<int>(at.x), static_cast<int>(at.y));
  return {static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z)};
}

/// The six vertex numbers, in the chunk, of quad `quad` (< chunk_quads), in the order of synth::quad_indices.
SCREE_HD inline void chunk_quad_indices(const synth::MeshRecipe& mesh, const ChunkPlan& chunk, uint32_t quad,
                                        uint32_t out[6]) {
  const uint32_t n = mesh.n;
  const uint32_t per_face = chunk.row_count * n;
  const uint32_t face = quad / per_face;
  const uint32_t q = quad - face * per_face;
  GridPoint at{chunk.first_face + face, q % n, q / n};
  if (mesh.order == synth::MeshOrder::kBlock) {
    const uint32_t block = q >> 6;
    at.x = (block % (n >> 3)) * 8u + (q & 7u);
    at.y = (block / (n >> 3)) * 8u + ((q >> 3) & 7u);
  }
  at.y += chunk.first_row;
  const uint32_t corner00 = chunk_vertex_number(mesh, chunk, at);
  const uint32_t corner10 = chunk_vertex_number(mesh, chunk, {at.face, at.x + 1, at.y});
  const uint32_t corner11 = chunk_vertex_number(mesh, chunk, {at.face, at.x + 1, at.y + 1});
  const uint32_t corner01 = chunk_vertex_number(mesh, chunk, {at.face, at.x, at.y + 1});
  out[0] = corner00;
  out[1] = corner10;
  out[2] = corner11;
  out[3] = corner00;
  out[4] = corner11;
  out[5] = corner01;
}

/// The chunks of a scene, mesh by mesh, of at most format::kMaxChunkTriangles triangles: as many whole faces as fit, or
/// equal shares of a face's rows.
std::vector<ChunkPlan> plan_chunks(const synth::Scene& scene);

}  // namespace scree::lab
