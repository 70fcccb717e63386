// Ends a chunk before the triangle with which its streams might exceed a page.
#pragma once

#include <bit>
#include <cstdint>

#include "format/bitpack.h"
#include "format/layout.h"
#include "tools/convert/encode/encode.h"
#include "tools/convert/windows/measure.h"

namespace scree::convert {

/// Upper bound of the bits of a vertex's attributes in any chunk of this mesh.
uint64_t attribute_bits_bound(const MeshPlan& mesh);

/// As above, including the vertex's position.
uint64_t vertex_bits_bound(const MeshPlan& mesh);

/// Upper bound of the bits of a triangle's source number, which is stored relative to the smallest one of its chunk.
uint32_t source_id_bits(const MeshPlan& mesh, const WindowPlan& plan);

class ChunkLimit {
 public:
  /// `most_triangles`: 0 means no limit, not even a page.
  ChunkLimit(const MeshPlan& mesh, const WindowPlan& plan, uint64_t most_triangles);

  /// Whether a chunk may have this many triangles and vertices.
  bool fits(uint64_t triangles, uint64_t vertices) const {
    if (most_triangles_ == 0) return true;
    if (triangles > most_triangles_) return false;
    const uint64_t index_bits = static_cast<uint64_t>(std::bit_width(vertices - 1));
    return triangles * (3 * index_bits + triangle_bits_) + vertices * vertex_bits_ <= budget_bits_;
  }

  /// As fits(), for a chunk of clusters with this many words of data.
  bool clusters_fit(uint64_t triangles, uint64_t vertices, uint64_t clusters, uint64_t words) const;

 private:
  // The budget leaves room for the slack of six streams and for rounding each up to 16 bytes.
  static constexpr uint64_t kBudgetBits = 8 * (format::kPageTargetBytes - 6 * (format::kPackedSlackBytes + 16));

  uint64_t most_triangles_;
  uint64_t vertex_bits_;
  uint64_t attribute_bits_;
  uint64_t triangle_bits_;
  uint64_t budget_bits_;
};

}  // namespace scree::convert
