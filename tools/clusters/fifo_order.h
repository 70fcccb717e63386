// An order of triangles in which neighbours are close together, for vertex caches and for clusters of consecutive
// triangles. Source: Sander, Nehab and Barczak, "Fast Triangle Reordering for Vertex Locality and Reduced Overdraw",
// 2007.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

namespace scree::tools {

/// Orders one list after another and keeps its memory; use one per thread.
class FifoOrder {
 public:
  /// The numbers of all triangles in their new order, valid until the next call. `indices`: 3 per triangle, fewer than
  /// 2^32, each below vertex_count. The order equals that of meshoptimizer's meshopt_optimizeVertexCacheFifo() with 16
  /// entries; equal triangles keep the order of the list. Memory: 29 bytes per triangle and 12 per vertex.
  std::span<const uint32_t> run(std::span<const uint32_t> indices, uint32_t vertex_count);

 private:
  struct Vertex {
    uint32_t first = 0;  // index of its first triangle in at_vertex_
    uint32_t left = 0;   // its corners in remaining triangles
    uint32_t time = 0;   // when it entered the cache
  };

  void make_room(size_t triangles);
  void list_triangles(std::span<const uint32_t> indices, uint32_t vertex_count);
  void take_around(std::span<const uint32_t> indices, uint32_t center);
  uint32_t next_center(size_t first_seen);

  std::vector<Vertex> vertices_;   // an extra entry marks the end of the last vertex's triangles
  std::vector<uint8_t> is_taken_;  // by triangle
  // These are not vectors, because vectors would initialise all memory, although only a small part of it is used at a
  // time.
  size_t room_ = 0;                        // triangles that the memory has room for
  std::unique_ptr<uint32_t[]> at_vertex_;  // triangles, once per corner there
  std::unique_ptr<uint32_t[]> order_;      // with one extra entry
  std::unique_ptr<uint32_t[]> seen_;       // vertices of taken triangles, to continue from; with one extra entry
  size_t taken_count_ = 0;
  size_t seen_count_ = 0;
  uint32_t time_ = 0;
  uint32_t first_left_ = 0;  // all vertices before it have no triangles left
};

}  // namespace scree::tools
