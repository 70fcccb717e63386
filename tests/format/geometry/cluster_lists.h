// Lists of triangles, and the clustered chunks made of them, for tests.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <random>
#include <vector>

#include "format/geometry/chunk_layout.h"
#include "format/geometry/cluster_codec.h"
#include "tests/catch.h"
#include "tests/format/geometry/guarded_bytes.h"
#include "tools/clusters/cluster_builder.h"

namespace scree::tests {

/// Triangles over lattice offsets.
struct List {
  std::vector<uint32_t> indices, offsets;

  uint32_t vertex_count() const { return static_cast<uint32_t>(offsets.size() / 3); }
  uint32_t add(uint32_t x, uint32_t y, uint32_t z) {
    offsets.insert(offsets.end(), {x, y, z});
    return vertex_count() - 1;
  }
  void triangle(uint32_t a, uint32_t b, uint32_t c) { indices.insert(indices.end(), {a, b, c}); }
};

/// A chunk made from a list, alone in its mesh.
struct ClusteredChunk {
  format::MeshRecord mesh{};
  format::ChunkRecord record{};
  std::vector<std::byte> payload;
  format::ClusterSet set;

  format::ClusterStreams streams(std::span<const std::byte> bytes) const {
    return format::cluster_streams_of(mesh, record, bytes);
  }
};

inline ClusteredChunk encode(const List& list, tools::ClusterEffort effort = tools::ClusterEffort::kFast,
                             uint32_t lattice_bits = 24) {
  ClusteredChunk chunk;
  for (uint8_t& bits : chunk.mesh.lattice_bits) bits = static_cast<uint8_t>(lattice_bits);
  chunk.mesh.lattice_min[1] = -12345;
  chunk.mesh.lattice_exponent = -7;
  chunk.set = tools::ClusterBuilder().build(list.indices, list.offsets, effort);
  const format::ClusterRun run{0, chunk.set.clusters.size(), 0};
  format::describe_clusters(chunk.set, run, chunk.record);
  chunk.payload.resize(format::cluster_stream_bytes(chunk.record.cluster_count, chunk.record.cluster_words));
  REQUIRE(chunk.payload.size() == format::chunk_streams(chunk.mesh, chunk.record).bytes);
  GuardedBytes guarded(chunk.payload.size());
  std::fill(guarded.bytes().begin(), guarded.bytes().end(), std::byte{0xaa});  // the writer must clear unused bytes
  format::write_clusters(guarded.bytes(), chunk.set, run, chunk.record);
  chunk.payload.assign(guarded.bytes().begin(), guarded.bytes().end());
  return chunk;
}

/// A height field of n x n quads, with triangles row by row.
inline List grid_list(uint32_t n, uint32_t step, uint32_t slope) {
  List list;
  for (uint32_t y = 0; y <= n; ++y)
    for (uint32_t x = 0; x <= n; ++x) list.add(x * step, y * step, 1000 + slope * x + (x * y * 7) % 5);
  for (uint32_t y = 0; y < n; ++y) {
    for (uint32_t x = 0; x < n; ++x) {
      const uint32_t a = y * (n + 1) + x;
      list.triangle(a, a + 1, a + n + 2);
      list.triangle(a, a + n + 2, a + n + 1);
    }
  }
  return list;
}

/// Triangles between random vertices.
inline List soup(std::mt19937& random, uint32_t triangles, uint32_t vertices, uint32_t bits) {
  List list;
  for (uint32_t v = 0; v < vertices; ++v) {
    uint32_t c[3];
    for (uint32_t& value : c) value = bits == 0 ? 0 : static_cast<uint32_t>(random()) >> (32 - bits);
    list.add(c[0], c[1], c[2]);
  }
  const auto any = [&] { return static_cast<uint32_t>(random() % vertices); };
  for (uint32_t t = 0; t < triangles; ++t) list.triangle(any(), any(), any());
  return list;
}

}  // namespace scree::tests
