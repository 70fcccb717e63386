#include "tools/common/chunk_decode.h"

#include <unistd.h>

#include <new>

#include "format/bytes.h"
#include "format/geometry/attribute_codec.h"
#include "format/geometry/chunk_layout.h"
#include "format/geometry/cluster_codec.h"
#include "format/geometry/index_codec.h"
#include "format/geometry/position_codec.h"
#include "format/geometry/tangent_codec.h"
#include "runtime/scene/pages.h"

namespace scree::tools {
namespace {

using format::ChunkRecord;
using format::MeshRecord;

/// Half of the machine's memory. A stream of 0 bits takes no bytes, so a chunk record of a few bytes can state 2^32
/// vertices. Sizes that no machine could hold are refused before anything is allocated.
uint64_t memory_limit() {
  static const uint64_t limit = [] {
    const long pages = sysconf(_SC_PHYS_PAGES), page_bytes = sysconf(_SC_PAGESIZE);
    if (pages <= 0 || page_bytes <= 0) return uint64_t{1} << 36;
    return static_cast<uint64_t>(pages) * static_cast<uint64_t>(page_bytes) / 2;
  }();
  return limit;
}

uint64_t decoded_bytes(const MeshRecord& mesh, const ChunkRecord& chunk, uint32_t parts) {
  const uint64_t vertices = chunk.vertex_count, triangles = chunk.triangle_count;
  uint64_t bytes = 0;
  if (parts & kPartIndices) bytes += 12 * triangles;
  if (parts & kPartPositions) bytes += 12 * vertices;
  if ((parts & kPartUvs) && (mesh.attributes & format::kHasUv)) bytes += 8 * vertices;
  if ((parts & kPartColors) && (mesh.attributes & format::kHasColor)) bytes += 16 * vertices;
  if ((parts & kPartNormals) && (mesh.attributes & format::kHasNormal)) bytes += 12 * vertices;
  if ((parts & kPartSourceIds) && (mesh.attributes & format::kHasSourceIds)) bytes += 8 * triangles;
  if ((parts & kPartSecondUvs) && (mesh.attributes & format::kHasSecondUv)) bytes += 8 * vertices;
  if ((parts & kPartTangents) && (mesh.attributes & format::kHasTangent)) bytes += 16 * vertices;
  return bytes;
}

/// Resizes `values`, and frees memory left over from a much larger earlier chunk.
template <class T>
void set_size(std::vector<T>& values, uint64_t size) {
  if (values.capacity() > 4 * size + (uint64_t{1} << 20)) std::vector<T>().swap(values);
  values.resize(size);
}

}  // namespace

Result<void> decode_chunk(const format::Container& file, uint64_t chunk, std::span<const std::byte> page,
                          uint32_t parts, DecodedChunk& out) {
  const ChunkRecord& record = file.chunks()[chunk];
  const MeshRecord& mesh = file.meshes()[record.mesh];
  const auto place = [&](const char* stream) { return runtime::chunk_place(file, chunk) + ": " + stream; };

  const format::ChunkStreams streams = format::chunk_streams(mesh, record);
  if (record.bytes != streams.bytes || !format::range_within(record.offset, record.bytes, page.size())) {
    return Error{ErrorCode::kRange, runtime::chunk_place(file, chunk) + ": takes " + std::to_string(record.bytes) +
                                        " bytes, but its streams take " + std::to_string(streams.bytes) +
                                        " and the page has " + std::to_string(page.size())};
  }
  const uint64_t needed = decoded_bytes(mesh, record, parts);
  if (needed > memory_limit()) {
    return Error{ErrorCode::kMemory, runtime::chunk_place(file, chunk) + ": decodes to " + std::to_string(needed) +
                                         " bytes, more than half of this machine's memory"};
  }
  const uint64_t vertices = record.vertex_count, triangles = record.triangle_count;
  const auto wanted = [&](uint32_t part, uint32_t flag) { return (parts & part) && (mesh.attributes & flag); };
  try {
    set_size(out.indices, parts & kPartIndices ? 3 * triangles : 0);
    set_size(out.positions, parts & kPartPositions ? 3 * vertices : 0);
    set_size(out.uvs, wanted(kPartUvs, format::kHasUv) ? 2 * vertices : 0);
    set_size(out.colors, wanted(kPartColors, format::kHasColor) ? 4 * vertices : 0);
    set_size(out.normals, wanted(kPartNormals, format::kHasNormal) ? 3 * vertices : 0);
    set_size(out.source_ids, wanted(kPartSourceIds, format::kHasSourceIds) ? triangles : 0);
    set_size(out.second_uvs, wanted(kPartSecondUvs, format::kHasSecondUv) ? 2 * vertices : 0);
    set_size(out.tangents, wanted(kPartTangents, format::kHasTangent) && !out.normals.empty() ? 4 * vertices : 0);
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::kMemory,
                 runtime::chunk_place(file, chunk) + ": no memory for its " + std::to_string(needed) + " bytes"};
  }

