// Computes the offsets of a chunk's streams in its payload, from the records only. Runs in kernels too. Source:
// spec/container.md, chunks.
#pragma once

#include <cstdint>

#include "format/bitpack.h"
#include "format/geometry/cluster_layout.h"
#include "format/hd.h"
#include "format/layout.h"

namespace scree::format {

/// One stream of a chunk. `offset`: bytes from the payload's first byte (ChunkRecord::offset), a multiple of
/// kChunkAlignment. `bytes`: also a multiple of kChunkAlignment; 0 if the chunk has no such stream or all its values
/// are equal (0 bits).
struct ChunkStream {
  uint64_t offset;
  uint64_t bytes;
};

/// The streams of a chunk in file order; each starts at the end of the one before.
struct ChunkStreams {
  ChunkStream indices;         // indexed
  ChunkStream positions;       // indexed
  ChunkStream group_bounds;    // clustered: ClusterBounds per kGroupClusters clusters
  ChunkStream cluster_bounds;  // clustered: ClusterBounds
  ChunkStream clusters;        // clustered: ClusterRecord
  ChunkStream cluster_data;    // clustered: cluster_words words and kPackedSlackBytes
  ChunkStream uvs;
  ChunkStream colors;
  ChunkStream normals;
  ChunkStream source_ids;
  ChunkStream second_uvs;  // SecondUvHeader, then the codes
  ChunkStream tangents;
  uint64_t bytes;  // of all streams; equals ChunkRecord::bytes in a valid file
};

/// The streams of `chunk`, a chunk of `mesh`. Defined for any records, valid or not: counts are 32-bit and widths
/// 8-bit, so the sum of all streams stays below 2^41 bytes. A stream whose values are all equal takes 0 bytes, so only
/// the mesh's attributes determine which streams a chunk has.
SCREE_HD constexpr ChunkStreams chunk_streams(const MeshRecord& mesh, const ChunkRecord& chunk) {
  const uint64_t triangles = chunk.triangle_count;
  const uint64_t vertices = chunk.vertex_count;
  ChunkStreams streams{};
  if (chunk.encoding == ChunkEncoding::kClustered) {
    const uint64_t clusters = chunk.cluster_count;
    streams.group_bounds.bytes = (clusters + kGroupClusters - 1) / kGroupClusters * sizeof(ClusterBounds);
    streams.cluster_bounds.offset = streams.group_bounds.bytes;
    streams.cluster_bounds.bytes = clusters * sizeof(ClusterBounds);
    streams.clusters.offset = streams.cluster_bounds.offset + streams.cluster_bounds.bytes;
    streams.clusters.bytes = clusters * sizeof(ClusterRecord);
    streams.cluster_data.offset = streams.clusters.offset + streams.clusters.bytes;
    streams.cluster_data.bytes = packed_bytes(chunk.cluster_words, 32);
    streams.uvs.offset = streams.cluster_data.offset + streams.cluster_data.bytes;
  } else {
    streams.indices.bytes = packed_bytes(3 * triangles, chunk.index_bits);
    streams.positions.offset = streams.indices.bytes;
    if (mesh.position_encoding == PositionEncoding::kFloat32) {
      streams.positions.bytes = (12 * vertices + kChunkAlignment - 1) & ~(kChunkAlignment - 1);
    } else {
      const uint32_t stride = uint32_t{chunk.position_bits[0]} + chunk.position_bits[1] + chunk.position_bits[2];
      streams.positions.bytes = packed_bytes(vertices, stride);
    }
    streams.uvs.offset = streams.positions.offset + streams.positions.bytes;
  }
  if (mesh.attributes & kHasUv) {
    streams.uvs.bytes = packed_bytes(vertices, uint32_t{chunk.uv_bits[0]} + chunk.uv_bits[1]);
  }

  streams.colors.offset = streams.uvs.offset + streams.uvs.bytes;
  if (mesh.attributes & kHasColor) {
    streams.colors.bytes = (4 * vertices + kChunkAlignment - 1) & ~(kChunkAlignment - 1);
  }

  streams.normals.offset = streams.colors.offset + streams.colors.bytes;
  if (mesh.attributes & kHasNormal) {
    streams.normals.bytes = packed_bytes(vertices, 2 * uint32_t{chunk.normal_bits});
  }

  streams.source_ids.offset = streams.normals.offset + streams.normals.bytes;
  if (mesh.attributes & kHasSourceIds) {
    streams.source_ids.bytes = packed_bytes(triangles, chunk.source_bits);
  }

  streams.second_uvs.offset = streams.source_ids.offset + streams.source_ids.bytes;
  if (mesh.attributes & kHasSecondUv) {
    streams.second_uvs.bytes =
        sizeof(SecondUvHeader) + packed_bytes(vertices, uint32_t{chunk.second_uv_bits[0]} + chunk.second_uv_bits[1]);
  }

  streams.tangents.offset = streams.second_uvs.offset + streams.second_uvs.bytes;
  if (mesh.attributes & kHasTangent) {
    streams.tangents.bytes = packed_bytes(vertices, chunk.tangent_bits);
  }

  streams.bytes = streams.tangents.offset + streams.tangents.bytes;
  return streams;
}

}  // namespace scree::format
