#include "tools/convert/encode/chunk_limit.h"

#include <bit>

#include "format/geometry/cluster_codec.h"
#include "format/layout.h"

namespace scree::convert {
namespace {

constexpr uint64_t kFloatBits = 96;  // of a position

/// Bytes that the streams of major version 2 (second texture coordinates, tangents) take beside their codes.
uint64_t second_bytes(const MeshPlan& mesh) {
  constexpr uint64_t kStream = format::kPackedSlackBytes + 16;
  return (mesh.attributes & format::kHasSecondUv ? kStream + sizeof(format::SecondUvHeader) : 0) +
         (mesh.attributes & format::kHasTangent ? kStream : 0);
}

}  // namespace

uint64_t attribute_bits_bound(const MeshPlan& mesh) {
  uint64_t bits = 0;
  if (mesh.attributes & format::kHasUv) bits += 2 * format::kMaxUvBits;
  if (mesh.attributes & format::kHasColor) bits += 32;
  if (mesh.attributes & format::kHasNormal) bits += 2 * kNormalBits;
  if (mesh.attributes & format::kHasSecondUv) bits += 2 * format::kMaxUvBits;
  if (mesh.attributes & format::kHasTangent) bits += kTangentBits;
  return bits;
}

uint64_t vertex_bits_bound(const MeshPlan& mesh) {
  const format::MeshLattice& lattice = mesh.lattice;
  return attribute_bits_bound(mesh) +
         (mesh.float32 ? kFloatBits : uint64_t{lattice.bits[0]} + lattice.bits[1] + lattice.bits[2]);
}

uint32_t source_id_bits(const MeshPlan& mesh, const WindowPlan& plan) {
  if (!(mesh.attributes & format::kHasSourceIds)) return 0;
  return static_cast<uint32_t>(std::bit_width((mesh.sorted_triangles > 0 ? mesh.sorted_triangles : plan.count) - 1));
}

ChunkLimit::ChunkLimit(const MeshPlan& mesh, const WindowPlan& plan, uint64_t most_triangles)
    : most_triangles_(most_triangles),
      vertex_bits_(mesh.chunks_as_float32 ? attribute_bits_bound(mesh) + kFloatBits : vertex_bits_bound(mesh)),
      attribute_bits_(attribute_bits_bound(mesh)),
      triangle_bits_(source_id_bits(mesh, plan)),
      budget_bits_(kBudgetBits - 8 * second_bytes(mesh)) {}

bool ChunkLimit::clusters_fit(uint64_t triangles, uint64_t vertices, uint64_t clusters, uint64_t words) const {
  if (words > format::kMaxClusterWords || vertices >= format::kNone) return false;
  if (most_triangles_ == 0) return true;
  if (triangles > most_triangles_) return false;
  return 8 * format::cluster_stream_bytes(clusters, words) + triangles * triangle_bits_ + vertices * attribute_bits_ <=
         budget_bits_;
}

}  // namespace scree::convert