  const std::span<const std::byte> payload = page.subspan(record.offset, record.bytes);
  const auto bytes_of = [&](const format::ChunkStream& stream) { return payload.subspan(stream.offset, stream.bytes); };
  if (record.encoding == format::ChunkEncoding::kClustered) {
    if (parts & (kPartIndices | kPartPositions)) {
      SCREE_TRY_AT(place("clusters"), format::decode_clusters(format::cluster_streams_of(mesh, record, payload),
                                                              {out.indices, {}, out.positions}));
    }
    parts &= ~uint32_t{kPartIndices | kPartPositions};
  }
  if (parts & kPartIndices) {
    const format::IndexRange range{record.index_min, record.index_bits};
    SCREE_TRY_AT(place("indices"),
                 format::decode_indices(out.indices, record.vertex_count, range, bytes_of(streams.indices)));
  }
  if (parts & kPartPositions) {
    SCREE_TRY_AT(place("positions"),
                 format::decode_positions(out.positions, format::lattice_of(mesh), format::position_range_of(record),
                                          bytes_of(streams.positions)));
  }
  if (!out.uvs.empty()) {
    const format::UvRange range{
        record.uv_exponent, {record.uv_min[0], record.uv_min[1]}, {record.uv_bits[0], record.uv_bits[1]}};
    SCREE_TRY_AT(place("texture coordinates"), format::decode_uvs(out.uvs, range, bytes_of(streams.uvs)));
  }
  if (!out.colors.empty()) {
    SCREE_TRY_AT(place("colours"), format::decode_colors(out.colors, bytes_of(streams.colors)));
  }
  if (!out.normals.empty()) {
    SCREE_TRY_AT(place("normals"), format::decode_normals(out.normals, record.normal_bits, bytes_of(streams.normals)));
  }
  if (!out.second_uvs.empty()) {
    std::span<const std::byte> codes = bytes_of(streams.second_uvs);
    const auto range = format::open_second_uvs(record.second_uv_bits, codes);
    SCREE_TRY_AT(place("second texture coordinates"),
                 range ? format::decode_uvs(out.second_uvs, *range, codes) : Result<void>(range.error()));
  }
  if (!out.tangents.empty()) {
    SCREE_TRY_AT(place("tangents"),
                 format::decode_tangents(out.tangents, out.normals, record.tangent_bits, bytes_of(streams.tangents)));
  }
  if (!out.source_ids.empty()) {
    const format::SourceIdRange range{record.source_min, record.source_bits};
    SCREE_TRY_AT(place("source triangle numbers"),
                 format::decode_source_ids(out.source_ids, range, bytes_of(streams.source_ids)));
  }
  return {};
}

Result<const DecodedChunk*> ChunkReader::read(uint64_t chunk, uint32_t parts) {
  const uint32_t page = file_->chunks()[chunk].page;
  if (page != page_number_) {
    page_number_ = format::kNone;
    page_ = SCREE_TRY_AT("page " + std::to_string(page), file_->load_page(page, scratch_));
    page_number_ = page;
  }
  SCREE_TRY(decode_chunk(*file_, chunk, page_, parts, chunk_));
  return static_cast<const DecodedChunk*>(&chunk_);
}

}  // namespace scree::tools
