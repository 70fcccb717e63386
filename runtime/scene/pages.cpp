#include "runtime/scene/pages.h"

#include <algorithm>
#include <functional>
#include <new>
#include <queue>
#include <string>
#include <utility>

#include "format/bytes.h"
#include "format/geometry/attribute_codec.h"
#include "format/geometry/chunk_layout.h"
#include "format/geometry/cluster_codec.h"
#include "format/geometry/index_codec.h"
#include "format/geometry/position_codec.h"
#include "format/geometry/tangent_codec.h"
#include "format/text.h"
#include "runtime/threads/first_error.h"
#include "runtime/threads/parallel.h"

namespace scree::runtime {

using format::ChunkRecord;
using format::ChunkStream;
using format::MeshRecord;

std::string chunk_place(const format::Container& container, uint64_t index) {
  const ChunkRecord& chunk = container.chunks()[index];
  const std::string_view name = container.string(container.groups()[container.meshes()[chunk.mesh].group].name);
  return "mesh " + std::to_string(chunk.mesh) + format::in_brackets(name) + ", chunk " + std::to_string(index) +
         " (page " + std::to_string(chunk.page) + ", byte " + std::to_string(chunk.offset) + ")";
}

namespace {

/// Checks the streams of vertices' attributes and of source numbers. `bytes_of`: returns the bytes of a stream.
template <class BytesOf>
Result<void> check_attributes(const MeshRecord& mesh, const ChunkRecord& chunk, const format::ChunkStreams& streams,
                              const BytesOf& bytes_of) {
  Result<void> checked = {};
  if (mesh.attributes & format::kHasUv) {
    const format::UvRange range{
        chunk.uv_exponent, {chunk.uv_min[0], chunk.uv_min[1]}, {chunk.uv_bits[0], chunk.uv_bits[1]}};
    checked = format::check_uvs(chunk.vertex_count, range, bytes_of(streams.uvs));
    if (!checked) return at("texture coordinates", checked.error());
  }
  if (mesh.attributes & format::kHasColor) {
    checked = format::check_colors(chunk.vertex_count, bytes_of(streams.colors));
    if (!checked) return at("colours", checked.error());
  }
  if (mesh.attributes & format::kHasNormal) {
    checked = format::check_normals(chunk.vertex_count, chunk.normal_bits, bytes_of(streams.normals));
    if (!checked) return at("normals", checked.error());
  }
  if (mesh.attributes & format::kHasSecondUv) {
    std::span<const std::byte> codes = bytes_of(streams.second_uvs);
    const auto range = format::open_second_uvs(chunk.second_uv_bits, codes);
    checked = range ? format::check_uvs(chunk.vertex_count, *range, codes) : Result<void>(range.error());
    if (!checked) return at("second texture coordinates", checked.error());
  }
  if (mesh.attributes & format::kHasTangent) {
    checked = format::check_tangents(chunk.vertex_count, chunk.tangent_bits, bytes_of(streams.tangents));
    if (!checked) return at("tangents", checked.error());
  }
  if (mesh.attributes & format::kHasSourceIds) {
    checked = format::check_source_ids(chunk.triangle_count, {chunk.source_min, chunk.source_bits},
                                       bytes_of(streams.source_ids));
    if (!checked) return at("source triangle numbers", checked.error());
  }
  return {};
}

}  // namespace

Result<void> check_chunk(const MeshRecord& mesh, const ChunkRecord& chunk, std::span<const std::byte> page) {
  const format::ChunkStreams streams = format::chunk_streams(mesh, chunk);
  if (streams.bytes != chunk.bytes || !format::range_within(chunk.offset, chunk.bytes, page.size()))
    return Error{ErrorCode::kRange, std::to_string(chunk.bytes) + " bytes at " + std::to_string(chunk.offset) +
                                        " of a page of " + std::to_string(page.size()) + ", but its streams take " +
                                        std::to_string(streams.bytes)};
  const std::span<const std::byte> payload = page.subspan(chunk.offset, chunk.bytes);
  const auto bytes_of = [&](const ChunkStream& stream) { return payload.subspan(stream.offset, stream.bytes); };

  Result<void> checked = {};
  if (chunk.encoding == format::ChunkEncoding::kClustered) {
    checked = format::check_clusters(format::cluster_streams_of(mesh, chunk, payload));
    if (!checked) return at("clusters", checked.error());
  } else {
    checked = format::check_indices(uint64_t{3} * chunk.triangle_count, chunk.vertex_count,
                                    {chunk.index_min, chunk.index_bits}, bytes_of(streams.indices));
    if (!checked) return at("indices", checked.error());
    checked = format::check_positions(chunk.vertex_count, format::lattice_of(mesh), format::position_range_of(chunk),
                                      bytes_of(streams.positions));
    if (!checked) return at("positions", checked.error());
  }
  return check_attributes(mesh, chunk, streams, bytes_of);
}

Result<void> check_behind_clusters(const MeshRecord& mesh, const ChunkRecord& chunk, std::span<const std::byte> rest) {
  const format::ChunkStreams streams = format::chunk_streams(mesh, chunk);
  if (rest.size() != streams.bytes - streams.uvs.offset)
    return Error{ErrorCode::kRange, std::to_string(rest.size()) + " bytes behind clusters, but its streams take " +
                                        std::to_string(streams.bytes - streams.uvs.offset)};
  return check_attributes(mesh, chunk, streams, [&](const ChunkStream& stream) {
    return rest.subspan(stream.offset - streams.uvs.offset, stream.bytes);
  });
}

DrawnPages::DrawnPages(const format::Container& container, const std::vector<bool>& drawn) : container_(container) {
  const auto meshes = container.meshes();
  const auto chunks = container.chunks();
  for (uint64_t m = 0; m < meshes.size(); ++m) {
    if (!drawn[m]) continue;
    const MeshRecord& mesh = meshes[m];
    for (uint64_t c = mesh.first_chunk; c < mesh.first_chunk + mesh.chunk_count; ++c)
      chunks_.push_back({chunks[c].page, c});
  }
  const auto before = [](const PageChunk& a, const PageChunk& b) {
    return a.page != b.page ? a.page < b.page : a.chunk < b.chunk;
  };
  if (!std::is_sorted(chunks_.begin(), chunks_.end(), before)) std::sort(chunks_.begin(), chunks_.end(), before);
  for (uint64_t i = 0; i < chunks_.size(); ++i)
    if (i == 0 || chunks_[i].page != chunks_[i - 1].page) first_chunk_.push_back(i);
  first_chunk_.push_back(chunks_.size());
}

Result<void> DrawnPages::check(uint64_t index, std::span<const std::byte> raw) const {
  PageRoom room(raw.size());
  for (uint64_t c = first_chunk_[index]; c < first_chunk_[index + 1]; ++c) {
    const ChunkRecord& chunk = container_.chunks()[chunks_[c].chunk];
    SCREE_TRY_AT(chunk_place(container_, chunks_[c].chunk), check_chunk(container_.meshes()[chunk.mesh], chunk, raw));
    if (!room.take(chunk))
      return at(chunk_place(container_, chunks_[c].chunk),
                Error{ErrorCode::kRange, "overlaps another chunk: with it the page's chunks take more than " +
                                             std::to_string(raw.size()) + " bytes"});
  }
  return {};
}

std::vector<uint32_t> owners_of_pages(const DrawnPages& pages, uint32_t owners) {
  using Load = std::pair<uint64_t, uint32_t>;  // bytes, owner
  std::priority_queue<Load, std::vector<Load>, std::greater<>> loads;
  for (uint32_t owner = 0; owner < owners; ++owner) loads.emplace(0, owner);
  std::vector<uint32_t> owner_of(pages.size());
  for (uint64_t i = 0; i < pages.size(); ++i) {
    const auto [bytes, owner] = loads.top();
    loads.pop();
    owner_of[i] = owner;
    loads.emplace(bytes + pages.record(i).raw_bytes, owner);
  }
  return owner_of;
}

Result<PageSet> load_pages(const DrawnPages& pages, const MappedFile& map, uint32_t threads,
                           JobProgress* progress) try {
  PageSet set;
  const format::Container& container = pages.container();
  set.raw.assign(container.pages().size(), nullptr);
  set.decoded.resize(container.pages().size());
  set.page_count = pages.size();
  for (uint64_t i = 0; i < set.page_count; ++i) set.stored_bytes += pages.record(i).stored_bytes;
  if (progress != nullptr) progress->begin("geometry", set.stored_bytes);
  FirstError failure;
  parallel_for(set.page_count, threads, [&](uint64_t i) {
    if (failure.is_superseded(i)) return;
    const uint32_t page = pages.page(i);
    const format::PageRecord& record = pages.record(i);
    map.will_need(record.offset, record.stored_bytes);
    const Result<std::span<const std::byte>> raw = container.load_page(page, set.decoded[page]);
    if (!raw) return failure.report(i, raw.error());
    // The stored bytes of a decompressed page are not read again, so they need not stay resident.
    if (record.codec != format::PageCodec::kRaw) map.release(record.offset, record.stored_bytes);
    if (const Result<void> checked = pages.check(i, *raw); !checked) return failure.report(i, checked.error());
    set.raw[page] = raw->data();
    if (const Result<void> going = JobProgress::advance(progress, record.stored_bytes); !going)
      failure.report(i, going.error());
  });
  if (failure.any()) return failure.error();
  for (uint64_t i = 0; i < set.page_count; ++i) set.decoded_bytes += set.decoded[pages.page(i)].size();
  return set;
} catch (const std::bad_alloc&) {
  return Error{ErrorCode::kMemory, "no memory left for its pages"};
}

}  // namespace scree::runtime
