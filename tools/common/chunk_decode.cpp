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

/// Resizes `values`, and frees memory left over from a much larger earlier chunk.
template <class T>
void set_size(std::vector<T>& values, uint64_t size) {
  if (values.capacity() > 4 * size + (uint64_t{1} << 20)) std::vector<T>().swap(values);
  values.resize(size);
}

}  // namespace

Result<void> decode_chunk(const format::Container& file, uint64_t chunk, std::span<const std::byte> page,
                          uint32_t parts, DecodedChunk& out) {
  const format::ChunkRecord& record = file.chunks()[chunk];
  const format::MeshRecord& mesh = file.meshes()[record.mesh];
  const auto place = [&](const char* stream) { return runtime::chunk_place(file, chunk) + ": " + stream; };

  const format::ChunkStreams streams = format::chunk_streams(mesh, record);
  if (record.bytes != streams.bytes || !format::range_within(record.offset, record.bytes, page.size())) {
    return Error{ErrorCode::kRange, runtime::chunk_place(file, chunk) + ": takes " + std::to_string(record.bytes) +
                                        " bytes, but its streams take " + std::to_string(streams.bytes) +
                                        " and the page has " + std::to_string(page.size())};
  }
  // The number of values of a part that is requested, if the mesh has it (`flag`; 0: always).
  const auto values = [&](uint32_t part, uint32_t flag, uint64_t count) {
    return (parts & part) && (mesh.attributes & flag) == flag ? count : 0;
  };
  const uint64_t vertices = record.vertex_count, triangles = record.triangle_count;
  const uint64_t indices = values(kPartIndices, 0, 3 * triangles);
  const uint64_t positions = values(kPartPositions, 0, 3 * vertices);
  const uint64_t uvs = values(kPartUvs, format::kHasUv, 2 * vertices);
  const uint64_t colors = values(kPartColors, format::kHasColor, 4 * vertices);
  const uint64_t normals = values(kPartNormals, format::kHasNormal, 3 * vertices);
  const uint64_t source_ids = values(kPartSourceIds, format::kHasSourceIds, triangles);
  const uint64_t second_uvs = values(kPartSecondUvs, format::kHasSecondUv, 2 * vertices);
  const uint64_t tangents = values(kPartTangents, format::kHasTangent, 4 * vertices);
  const uint64_t needed = 4 * (indices + positions + uvs + colors + normals + second_uvs + tangents) + 8 * source_ids;
  if (needed > memory_limit()) {
    return Error{ErrorCode::kMemory, runtime::chunk_place(file, chunk) + ": decodes to " + std::to_string(needed) +
                                         " bytes, more than half of this machine's memory"};
  }
  try {
    set_size(out.indices, indices);
    set_size(out.positions, positions);
    set_size(out.uvs, uvs);
    set_size(out.colors, colors);
    set_size(out.normals, normals);
    set_size(out.source_ids, source_ids);
    set_size(out.second_uvs, second_uvs);
    set_size(out.tangents, normals != 0 ? tangents : 0);
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
  if (!out.colors.empty()) SCREE_TRY_AT(place("colours"), format::decode_colors(out.colors, bytes_of(streams.colors)));
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
