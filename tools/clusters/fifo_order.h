// An order of triangles in which neighbours come together, for caches of vertices and for clusters of consecutive
// triangles. Source: Sander, Nehab and Barczak, "Fast Triangle Reordering for Vertex Locality and Reduced Overdraw",
// 2007.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

namespace scree::tools {

/// Orders one list after the other and keeps its memory; one a thread.
class FifoOrder {
 public:
  /// The numbers of all triangles in their new order, valid until the next call. `indices`: 3 a triangle, fewer than
  /// 2^32, each below vertex_count. The order is that of meshoptimizer's meshopt_optimizeVertexCacheFifo() with 16
  /// entries, equal triangles in that of the list. Memory: 29 bytes a triangle and 12 a vertex.
  std::span<const uint32_t> run(std::span<const uint32_t> indices, uint32_t vertex_count);

 private:
  struct Vertex {
    uint32_t first = 0;  // of its triangles in at_vertex_
    uint32_t left = 0;   // its corners in triangles that are left
    uint32_t time = 0;   // when it came into the cache
  };

  void make_room(size_t triangles);
  void list_triangles(std::span<const uint32_t> indices, uint32_t vertex_count);
  void take_around(std::span<const uint32_t> indices, uint32_t center);
  uint32_t next_center(size_t first_seen);

  std::vector<Vertex> vertices_;   // and one more, where the last one's triangles end
  std::vector<uint8_t> is_taken_;  // of each triangle
  // Not vectors, which would write all of it first: what is seen at a time is little of what might be.
  size_t room_ = 0;                        // triangles that there is memory for
  std::unique_ptr<uint32_t[]> at_vertex_;  // triangles, once for each corner there
  std::unique_ptr<uint32_t[]> order_;      // and one more
  std::unique_ptr<uint32_t[]> seen_;       // vertices of triangles that were taken, to go on from; and one more
  size_t taken_count_ = 0;
  size_t seen_count_ = 0;
  uint32_t time_ = 0;
  uint32_t first_left_ = 0;  // no vertex before it has triangles left
};

}  // namespace scree::tools
