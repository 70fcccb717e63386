#include "format/container_check.h"

#include <cfloat>
#include <cmath>
#include <numbers>
#include <optional>

#include "format/bytes.h"
#include "format/chunk_layout.h"
#include "format/quantize.h"

namespace scree::format {
namespace {

using enum ErrorCode;

template <class Float>
bool all_finite(const Float* values, uint32_t count) {
  constexpr Float kLargest = sizeof(Float) == 4 ? Float(FLT_MAX) : Float(DBL_MAX);
  bool finite = true;
  for (uint32_t i = 0; i < count; ++i) finite &= std::abs(values[i]) <= kLargest;  // false for NaN
  return finite;
}

/// The largest code that a width says is there: bits = bit_width(largest code), so 2^(bits - 1) at least.
uint64_t known_code(uint32_t bits) {
  return bits == 0 ? 0 : uint64_t{1} << (bits - 1);
}

/// Whether the coordinates min .. min + 2^bits - 1 are exact in a double, and those that must be there (the first and
/// that of known_code) are finite floats when scaled. The codecs check the largest code itself when a page is loaded:
/// that the lattice goes on past the largest float is no error, or coordinates near it could not be kept.
bool lattice_is_sane(int64_t min, uint32_t bits, int32_t exponent) {
  if (exponent < kMinLatticeExponent || exponent > kMaxLatticeExponent) return false;
  if (min <= -kLatticeLimit || min >= kLatticeLimit) return false;
  const int64_t known = min + static_cast<int64_t>(known_code(bits));
  const double step = exp2i(exponent);
  return std::abs(static_cast<double>(min) * step) <= double{FLT_MAX} &&
         std::abs(static_cast<double>(known) * step) <= double{FLT_MAX};
}

/// "mesh 3: group 7, but the file has 2 groups".
Error fail_index(const char* kind, uint64_t index, const char* field, uint64_t value, uint64_t count,
                 const char* things) {
  return fail(kRange, kind, " ", index, ": ", field, " ", value, ", but the file has ", count, " ", things);
}

class Checker {
 public:
  explicit Checker(const TableViews& tables)
      : tables_(tables),
        pages_(tables.table<PageRecord>(TableKind::kPages)),
        meshes_(tables.table<MeshRecord>(TableKind::kMeshes)),
        chunks_(tables.table<ChunkRecord>(TableKind::kChunks)),
        groups_(tables.table<GroupRecord>(TableKind::kGroups)),
        nodes_(tables.table<NodeRecord>(TableKind::kNodes)),
        instances_(tables.table<InstanceRecord>(TableKind::kInstances)),
        matrices_(tables.table<MatrixRecord>(TableKind::kMatrices)),
        node_instances_(tables.table<NodeInstanceRecord>(TableKind::kNodeInstances)),
        materials_(tables.table<MaterialRecord>(TableKind::kMaterials)),
        textures_(tables.table<TextureRecord>(TableKind::kTextures)),
        images_(tables.table<ImageRecord>(TableKind::kImages)),
        cameras_(tables.table<CameraRecord>(TableKind::kCameras)),
        scenes_(tables.table<SceneRecord>(TableKind::kScenes)),
        scene_roots_(tables.table<uint32_t>(TableKind::kSceneRoots)) {}

  Result<void> strings();
  Result<void> pages() const;
  Result<void> meshes() const;
  Result<void> groups() const;
  Result<void> nodes() const;
  Result<void> matrices() const;
  Result<void> scenes() const;
  Result<void> materials() const;
  Result<void> textures() const;
  Result<void> images() const;
  Result<void> cameras() const;
  Result<void> source() const;

 private:
  Result<void> mesh_fields(uint64_t index) const;
  std::optional<Error> chunk_range(uint64_t index, const MeshRecord& mesh, uint64_t mesh_index,
                                   uint64_t first_triangle) const;
  std::optional<Error> chunk_streams_of(uint64_t index, const MeshRecord& mesh) const;
  Result<void> instances_of(uint64_t scene_index) const;

  bool name_is_bad(uint32_t offset) const { return offset >= string_bytes_; }
  Error fail_name(const char* kind, uint64_t index, uint32_t offset) const {
    return fail(kRange, kind, " ", index, ": string at ", offset, ", but the strings take ", string_bytes_, " bytes");
  }

