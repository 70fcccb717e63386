// The checks of pages, groups, meshes and chunks.
#include <cfloat>
#include <cmath>

#include "format/bytes.h"
#include "format/container/checker.h"
#include "format/geometry/chunk_layout.h"
#include "format/geometry/quantize.h"
#include "format/geometry/tangent_codec.h"

namespace scree::format {

using enum ErrorCode;

namespace {

/// Lower bound of the largest code for a width: bits = bit_width(largest code), so the code is at least 2^(bits - 1).
uint64_t known_code(uint32_t bits) {
  return bits == 0 ? 0 : uint64_t{1} << (bits - 1);
}

/// Whether the coordinates min .. min + 2^bits - 1 are exact in a double, and the first and known_code()'s are finite
/// floats when scaled: a chunk must have these two. The largest code itself is checked by the codecs when a page is
/// loaded: a lattice that continues past the largest float is no error, because coordinates near that float need it.
bool lattice_is_sane(int64_t min, uint32_t bits, int32_t exponent) {
  if (exponent < kMinLatticeExponent || exponent > kMaxLatticeExponent) return false;
  if (min <= -kLatticeLimit || min >= kLatticeLimit) return false;
  // Below 2^53 and scaled by at most 2^74, so always finite. Most files end here.
  if (exponent <= 74) return true;
  const int64_t known = min + static_cast<int64_t>(known_code(bits));
  const double step = exp2i(exponent);
  return std::abs(static_cast<double>(min) * step) <= double{FLT_MAX} &&
         std::abs(static_cast<double>(known) * step) <= double{FLT_MAX};
}

}  // namespace

Result<void> Checker::pages() const {
  uint64_t end = kPageAlignment;
  for (uint64_t i = 0; i < pages_.size(); ++i) {
    announce(TableKind::kPages, i);
    const PageRecord& page = pages_[i];
    const uint64_t place = align_up(end, kPageAlignment);  // in [4096, 2^63): `end` lies within the file
    if (page.offset != place) return fail(kRange, "page ", i, ": at byte ", page.offset, ", expected ", place);
    if (!range_within(page.offset, page.stored_bytes, tables_.tables_offset)) {
      return fail(kRange, "page ", i, ": ", page.stored_bytes, " bytes at byte ", page.offset,
                  ", but the tables start at byte ", tables_.tables_offset);
    }
    if (page.codec == PageCodec::kRaw) {
      if (page.raw_bytes != page.stored_bytes) {
        return fail(kRange, "page ", i, ": ", page.raw_bytes, " raw bytes, but ", page.stored_bytes, " are stored raw");
      }
    } else if (page.codec == PageCodec::kZstd || (page.codec == PageCodec::kSplit && tables_.is_second)) {
      if (page.codec == PageCodec::kSplit && page.kind != PageKind::kGeometry)
        return fail(kRange, "page ", i, ": split, but of kind ", page.kind);
      if (page.stored_bytes >= page.raw_bytes) {
        return fail(kRange, "page ", i, ": ", page.raw_bytes, " bytes compressed to ", page.stored_bytes);
      }
      // The product fits 64 bits: stored_bytes lie in a mapped file and are below 2^48.
      if (page.raw_bytes > kPageTargetBytes &&
          (page.raw_bytes > kMaxZstdPageBytes || page.raw_bytes > kMaxZstdRatio * page.stored_bytes)) {
        return fail(kRange, "page ", i, ": ", page.raw_bytes, " bytes compressed to ", page.stored_bytes,
                    ", which is more than is allowed");
      }
    } else {
      return fail(kRange, "page ", i, ": codec ", page.codec,
                  page.codec == PageCodec{2}        ? ", which only scree 0.1 reads; convert the scene again"
                  : page.codec == PageCodec::kSplit ? ", but the file has major version 1"
                                                    : "");
    }
    end = page.offset + page.stored_bytes;
  }
  if (align_up(end, kTableAlignment) != tables_.tables_offset) {
    return fail(kRange, "the pages end at byte ", end, ", but the tables start at byte ", tables_.tables_offset);
  }
  return {};
}

/// The fields of a mesh, without its chunks.
std::optional<Error> Checker::mesh_fields(uint64_t index) const {
  const MeshRecord& mesh = meshes_[index];
  if (mesh.group >= groups_.size()) return fail_index("mesh", index, "group", mesh.group, groups_.size(), "groups");
  if (mesh.material >= materials_.size() && mesh.material != kNone) {
    return fail_index("mesh", index, "material", mesh.material, materials_.size(), "materials");
  }
  const uint32_t known_attributes =
      kHasUv | kHasColor | kHasNormal | kHasSourceIds | (tables_.is_second ? kSecondAttributes : 0u);
  if (mesh.attributes & ~known_attributes) return fail(kReserved, "mesh ", index, ": attributes ", mesh.attributes);
  if ((mesh.attributes & kHasSecondUv && !(mesh.attributes & kHasUv)) ||
      (mesh.attributes & kHasTangent && !(mesh.attributes & kHasNormal))) {
    return fail(kRange, "mesh ", index, ": attributes ", mesh.attributes,
                ", but second uv needs uv, and tangents need normals");
  }

  if (!all_finite(mesh.bounds_min, 3) || !all_finite(mesh.bounds_max, 3)) {
    return fail(kRange, "mesh ", index, ": bounds that are not finite");
  }
  for (uint32_t axis = 0; axis < 3; ++axis) {
    if (mesh.bounds_min[axis] > mesh.bounds_max[axis]) {
      return fail(kRange, "mesh ", index, ": bounds from ", mesh.bounds_min[axis], " to ", mesh.bounds_max[axis]);
    }
  }
  if (!(mesh.max_position_error >= 0 && mesh.max_position_error <= DBL_MAX)) {
    return fail(kRange, "mesh ", index, ": position error ", mesh.max_position_error);
  }
  if (!(mesh.max_uv_error >= 0 && mesh.max_uv_error <= FLT_MAX)) {
    return fail(kRange, "mesh ", index, ": uv error ", mesh.max_uv_error);
  }

  if (mesh.position_encoding == PositionEncoding::kLattice) {
    for (uint32_t axis = 0; axis < 3; ++axis) {
      if (mesh.lattice_bits[axis] > kMaxPositionBits) {
        return fail(kRange, "mesh ", index, ": ", mesh.lattice_bits[axis], " lattice bits, expected at most ",
                    kMaxPositionBits);
      }
      if (!lattice_is_sane(mesh.lattice_min[axis], mesh.lattice_bits[axis], mesh.lattice_exponent)) {
        return fail(kRange, "mesh ", index, ": lattice from ", mesh.lattice_min[axis], ", step 2^",
                    mesh.lattice_exponent, ", whose points are no finite floats");
      }
    }
  } else if (mesh.position_encoding == PositionEncoding::kFloat32) {
    if (mesh.lattice_min[0] | mesh.lattice_min[1] | mesh.lattice_min[2] | mesh.lattice_exponent | mesh.lattice_bits[0] |
        mesh.lattice_bits[1] | mesh.lattice_bits[2]) {
      return fail(kReserved, "mesh ", index, ": a lattice, but float32 positions");
    }
    if (mesh.max_position_error != 0) {
      return fail(kRange, "mesh ", index, ": position error ", mesh.max_position_error, ", but float32 positions");
    }
  } else {
    return fail(kRange, "mesh ", index, ": position encoding ", mesh.position_encoding);
  }
  return std::nullopt;
}

namespace {

/// Checks a chunk's location: page, mesh, triangles.
std::optional<Error> chunk_range(uint64_t index, const ChunkRecord& chunk, const Table<PageRecord>& pages,
                                 const MeshRecord& mesh, uint64_t mesh_index, uint64_t first_triangle) {
  if (chunk.mesh != mesh_index) {
    return fail(kRange, "chunk ", index, ": mesh ", chunk.mesh, ", but it is a chunk of mesh ", mesh_index);
  }
  if (chunk.first_triangle != first_triangle) {
    return fail(kRange, "chunk ", index, ": first triangle ", chunk.first_triangle, ", but the chunks before have ",
                first_triangle);
  }
  if (chunk.triangle_count == 0) return fail(kRange, "chunk ", index, ": no triangles");
  if (chunk.vertex_count == 0 || chunk.vertex_count > 3 * uint64_t{chunk.triangle_count}) {
    return fail(kRange, "chunk ", index, ": ", chunk.vertex_count, " vertices, but ", chunk.triangle_count,
                " triangles");
  }

  const ChunkStreams streams = chunk_streams(mesh, chunk);
  if (chunk.bytes != streams.bytes) {
    return fail(kRange, "chunk ", index, ": ", chunk.bytes, " bytes, but its streams take ", streams.bytes);
  }
  if (chunk.page >= pages.size()) return fail_index("chunk", index, "page", chunk.page, pages.size(), "pages");
  const PageRecord& page = pages[chunk.page];
  if (page.kind != PageKind::kGeometry) {
    return fail(kRange, "chunk ", index, ": page ", chunk.page, " is of kind ", page.kind, ", which holds no chunks");
  }
  if (chunk.offset % kChunkAlignment != 0) {
    return fail(kRange, "chunk ", index, ": offset ", chunk.offset, " is no multiple of ", kChunkAlignment);
  }
  if (!range_within(chunk.offset, chunk.bytes, page.raw_bytes)) {
    return fail(kRange, "chunk ", index, ": ", chunk.bytes, " bytes at ", chunk.offset, " of page ", chunk.page,
                ", which has ", page.raw_bytes);
  }
  if (page.raw_bytes > kPageTargetBytes && chunk.bytes != page.raw_bytes) {
    return fail(kRange, "chunk ", index, ": shares page ", chunk.page, ", which has ", page.raw_bytes,
                " bytes; only a page for one chunk may pass ", kPageTargetBytes);
  }
  return std::nullopt;
}

/// Checks an indexed chunk's index fields.
std::optional<Error> index_fields(uint64_t index, const ChunkRecord& chunk) {
  if (chunk.index_bits > 32) return fail(kRange, "chunk ", index, ": ", chunk.index_bits, " index bits");
  // All-equal indices take no bytes, so the count alone has to bound the cost of decoding.
  if (chunk.index_bits == 0 && chunk.triangle_count > kMaxChunkTriangles) {
    return fail(kRange, "chunk ", index, ": ", chunk.triangle_count, " triangles of 0 index bits, expected at most ",
                kMaxChunkTriangles);
  }
  // Loading the page finds indices at or above the vertex count. This checks only the least index that a width of 2
  // bits or more implies. A width of 1 bit implies none: chunks of equal indices that may not have 0 bits have 1.
  const uint64_t known_index = chunk.index_min + (chunk.index_bits > 1 ? known_code(chunk.index_bits) : 0);
  if (known_index >= chunk.vertex_count) {
    return fail(kRange, "chunk ", index, ": indices from ", chunk.index_min, " of ", chunk.index_bits,
                " bits, but it has ", chunk.vertex_count, " vertices");
  }
  if (chunk.cluster_count | chunk.cluster_words) {
    return fail(kReserved, "chunk ", index, ": cluster fields are set, but it is indexed");
  }
  return std::nullopt;
}

/// Checks a clustered chunk's cluster fields.
std::optional<Error> cluster_fields(uint64_t index, const ChunkRecord& chunk, const MeshRecord& mesh) {
  if (mesh.position_encoding == PositionEncoding::kFloat32) {
    return fail(kRange, "chunk ", index, ": clusters, but float32 positions");
  }
  if (chunk.index_min | chunk.index_bits) {
    return fail(kReserved, "chunk ", index, ": index fields are set, but it has clusters");
  }
  // Clusters take bytes, so these limits bound the cost of decoding.
  const uint64_t clusters = chunk.cluster_count;
  if (clusters == 0 || clusters > chunk.triangle_count || chunk.triangle_count > clusters * kMaxClusterTriangles) {
    return fail(kRange, "chunk ", index, ": ", clusters, " clusters of ", chunk.triangle_count, " triangles");
  }
  if (chunk.vertex_count < 3 * clusters || chunk.vertex_count > clusters * kMaxClusterVertices) {
    return fail(kRange, "chunk ", index, ": ", clusters, " clusters of ", chunk.vertex_count, " vertices");
  }
  if (chunk.cluster_words < clusters || chunk.cluster_words > kMaxClusterWords) {
    return fail(kRange, "chunk ", index, ": ", chunk.cluster_words, " words of ", clusters, " clusters");
  }
  return std::nullopt;
}

/// Checks the ranges and widths of a chunk's streams.
std::optional<Error> chunk_streams_of(uint64_t index, const ChunkRecord& chunk, const MeshRecord& mesh) {
  if (chunk.encoding == ChunkEncoding::kIndexed) {
    if (auto error = index_fields(index, chunk)) [[unlikely]]
      return error;
  } else if (chunk.encoding == ChunkEncoding::kClustered) {
    if (auto error = cluster_fields(index, chunk, mesh)) [[unlikely]]
      return error;
  } else {
    return fail(kRange, "chunk ", index, ": encoding ", chunk.encoding);
  }

  if (mesh.position_encoding == PositionEncoding::kLattice) {
    for (uint32_t axis = 0; axis < 3; ++axis) {
      const uint32_t bits = chunk.position_bits[axis];
      if (bits > kMaxPositionBits || chunk.position_min[axis] + known_code(bits) >= uint64_t{1}
                                                                                        << mesh.lattice_bits[axis]) {
        return fail(kRange, "chunk ", index, ": positions from ", chunk.position_min[axis], " of ", bits,
                    " bits, but the mesh's lattice has ", mesh.lattice_bits[axis], " bits");
      }
    }
  } else if (chunk.position_bits[0] != 32 || chunk.position_bits[1] != 32 || chunk.position_bits[2] != 32 ||
             (chunk.position_min[0] | chunk.position_min[1] | chunk.position_min[2]) != 0) {
    return fail(kRange, "chunk ", index, ": position bits or minimum, but float32 positions");
  }

  if (mesh.attributes & kHasUv) {
    for (uint32_t axis = 0; axis < 2; ++axis) {
      if (chunk.uv_bits[axis] > kMaxUvBits) {
        return fail(kRange, "chunk ", index, ": ", chunk.uv_bits[axis], " uv bits, expected at most ", kMaxUvBits);
      }
      if (!lattice_is_sane(chunk.uv_min[axis], chunk.uv_bits[axis], chunk.uv_exponent)) {
        return fail(kRange, "chunk ", index, ": uv lattice from ", chunk.uv_min[axis], ", step 2^", chunk.uv_exponent,
                    ", whose points are no finite floats");
      }
    }
  } else if (chunk.uv_min[0] | chunk.uv_min[1] | chunk.uv_exponent | chunk.uv_bits[0] | chunk.uv_bits[1]) {
    return fail(kReserved, "chunk ", index, ": uv fields are set, but the mesh has no uv");
  }

  if (mesh.attributes & kHasNormal) {
    if (chunk.normal_bits < 2 || chunk.normal_bits > 16) {
      return fail(kRange, "chunk ", index, ": ", chunk.normal_bits, " normal bits, expected 2 to 16");
    }
  } else if (chunk.normal_bits) {
    return fail(kReserved, "chunk ", index, ": normal bits are set, but the mesh has no normals");
  }

  if (mesh.attributes & kHasSecondUv) {
    if (chunk.second_uv_bits[0] > kMaxUvBits || chunk.second_uv_bits[1] > kMaxUvBits) {
      return fail(kRange, "chunk ", index, ": ", chunk.second_uv_bits[0], " and ", chunk.second_uv_bits[1],
                  " second uv bits, expected at most ", kMaxUvBits);
    }
  } else if (chunk.second_uv_bits[0] | chunk.second_uv_bits[1]) {
    return fail(kReserved, "chunk ", index, ": second uv bits are set, but the mesh has no second uv");
  }

  if (mesh.attributes & kHasTangent) {
    if (chunk.tangent_bits < kMinTangentBits || chunk.tangent_bits > kMaxTangentBits) {
      return fail(kRange, "chunk ", index, ": ", chunk.tangent_bits, " tangent bits, expected ", kMinTangentBits,
                  " to ", kMaxTangentBits);
    }
  } else if (chunk.tangent_bits) {
    return fail(kReserved, "chunk ", index, ": tangent bits are set, but the mesh has no tangents");
  }

  if (mesh.attributes & kHasSourceIds) {
    if (chunk.source_bits > 32 || chunk.source_min >= uint64_t{1} << 63) {
      return fail(kRange, "chunk ", index, ": source triangles from ", chunk.source_min, " of ", chunk.source_bits,
                  " bits");
    }
  } else if (chunk.source_bits || chunk.source_min) {
    return fail(kReserved, "chunk ", index, ": source triangle fields are set, but the mesh has none");
  }
  return std::nullopt;
}

}  // namespace

std::optional<Error> check_chunk_record(uint64_t index, const ChunkRecord& chunk, const Table<PageRecord>& pages,
                                        const MeshRecord& mesh, uint64_t mesh_index, uint64_t first_triangle) {
  // Streams before sizes: the error should give the absurd width, not the size that follows from it.
  if (auto error = chunk_streams_of(index, chunk, mesh)) [[unlikely]]
    return error;
  return chunk_range(index, chunk, pages, mesh, mesh_index, first_triangle);
}

Result<void> Checker::meshes(Part part) {
  for (uint64_t m = part.begin(meshes_.size()); m < part.end(meshes_.size()); ++m) {
    announce(TableKind::kMeshes, m);
    if (auto error = mesh_fields(m)) [[unlikely]]
      return *std::move(error);
    const MeshRecord& mesh = meshes_[m];
    if (mesh.first_chunk != next_chunk_ || mesh.chunk_count > chunks_.size() - next_chunk_) {
      return fail(kRange, "mesh ", m, ": ", mesh.chunk_count, " chunks from ", mesh.first_chunk, ", expected from ",
                  next_chunk_, " to at most ", chunks_.size());
    }
    // Tables have less than 2^32 records, so these are sums of less than 2^32 numbers below 2^32.
    uint64_t triangles = 0;
    uint64_t vertices = 0;
    for (uint64_t c = next_chunk_; c < next_chunk_ + mesh.chunk_count; ++c) {
      announce(TableKind::kChunks, c);
      if (auto error = check_chunk_record(c, chunks_[c], pages_, mesh, m, triangles)) [[unlikely]]
        return *std::move(error);
      triangles += chunks_[c].triangle_count;
      vertices += chunks_[c].vertex_count;
    }
    next_chunk_ += mesh.chunk_count;
    if (mesh.triangle_count != triangles || mesh.vertex_count != vertices) {
      return fail(kRange, "mesh ", m, ": ", mesh.triangle_count, " triangles and ", mesh.vertex_count,
                  " vertices, but its chunks have ", triangles, " and ", vertices);
    }
    const auto sum = checked_add(source_vertices_, mesh.source_vertex_count);
    if (!sum) return fail(kRange, "mesh ", m, ": ", mesh.source_vertex_count, " vertices in its source");
    source_vertices_ = *sum;

    // Checks that the mesh's group contains it, while the group is in the cache. If not, groups() finds the error.
    while (m >= group_end_ && group_ < groups_.size()) {
      announce(TableKind::kGroups, group_);
      group_end_ += groups_[group_++].mesh_count;
    }
    groups_may_differ_ |= mesh.group + uint64_t{1} != group_;
  }
  if (part.is_last() && next_chunk_ != chunks_.size()) {
    return fail(kRange, "chunk ", next_chunk_, ": belongs to no mesh");
  }
  return {};
}

/// Must be called after meshes().
Result<void> Checker::groups() const {
  uint64_t next_mesh = 0;
  for (uint64_t g = 0; g < groups_.size(); ++g) {
    announce(TableKind::kGroups, g);
    const GroupRecord& group = groups_[g];
    if (name_is_bad(group.name)) return fail_name("group", g, group.name);
    if (group.reserved) return fail(kReserved, "group ", g, ": a reserved field is set");
    if (group.first_mesh != next_mesh || group.mesh_count > meshes_.size() - next_mesh) {
      return fail(kRange, "group ", g, ": ", group.mesh_count, " meshes from ", group.first_mesh, ", expected from ",
                  next_mesh, " to at most ", meshes_.size());
    }
    for (uint64_t m = next_mesh; groups_may_differ_ && m < next_mesh + group.mesh_count; ++m) {
      if (meshes_[m].group != g) {
        return fail(kRange, "mesh ", m, ": group ", meshes_[m].group, ", but it is a mesh of group ", g);
      }
    }
    next_mesh += group.mesh_count;
  }
  if (next_mesh != meshes_.size()) return fail(kRange, "mesh ", next_mesh, ": belongs to no group");
  return {};
}

}  // namespace scree::format
