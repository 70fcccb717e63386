// Writes the bytes of a generated chunk, in groups that share no 32-bit word, so that each thread can write a group.
// For host and device. Source: spec/codecs.md, indices and positions.
#pragma once

#include "format/geometry/chunk_layout.h"
#include "format/geometry/quantize.h"
#include "lab/scenes/chunk_plan.h"

namespace scree::lab {

/// 32 values of b bits fill b whole words.
inline constexpr uint32_t kVerticesPerGroup = 32;
inline constexpr uint32_t kQuadsPerGroup = 16;  // 96 indices

SCREE_HD inline uint32_t vertex_groups(const format::ChunkRecord& chunk) {
  return (chunk.vertex_count + kVerticesPerGroup - 1) / kVerticesPerGroup;
}
SCREE_HD inline uint32_t quad_groups(const format::ChunkRecord& chunk) {
  return (chunk.triangle_count / 2 + kQuadsPerGroup - 1) / kQuadsPerGroup;
}

/// Packs values, beginning at the start of a word.
class WordPacker {
 public:
  SCREE_HD explicit WordPacker(uint32_t* out) : out_(out) {}

  /// `value` < 2^bits, bits 0 to 32.
  SCREE_HD void put(uint32_t value, uint32_t bits) {
    window_ |= static_cast<uint64_t>(value) << fill_;
    fill_ += bits;
    if (fill_ >= 32) {
      *out_++ = static_cast<uint32_t>(window_);
      window_ >>= 32;
      fill_ -= 32;
    }
  }
  /// Writes the last word: the last group of a stream may end within a word.
  SCREE_HD void finish() {
    if (fill_ != 0) *out_ = static_cast<uint32_t>(window_);
  }

 private:
  uint32_t* out_;
  uint64_t window_ = 0;
  uint32_t fill_ = 0;  // below 32 between calls
};

/// Writes the indices of the group's quads, from quad kQuadsPerGroup * group on. `payload`: of the chunk; must be
/// zeroed before.
SCREE_HD inline void fill_indices(const synth::MeshRecipe& recipe, const ChunkPlan& plan,
                                  const format::ChunkRecord& chunk, uint32_t group, std::byte* payload) {
  if (chunk.index_bits == 0) return;
  const uint32_t quads = chunk.triangle_count / 2;
  const uint32_t first = group * kQuadsPerGroup;
  const uint32_t end = quads - first < kQuadsPerGroup ? quads : first + kQuadsPerGroup;
  WordPacker packer(reinterpret_cast<uint32_t*>(payload) + uint64_t{group} * 3 * chunk.index_bits);
  for (uint32_t quad = first; quad < end; ++quad) {
    uint32_t indices[6];
    chunk_quad_indices(recipe, plan, quad, indices);
    for (int i = 0; i < 6; ++i) packer.put(indices[i] - chunk.index_min, chunk.index_bits);
  }
  packer.finish();
}

/// Writes the group's vertices, from vertex kVerticesPerGroup * group on. `payload`: as above.
SCREE_HD inline void fill_positions(const synth::MeshRecipe& recipe, const ChunkPlan& plan,
                                    const format::MeshRecord& mesh, const format::ChunkRecord& chunk, uint32_t group,
                                    std::byte* payload) {
  std::byte* stream = payload + format::chunk_streams(mesh, chunk).positions.offset;
  const uint32_t first = group * kVerticesPerGroup;
  const uint32_t end = chunk.vertex_count - first < kVerticesPerGroup ? chunk.vertex_count : first + kVerticesPerGroup;
  if (mesh.position_encoding == format::PositionEncoding::kFloat32) {
    float* floats = reinterpret_cast<float*>(stream) + uint64_t{first} * 3;
    for (uint32_t vertex = first; vertex < end; ++vertex) {
      const synth::Float3 p = chunk_position(recipe, plan, vertex);
      *floats++ = p.x;
      *floats++ = p.y;
      *floats++ = p.z;
    }
    return;
  }
  const uint32_t stride = uint32_t{chunk.position_bits[0]} + chunk.position_bits[1] + chunk.position_bits[2];
  if (stride == 0) return;
  WordPacker packer(reinterpret_cast<uint32_t*>(stream) + uint64_t{group} * stride);
  for (uint32_t vertex = first; vertex < end; ++vertex) {
    const synth::Float3 p = chunk_position(recipe, plan, vertex);
    const float parts[3] = {p.x, p.y, p.z};
    for (int axis = 0; axis < 3; ++axis) {
      const int64_t offset = format::quantize(parts[axis], mesh.lattice_exponent) - mesh.lattice_min[axis];
      packer.put(static_cast<uint32_t>(offset) - chunk.position_min[axis], chunk.position_bits[axis]);
    }
  }
  packer.finish();
}

}  // namespace scree::lab