  const TableViews& tables_;
  uint64_t string_bytes_ = 0;
  Table<PageRecord> pages_;
  Table<MeshRecord> meshes_;
  Table<ChunkRecord> chunks_;
  Table<GroupRecord> groups_;
  Table<NodeRecord> nodes_;
  Table<InstanceRecord> instances_;
  Table<MatrixRecord> matrices_;
  Table<NodeInstanceRecord> node_instances_;
  Table<MaterialRecord> materials_;
  Table<TextureRecord> textures_;
  Table<ImageRecord> images_;
  Table<CameraRecord> cameras_;
  Table<SceneRecord> scenes_;
  Table<uint32_t> scene_roots_;
};

Result<void> Checker::strings() {
  const TableViews::View& strings = tables_.view(TableKind::kStrings);
  if (!strings.first || strings.count == 0) return fail(kFormat, "the file has no string table");
  if (strings.first[0] != std::byte{0}) return fail(kFormat, "string table: the string at 0 is not empty");
  if (strings.first[strings.count - 1] != std::byte{0})
    return fail(kFormat, "string table: the last string has no end");
  string_bytes_ = strings.count;
  return {};
}

Result<void> Checker::pages() const {
  uint64_t end = kPageAlignment;
  for (uint64_t i = 0; i < pages_.size(); ++i) {
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
    } else if (page.codec == PageCodec::kZstd) {
      if (page.stored_bytes >= page.raw_bytes) {
        return fail(kRange, "page ", i, ": ", page.raw_bytes, " bytes compressed to ", page.stored_bytes);
      }
      // The product stays in 64 bits: stored_bytes lie in a file that is mapped, so below 2^48.
      if (page.raw_bytes > kPageTargetBytes &&
          (page.raw_bytes > kMaxZstdPageBytes || page.raw_bytes > kMaxZstdRatio * page.stored_bytes)) {
        return fail(kRange, "page ", i, ": ", page.raw_bytes, " bytes compressed to ", page.stored_bytes,
                    ", which is more than is allowed");
      }
    } else {
      return fail(kRange, "page ", i, ": codec ", static_cast<uint32_t>(page.codec));
    }
    end = page.offset + page.stored_bytes;
  }
  if (align_up(end, kTableAlignment) != tables_.tables_offset) {
    return fail(kRange, "the pages end at byte ", end, ", but the tables start at byte ", tables_.tables_offset);
  }
  return {};
}

/// A mesh without its chunks.
Result<void> Checker::mesh_fields(uint64_t index) const {
  const MeshRecord& mesh = meshes_[index];
  if (mesh.group >= groups_.size()) return fail_index("mesh", index, "group", mesh.group, groups_.size(), "groups");
  if (mesh.material >= materials_.size() && mesh.material != kNone) {
    return fail_index("mesh", index, "material", mesh.material, materials_.size(), "materials");
  }
  constexpr uint32_t kKnownAttributes = kHasUv | kHasColor | kHasNormal | kHasSourceIds;
  if (mesh.attributes & ~kKnownAttributes) return fail(kReserved, "mesh ", index, ": attributes ", mesh.attributes);

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
    return fail(kRange, "mesh ", index, ": position encoding ", static_cast<uint32_t>(mesh.position_encoding));
  }
  return {};
}

