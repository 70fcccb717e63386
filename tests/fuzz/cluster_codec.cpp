// The streams of a clustered chunk, and the reader that kernels use on accepted streams.
#include "format/geometry/cluster_codec.h"

#include <cmath>

#include "format/bytes.h"
#include "format/geometry/chunk_layout.h"
#include "format/geometry/cluster_read.h"
#include "tests/fuzz/input.h"

namespace scree::fuzz {
namespace {

/// Kernels check nothing, so from an accepted chunk they must read the same values as the decoder.
void read_as_kernels(const format::ClusterStreams& streams, std::span<const uint32_t> indices,
                     std::span<const uint32_t> offsets) {
  for (uint32_t c = 0; c < streams.cluster_count; ++c) {
    const auto record =
        format::load<format::ClusterRecord>(streams.clusters.data() + c * sizeof(format::ClusterRecord));
    const auto bounds =
        format::load<format::ClusterBounds>(streams.cluster_bounds.data() + c * sizeof(format::ClusterBounds));
    const format::ClusterReader reader = format::make_cluster_reader(record, bounds, streams.data.data());
    for (uint32_t t = 0; t < reader.layout.triangle_count; ++t) {
      uint32_t corner[3];
      reader.triangle(t, corner);
      for (size_t i = 0; i < 3; ++i)
        must(record.first_vertex + corner[i] == indices[3 * size_t{record.first_triangle + t} + i],
             "kernels read the decoder's triangles");
    }
    for (uint32_t v = 0; v < reader.layout.vertex_count; ++v) {
      uint32_t offset[3];
      reader.offset(v, offset);
      for (size_t i = 0; i < 3; ++i)
        must(offset[i] + streams.range.min[i] == offsets[3 * size_t{record.first_vertex + v} + i],
             "kernels read the decoder's vertices");
    }
  }
}

}  // namespace

void cluster_codec(Bytes bytes) {
  Parameters in(bytes);
  format::MeshRecord mesh{};
  format::ChunkRecord chunk{};
  chunk.encoding = format::ChunkEncoding::kClustered;
  chunk.triangle_count = in.take<uint16_t>();
  chunk.vertex_count = in.take<uint16_t>();
  chunk.cluster_count = in.take<uint8_t>();
  chunk.cluster_words = in.take<uint16_t>();
  mesh.lattice_exponent = in.take<int16_t>();
  for (int64_t& min : mesh.lattice_min) min = in.take<int64_t>();
  for (uint8_t& bits : mesh.lattice_bits) bits = in.take<uint8_t>();
  for (uint32_t& min : chunk.position_min) min = in.take<uint32_t>();
  for (uint8_t& bits : chunk.position_bits) bits = in.take<uint8_t>();
  // The records determine the length of the streams. Bytes missing in the input are zero.
  const ExactCopy payload(in.rest(), format::chunk_streams(mesh, chunk).bytes);
  const format::ClusterStreams streams = format::cluster_streams_of(mesh, chunk, payload.bytes());

  std::vector<uint32_t> indices(3 * size_t{chunk.triangle_count});
  std::vector<uint32_t> offsets(3 * size_t{chunk.vertex_count});
  std::vector<float> positions(offsets.size());
  const auto decoded = format::decode_clusters(streams, {indices, offsets, positions});
  must(bool(decoded) == bool(format::check_clusters(streams)), "decode and check of clusters agree");
  if (!decoded) return;
  for (const uint32_t index : indices) must(index < chunk.vertex_count, "an index is below the vertex count");
  for (const float value : positions) must(std::isfinite(value), "a position is finite");
  read_as_kernels(streams, indices, offsets);
}

}  // namespace scree::fuzz