/// What a chunk says about its place: page, mesh, triangles.
std::optional<Error> Checker::chunk_range(uint64_t index, const MeshRecord& mesh, uint64_t mesh_index,
                                          uint64_t first_triangle) const {
  const ChunkRecord& chunk = chunks_[index];
  if (chunk.mesh != mesh_index) {
    return fail(kRange, "chunk ", index, ": mesh ", chunk.mesh, ", but it is a chunk of mesh ", mesh_index);
  }
  if (chunk.encoding != ChunkEncoding::kIndexed) {
    return fail(kRange, "chunk ", index, ": encoding ", static_cast<uint32_t>(chunk.encoding));
  }
  if (chunk.reserved[0] | chunk.reserved[1] | chunk.reserved[2]) {
    return fail(kReserved, "chunk ", index, ": a reserved field is set");
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
  if (chunk.page >= pages_.size()) return fail_index("chunk", index, "page", chunk.page, pages_.size(), "pages");
  const PageRecord& page = pages_[chunk.page];
  if (page.kind != PageKind::kGeometry) {
    return fail(kRange, "chunk ", index, ": page ", chunk.page, " is of kind ", static_cast<uint32_t>(page.kind),
                ", which holds no chunks");
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

/// What a chunk says about its streams: ranges and widths.
std::optional<Error> Checker::chunk_streams_of(uint64_t index, const MeshRecord& mesh) const {
  const ChunkRecord& chunk = chunks_[index];
  if (chunk.index_bits > 32) return fail(kRange, "chunk ", index, ": ", chunk.index_bits, " index bits");
  // All-equal indices take no bytes, so the count alone must bound what decoding them takes.
  if (chunk.index_bits == 0 && chunk.triangle_count > kMaxChunkTriangles) {
    return fail(kRange, "chunk ", index, ": ", chunk.triangle_count, " triangles of 0 index bits, expected at most ",
                kMaxChunkTriangles);
  }
  // Whether an index that the width allows passes the vertex count is checked when the page is loaded; that one must is
  // known now. 1 bit is free, for the chunk that may not have 0.
  const uint64_t known_index = chunk.index_min + (chunk.index_bits > 1 ? known_code(chunk.index_bits) : 0);
  if (known_index >= chunk.vertex_count) {
    return fail(kRange, "chunk ", index, ": indices from ", chunk.index_min, " of ", chunk.index_bits,
                " bits, but it has ", chunk.vertex_count, " vertices");
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

Result<void> Checker::meshes() const {
  uint64_t next_chunk = 0;
  uint64_t all_source_vertices = 0;
  for (uint64_t m = 0; m < meshes_.size(); ++m) {
    if (auto fields = mesh_fields(m); !fields) return fields;
    const MeshRecord& mesh = meshes_[m];
    if (mesh.first_chunk != next_chunk || mesh.chunk_count > chunks_.size() - next_chunk) {
      return fail(kRange, "mesh ", m, ": ", mesh.chunk_count, " chunks from ", mesh.first_chunk, ", expected from ",
                  next_chunk, " to at most ", chunks_.size());
    }
    // Sums of less than 2^32 numbers below 2^32: tables are shorter than that.
    uint64_t triangles = 0;
    uint64_t vertices = 0;
    for (uint64_t c = next_chunk; c < next_chunk + mesh.chunk_count; ++c) {
      // Streams before sizes: an absurd width should be named, not the size it leads to.
      if (auto error = chunk_streams_of(c, mesh)) [[unlikely]]
        return *std::move(error);
      if (auto error = chunk_range(c, mesh, m, triangles)) [[unlikely]]
        return *std::move(error);
      triangles += chunks_[c].triangle_count;
      vertices += chunks_[c].vertex_count;
    }
    next_chunk += mesh.chunk_count;
    if (mesh.triangle_count != triangles || mesh.vertex_count != vertices) {
      return fail(kRange, "mesh ", m, ": ", mesh.triangle_count, " triangles and ", mesh.vertex_count,
                  " vertices, but its chunks have ", triangles, " and ", vertices);
    }
    const auto sum = checked_add(all_source_vertices, mesh.source_vertex_count);
    if (!sum) return fail(kRange, "mesh ", m, ": ", mesh.source_vertex_count, " vertices in its source");
    all_source_vertices = *sum;
  }
  if (next_chunk != chunks_.size()) {
    return fail(kRange, "chunk ", next_chunk, ": belongs to no mesh");
  }
  return {};
}

Result<void> Checker::groups() const {
  uint64_t next_mesh = 0;
  for (uint64_t g = 0; g < groups_.size(); ++g) {
    const GroupRecord& group = groups_[g];
    if (name_is_bad(group.name)) return fail_name("group", g, group.name);
    if (group.reserved) return fail(kReserved, "group ", g, ": a reserved field is set");
    if (group.first_mesh != next_mesh || group.mesh_count > meshes_.size() - next_mesh) {
      return fail(kRange, "group ", g, ": ", group.mesh_count, " meshes from ", group.first_mesh, ", expected from ",
                  next_mesh, " to at most ", meshes_.size());
    }
    for (uint64_t m = next_mesh; m < next_mesh + group.mesh_count; ++m) {
      if (meshes_[m].group != g) {
        return fail(kRange, "mesh ", m, ": group ", meshes_[m].group, ", but it is a mesh of group ", g);
      }
    }
    next_mesh += group.mesh_count;
  }
  if (next_mesh != meshes_.size()) return fail(kRange, "mesh ", next_mesh, ": belongs to no group");
  return {};
}

Result<void> Checker::nodes() const {
  for (uint64_t n = 0; n < nodes_.size(); ++n) {
    const NodeRecord& node = nodes_[n];
    if (name_is_bad(node.name)) return fail_name("node", n, node.name);
    if (node.parent >= n && node.parent != kNone) {
      return fail(kRange, "node ", n, ": parent ", node.parent, ", expected a node before it");
    }
    if (node.group >= groups_.size() && node.group != kNone) {
      return fail_index("node", n, "group", node.group, groups_.size(), "groups");
    }
    if (node.camera >= cameras_.size() && node.camera != kNone) {
      return fail_index("node", n, "camera", node.camera, cameras_.size(), "cameras");
    }
    if ((node.flags & ~uint32_t{kNodeHasMatrix}) || node.reserved) {
      return fail(kReserved, "node ", n, ": a reserved field or flag is set");
    }
    if (!range_within(node.first_node_instance, node.node_instance_count, node_instances_.size())) {
      return fail(kRange, "node ", n, ": ", node.node_instance_count, " node instances from ", node.first_node_instance,
                  ", but the file has ", node_instances_.size());
    }
    if (!all_finite(node.local, 16)) return fail(kRange, "node ", n, ": a transform that is not finite");
    if (!(node.flags & kNodeHasMatrix)) {
      for (uint32_t i = 10; i < 16; ++i) {
        if (node.local[i] != 0) return fail(kReserved, "node ", n, ": more than translation, rotation and scale");
      }
    }
  }
  for (uint64_t i = 0; i < node_instances_.size(); ++i) {
    const NodeInstanceRecord& record = node_instances_[i];
    if (!all_finite(record.translation, 3) || !all_finite(record.rotation, 4) || !all_finite(record.scale, 3)) {
      return fail(kRange, "node instance ", i, ": a transform that is not finite");
    }
  }
  return {};
}

Result<void> Checker::matrices() const {
  for (uint64_t i = 0; i < matrices_.size(); ++i) {
    if (!all_finite(&matrices_[i].rows[0][0], 12)) return fail(kRange, "matrix ", i, ": not finite");
  }
  return {};
}

Result<void> Checker::instances_of(uint64_t scene_index) const {
  const SceneRecord& scene = scenes_[scene_index];
  uint64_t triangles = 0;
  uint32_t previous_mesh = 0;
  for (uint64_t i = scene.first_instance; i < scene.first_instance + scene.instance_count; ++i) {
    const InstanceRecord& instance = instances_[i];
    if (instance.mesh >= meshes_.size()) {
      return fail_index("instance", i, "mesh", instance.mesh, meshes_.size(), "meshes");
    }
    if (instance.node >= nodes_.size()) {
      return fail_index("instance", i, "node", instance.node, nodes_.size(), "nodes");
    }
    if (instance.matrix >= matrices_.size()) {
      return fail_index("instance", i, "matrix", instance.matrix, matrices_.size(), "matrices");
    }
    const MeshRecord& mesh = meshes_[instance.mesh];
    const NodeRecord& node = nodes_[instance.node];
    if (mesh.group != node.group) {
      return fail(kRange, "instance ", i, ": mesh ", instance.mesh, " of group ", mesh.group, ", but node ",
                  instance.node, " has group ", node.group);
    }
    if (instance.node_instance >= node.node_instance_count && instance.node_instance != 0) {
      return fail(kRange, "instance ", i, ": node instance ", instance.node_instance, ", but node ", instance.node,
                  " has ", node.node_instance_count);
    }
    if (instance.mesh < previous_mesh) {
      return fail(kRange, "instance ", i, ": mesh ", instance.mesh, " after mesh ", previous_mesh,
                  ", expected ascending order");
    }
    previous_mesh = instance.mesh;
    if (__builtin_add_overflow(triangles, mesh.triangle_count, &triangles)) {
      return fail(kRange, "scene ", scene_index, ": more than 2^64 triangles");
    }
  }
  if (scene.triangle_count != triangles) {
    return fail(kRange, "scene ", scene_index, ": ", scene.triangle_count, " triangles, but its instances have ",
                triangles);
  }
  return {};
}

Result<void> Checker::scenes() const {
  uint64_t next_instance = 0;
  bool default_seen = false;
  for (uint64_t s = 0; s < scenes_.size(); ++s) {
    const SceneRecord& scene = scenes_[s];
    if (name_is_bad(scene.name)) return fail_name("scene", s, scene.name);
    if (scene.flags > 1) return fail(kReserved, "scene ", s, ": flags ", scene.flags);
    if (scene.flags == 1 && default_seen) return fail(kRange, "scene ", s, ": a second default scene");
    default_seen |= scene.flags == 1;
    if (!range_within(scene.first_root, scene.root_count, scene_roots_.size())) {
      return fail(kRange, "scene ", s, ": ", scene.root_count, " roots from ", scene.first_root, ", but the file has ",
                  scene_roots_.size());
    }
    if (scene.first_instance != next_instance || scene.instance_count > instances_.size() - next_instance) {
      return fail(kRange, "scene ", s, ": ", scene.instance_count, " instances from ", scene.first_instance,
                  ", expected from ", next_instance, " to at most ", instances_.size());
    }
    if (auto checked = instances_of(s); !checked) return checked;
    next_instance += scene.instance_count;
  }
  if (next_instance != instances_.size()) return fail(kRange, "instance ", next_instance, ": belongs to no scene");
  for (uint64_t i = 0; i < scene_roots_.size(); ++i) {
    if (scene_roots_[i] >= nodes_.size()) {
      return fail_index("scene root", i, "node", scene_roots_[i], nodes_.size(), "nodes");
    }
  }
  return {};
}

Result<void> Checker::materials() const {
  constexpr uint32_t kKnownFlags = kMaterialDoubleSided | kMaterialUnlit | kMaterialAlphaMask | kMaterialAlphaBlend;
  for (uint64_t i = 0; i < materials_.size(); ++i) {
    const MaterialRecord& material = materials_[i];
    if (name_is_bad(material.name)) return fail_name("material", i, material.name);
    if (material.texture >= textures_.size() && material.texture != kNone) {
      return fail_index("material", i, "texture", material.texture, textures_.size(), "textures");
    }
    if ((material.flags & ~kKnownFlags) || material.reserved) {
      return fail(kReserved, "material ", i, ": a reserved field or flag is set");
    }
    if (!all_finite(material.base_color, 4) || !all_finite(material.uv_offset, 2) ||
        !all_finite(material.uv_scale, 2) || !all_finite(&material.uv_rotation, 1) ||
        !all_finite(&material.alpha_cutoff, 1)) {
      return fail(kRange, "material ", i, ": a factor that is not finite");
    }
  }
  return {};
}

Result<void> Checker::textures() const {
  for (uint64_t i = 0; i < textures_.size(); ++i) {
    const TextureRecord& texture = textures_[i];
    if (name_is_bad(texture.name)) return fail_name("texture", i, texture.name);
    if (texture.image >= images_.size()) {
      return fail_index("texture", i, "image", texture.image, images_.size(), "images");
    }
    if (texture.wrap_s > Wrap::kClamp || texture.wrap_t > Wrap::kClamp) {
      return fail(kRange, "texture ", i, ": wrap ", static_cast<uint32_t>(texture.wrap_s), " and ",
                  static_cast<uint32_t>(texture.wrap_t));
    }
    const uint32_t mag = texture.mag_filter;
    const uint32_t min = texture.min_filter;
    const bool mag_known = mag == 0 || mag == 9728 || mag == 9729;
    const bool min_known = min == 0 || min == 9728 || min == 9729 || (min >= 9984 && min <= 9987);
    if (!mag_known || !min_known) return fail(kRange, "texture ", i, ": filters ", mag, " and ", min);
  }
  return {};
}

Result<void> Checker::images() const {
  for (uint64_t i = 0; i < images_.size(); ++i) {
    const ImageRecord& image = images_[i];
    if (name_is_bad(image.name)) return fail_name("image", i, image.name);
    if (image.page >= pages_.size()) return fail_index("image", i, "page", image.page, pages_.size(), "pages");
    if (pages_[image.page].kind != PageKind::kImage) {
      return fail(kRange, "image ", i, ": page ", image.page, " is of kind ",
                  static_cast<uint32_t>(pages_[image.page].kind), ", which holds no image");
    }
    if (image.codec != ImageCodec::kJpeg && image.codec != ImageCodec::kPng) {
      return fail(kRange, "image ", i, ": codec ", static_cast<uint32_t>(image.codec));
    }
    if (image.width == 0 || image.width > kMaxImageSide || image.height == 0 || image.height > kMaxImageSide) {
      return fail(kRange, "image ", i, ": ", image.width, " x ", image.height, " pixels, expected 1 to ",
                  kMaxImageSide);
    }
    if (image.channels < 1 || image.channels > 4) return fail(kRange, "image ", i, ": ", image.channels, " channels");
    if (image.index_page != kNone && !(tables_.newer_minor && image.index_page < pages_.size())) {
      return fail(kRange, "image ", i, ": index page ", image.index_page, ", which this version does not have");
    }
    if (image.reserved) return fail(kReserved, "image ", i, ": a reserved field is set");
  }
  return {};
}

Result<void> Checker::cameras() const {
  for (uint64_t i = 0; i < cameras_.size(); ++i) {
    const CameraRecord& camera = cameras_[i];
    if (name_is_bad(camera.name)) return fail_name("camera", i, camera.name);
    if (!all_finite(&camera.y, 4)) return fail(kRange, "camera ", i, ": a number that is not finite");
    if (camera.kind == CameraKind::kPerspective) {
      if (!(camera.y > 0 && camera.y < std::numbers::pi)) return fail(kRange, "camera ", i, ": angle ", camera.y);
      if (camera.x < 0) return fail(kRange, "camera ", i, ": aspect ratio ", camera.x);
      if (!(camera.z_near > 0) || !(camera.z_far == 0 || camera.z_far > camera.z_near)) {
        return fail(kRange, "camera ", i, ": depths from ", camera.z_near, " to ", camera.z_far);
      }
    } else if (camera.kind == CameraKind::kOrthographic) {
      if (camera.x == 0 || camera.y == 0) return fail(kRange, "camera ", i, ": size ", camera.x, " by ", camera.y);
      if (!(camera.z_near >= 0) || !(camera.z_far > camera.z_near)) {
        return fail(kRange, "camera ", i, ": depths from ", camera.z_near, " to ", camera.z_far);
      }
    } else {
      return fail(kRange, "camera ", i, ": kind ", static_cast<uint32_t>(camera.kind));
    }
  }
  return {};
}

Result<void> Checker::source() const {
  const Table<SourceRecord> sources = tables_.table<SourceRecord>(TableKind::kSource);
  if (sources.size() != 1) return fail(kFormat, "source table: ", sources.size(), " records, expected 1");
  for (const uint32_t offset : {sources[0].name, sources[0].options, sources[0].generator, sources[0].copyright}) {
    if (name_is_bad(offset)) return fail_name("source", 0, offset);
  }
  const Table<LeftOutRecord> left_out = tables_.table<LeftOutRecord>(TableKind::kLeftOut);
  for (uint64_t i = 0; i < left_out.size(); ++i) {
    if (name_is_bad(left_out[i].what)) return fail_name("left-out", i, left_out[i].what);
    if (left_out[i].reserved) return fail(kReserved, "left-out ", i, ": a reserved field is set");
  }
  return {};
}

}  // namespace

Result<void> check_records(const TableViews& tables) {
  Checker checker(tables);
  if (auto checked = checker.strings(); !checked) return checked;
  if (auto checked = checker.pages(); !checked) return checked;
  if (auto checked = checker.meshes(); !checked) return checked;
  if (auto checked = checker.groups(); !checked) return checked;
  if (auto checked = checker.nodes(); !checked) return checked;
  if (auto checked = checker.matrices(); !checked) return checked;
  if (auto checked = checker.scenes(); !checked) return checked;
  if (auto checked = checker.materials(); !checked) return checked;
  if (auto checked = checker.textures(); !checked) return checked;
  if (auto checked = checker.images(); !checked) return checked;
  if (auto checked = checker.cameras(); !checked) return checked;
  return checker.source();
}

}  // namespace scree::format
