// Every rule of spec/container.md for a record's fields is broken once, and the error of open() must name the record.
#include <cmath>

#include "format/bytes.h"
#include "format/container/container.h"
#include "tests/format/container/container_breaker.h"

namespace scree::tests {
namespace {

using namespace scree::format;

TEST_CASE("container rules: meshes", "[container]") {
  const Breaker b(full_parts());
  using M = MeshRecord;
  const auto meshes = b.records<M>(TableKind::kMeshes);
  meshes(0, "mesh 0: group 2, but the file has 2 groups", [](M& m) { m.group = 2; });
  meshes(0, "mesh 0: group 1, but it is a mesh of group 0", [](M& m) { m.group = 1; });
  meshes(0, "mesh 0: group 4294967295, but the file has 2 groups", [](M& m) { m.group = kNone; });
  meshes(0, "mesh 0: material 2, but the file has 2 materials", [](M& m) { m.material = 2; });
  meshes(0, ErrorCode::kReserved, "mesh 0: attributes 31", [](M& m) { m.attributes |= 16; });
  meshes(1, "mesh 1: bounds that are not finite", [](M& m) { m.bounds_max[2] = kInfinity; });
  meshes(1, "mesh 1: bounds that are not finite", [](M& m) { m.bounds_min[0] = float(kNan); });
  meshes(2, "mesh 2: bounds from 0.5 to 0", [](M& m) { m.bounds_min[1] = 0.5f; });
  meshes(0, "mesh 0: position error -1", [](M& m) { m.max_position_error = -1; });
  meshes(0, "mesh 0: position error nan", [](M& m) { m.max_position_error = kNan; });
  meshes(1, "mesh 1: position error 1, but float32 positions", [](M& m) { m.max_position_error = 1; });
  meshes(0, "mesh 0: uv error inf", [](M& m) { m.max_uv_error = kInfinity; });
  meshes(0, "mesh 0: 25 lattice bits, expected at most 24", [](M& m) { m.lattice_bits[1] = 25; });
  const char* const lattice = "mesh 0: lattice from 0, step 2^128, whose points are no finite floats";
  meshes(0, lattice, [](M& m) { m.lattice_exponent = 128; });
  meshes(0, "mesh 0: lattice from 0, step 2^-2147483648, whose points are no finite floats",
         [](M& m) { m.lattice_exponent = INT32_MIN; });
  meshes(0, "mesh 0: lattice from 0, step 2^113, whose points are no finite floats",
         [](M& m) { m.lattice_exponent = 113; });
  meshes(0, "mesh 0: lattice from 4503599627370496, step 2^-10, whose points are no finite floats",
         [](M& m) { m.lattice_min[2] = int64_t{1} << 52; });
  meshes(0, "mesh 0: lattice from -9223372036854775808, step 2^-10, whose points are no finite floats",
         [](M& m) { m.lattice_min[2] = INT64_MIN; });
  meshes(1, ErrorCode::kReserved, "mesh 1: a lattice, but float32 positions", [](M& m) { m.lattice_min[0] = 1; });
  meshes(1, ErrorCode::kReserved, "mesh 1: a lattice, but float32 positions", [](M& m) { m.lattice_exponent = 1; });
  meshes(1, ErrorCode::kReserved, "mesh 1: a lattice, but float32 positions", [](M& m) { m.lattice_bits[2] = 1; });
  meshes(1, "mesh 1: position encoding 2", [](M& m) { m.position_encoding = PositionEncoding{2}; });
  meshes(1, "mesh 1: 1 chunks from 1, expected from 2 to at most 3", [](M& m) { m.first_chunk = 1; });
  meshes(1, "mesh 1: 2 chunks from 2, expected from 2 to at most 3", [](M& m) { m.chunk_count = 2; });
  meshes(1, "mesh 1: 18446744073709551615 chunks from 2, expected from 2 to at most 3",
         [](M& m) { m.chunk_count = UINT64_MAX; });
  meshes(0, "mesh 0: 229 triangles and 180 vertices, but its chunks have 228 and 180",
         [](M& m) { m.triangle_count += 1; });
  meshes(0, "mesh 0: 228 triangles and 179 vertices, but its chunks have 228 and 180",
         [](M& m) { m.vertex_count -= 1; });
  meshes(2, "mesh 2: 1 triangles and 0 vertices, but its chunks have 0 and 0", [](M& m) { m.triangle_count = 1; });
  meshes(1, "mesh 1: 18446744073709551615 vertices in its source", [](M& m) { m.source_vertex_count = UINT64_MAX; });
  // A chunk of no mesh.
  Parts parts = full_parts();
  parts.tables.chunks.push_back(parts.tables.chunks[2]);
  Breaker::expect(file_of(parts), "chunk 3: belongs to no mesh", ErrorCode::kRange);
}

TEST_CASE("container rules: clustered chunks", "[container]") {
  const Breaker b(full_parts());
  using C = ChunkRecord;
  const auto chunks = b.records<C>(TableKind::kChunks);
  // Chunk 0 has 100 triangles and 90 vertices.
  const auto clusters = [](uint32_t count, uint32_t words, uint32_t triangles = 100, uint32_t vertices = 90) {
    return [=](C& c) {
      c.encoding = ChunkEncoding::kClustered;
      c.index_min = 0;
      c.index_bits = 0;
      c.triangle_count = triangles;
      c.vertex_count = vertices;
      c.cluster_count = count;
      c.cluster_words = words;
    };
  };
  chunks(2, "chunk 2: clusters, but float32 positions", clusters(1, 100));
  chunks(0, ErrorCode::kReserved, "chunk 0: index fields are set, but it has clusters",
         [](C& c) { c.encoding = ChunkEncoding::kClustered; });
  chunks(0, "chunk 0: 0 clusters of 100 triangles", clusters(0, 0));
  chunks(0, "chunk 0: 101 clusters of 100 triangles", clusters(101, 200));
  chunks(0, "chunk 0: 1 clusters of 129 triangles", clusters(1, 200, 129));
  chunks(0, "chunk 0: 1 clusters of 129 vertices", clusters(1, 200, 100, 129));
  chunks(0, "chunk 0: 31 clusters of 90 vertices", clusters(31, 200));
  chunks(0, "chunk 0: 1 words of 2 clusters", clusters(2, 1));
  chunks(0, "chunk 0: 536870913 words of 1 clusters", clusters(1, (1u << 29) + 1));
  chunks(0, "chunk 0: positions from 5 of 15 bits, but the mesh's lattice has 14 bits",
         [&](C& c) { clusters(1, 200)(c), c.position_bits[2] = 15; });
}

TEST_CASE("container rules: chunks", "[container]") {
  const Breaker b(full_parts());
  using C = ChunkRecord;
  const auto chunks = b.records<C>(TableKind::kChunks);
  chunks(1, "chunk 1: page 3, but the file has 3 pages", [](C& c) { c.page = 3; });
  chunks(1, "chunk 1: page 2 is of kind 2, which holds no chunks", [](C& c) { c.page = 2; });
  chunks(1, "chunk 1: mesh 1, but it is a chunk of mesh 0", [](C& c) { c.mesh = 1; });
  chunks(1, "chunk 1: encoding 2", [](C& c) { c.encoding = ChunkEncoding{2}; });
  chunks(1, ErrorCode::kReserved, "chunk 1: cluster fields are set, but it is indexed",
         [](C& c) { c.cluster_words = 1; });
  chunks(1, ErrorCode::kReserved, "chunk 1: second uv bits are set, but the mesh has no second uv",
         [](C& c) { c.second_uv_bits[1] = 1; });
  chunks(1, ErrorCode::kReserved, "chunk 1: tangent bits are set, but the mesh has no tangents",
         [](C& c) { c.tangent_bits = 3; });
  chunks(1, "chunk 1: first triangle 0, but the chunks before have 100", [](C& c) { c.first_triangle = 0; });
  chunks(1, "chunk 1: no triangles", [](C& c) { c.triangle_count = 0; });
  chunks(1, "chunk 1: 90 vertices, but 29 triangles", [](C& c) { c.triangle_count = 29; });
  chunks(2, "chunk 2: 295 vertices, but 98 triangles", [](C& c) { c.vertex_count = 295; });
  chunks(0, "chunk 0: 1888 bytes, but its streams take 1872", [](C& c) { c.bytes += 16; });
  chunks(0, "chunk 0: offset 8 is no multiple of 16", [](C& c) { c.offset = 8; });
  chunks(1, "chunk 1: 1984 bytes at 1888 of page 0, which has 3856", [](C& c) { c.offset += 16; });
  chunks(1, "chunk 1: 1984 bytes at 18446744073709551600 of page 0, which has 3856",
         [](C& c) { c.offset = UINT64_MAX - 15; });

  chunks(0, "chunk 0: 33 index bits", [](C& c) { c.index_bits = 33; });
  chunks(0, "chunk 0: indices from 90 of 7 bits, but it has 90 vertices", [](C& c) { c.index_min = 90; });
  chunks(0, "chunk 0: indices from 26 of 7 bits, but it has 90 vertices", [](C& c) { c.index_min = 26; });
  chunks(0, "chunk 0: indices from 4294967295 of 7 bits, but it has 90 vertices",
         [](C& c) { c.index_min = UINT32_MAX; });
  chunks(0, "chunk 0: indices from 3 of 32 bits, but it has 90 vertices", [](C& c) { c.index_bits = 32; });
  chunks(0, "chunk 0: indices from 3 of 7 bits, but it has 0 vertices", [](C& c) { c.vertex_count = 0; });
  chunks(0, "chunk 0: 65537 triangles of 0 index bits, expected at most 65536",
         [](C& c) { c.triangle_count = 65537, c.index_bits = 0; });
  chunks(0, "chunk 0: positions from 5 of 25 bits, but the mesh's lattice has 16 bits",
         [](C& c) { c.position_bits[0] = 25; });
  chunks(0, "chunk 0: positions from 5 of 15 bits, but the mesh's lattice has 14 bits",
         [](C& c) { c.position_bits[2] = 15; });
  chunks(0, "chunk 0: positions from 8192 of 14 bits, but the mesh's lattice has 14 bits",
         [](C& c) { c.position_min[2] = 8192; });
  chunks(0, "chunk 0: positions from 4294967295 of 12 bits, but the mesh's lattice has 16 bits",
         [](C& c) { c.position_min[0] = UINT32_MAX; });
  chunks(2, "chunk 2: position bits or minimum, but float32 positions", [](C& c) { c.position_bits[1] = 24; });
  chunks(2, "chunk 2: position bits or minimum, but float32 positions", [](C& c) { c.position_min[1] = 1; });
  chunks(0, "chunk 0: 25 uv bits, expected at most 24", [](C& c) { c.uv_bits[1] = 25; });
  chunks(0, "chunk 0: uv lattice from -7, step 2^127, whose points are no finite floats",
         [](C& c) { c.uv_exponent = 127; });
  chunks(0, "chunk 0: uv lattice from -7, step 2^-150, whose points are no finite floats",
         [](C& c) { c.uv_exponent = -150; });
  chunks(0, "chunk 0: uv lattice from -4503599627370496, step 2^-16, whose points are no finite floats",
         [](C& c) { c.uv_min[1] = -(int64_t{1} << 52); });
  chunks(0, "chunk 0: 1 normal bits, expected 2 to 16", [](C& c) { c.normal_bits = 1; });
  chunks(0, "chunk 0: 17 normal bits, expected 2 to 16", [](C& c) { c.normal_bits = 17; });
  chunks(0, "chunk 0: source triangles from 0 of 33 bits", [](C& c) { c.source_bits = 33; });
  chunks(0, "chunk 0: source triangles from 18446744073709551615 of 9 bits", [](C& c) { c.source_min = UINT64_MAX; });
  const char* const uv = "chunk 2: uv fields are set, but the mesh has no uv";
  chunks(2, ErrorCode::kReserved, uv, [](C& c) { c.uv_min[0] = 1; });
  chunks(2, ErrorCode::kReserved, uv, [](C& c) { c.uv_exponent = 1; });
  chunks(2, ErrorCode::kReserved, uv, [](C& c) { c.uv_bits[0] = 1; });
  chunks(2, ErrorCode::kReserved, "chunk 2: normal bits are set, but the mesh has no normals",
         [](C& c) { c.normal_bits = 8; });
  const char* const ids = "chunk 2: source triangle fields are set, but the mesh has none";
  chunks(2, ErrorCode::kReserved, ids, [](C& c) { c.source_bits = 1; });
  chunks(2, ErrorCode::kReserved, ids, [](C& c) { c.source_min = 1; });
}

TEST_CASE("container rules: a chunk of all-equal indices and a large page for one chunk", "[container]") {
  Parts parts = tiny_parts();
  MeshRecord& mesh = parts.tables.meshes[0];
  ChunkRecord& chunk = parts.tables.chunks[0];
  const auto triangles = [&](uint32_t count, uint8_t bits) {
    mesh.triangle_count = chunk.triangle_count = count;
    mesh.vertex_count = chunk.vertex_count = 1;
    parts.tables.scenes[0].triangle_count = count;
    chunk.index_bits = bits;
    chunk.bytes = bits == 0 ? 0 : align_up((3 * uint64_t{count} * bits + 7) / 8 + 8, 16);
    for (uint8_t& b : chunk.position_bits) b = 0;
    parts.pages[0] = seal_page(PageKind::kGeometry, Bytes(chunk.bytes), 0);
    return verify_copy(file_of(parts));
  };
  CHECK(!triangles(1, 0));
  CHECK(!triangles(65536, 0));
  CHECK(triangles(65537, 0));
  CHECK(!triangles(65537, 1));
  CHECK(triangles(65537, 2));  // with one vertex, a second bit has no meaning

  CHECK(!triangles(3000000, 1));  // 1.1 MB in a page of its own
  REQUIRE(chunk.bytes > kPageTargetBytes);
  parts.pages[0] = seal_page(PageKind::kGeometry, Bytes(chunk.bytes + 16), 0);
  Breaker::expect(file_of(parts),
                  "chunk 0: shares page 0, which has 1125024 bytes; only a page for one chunk may pass 1048576",
                  ErrorCode::kRange);
}

TEST_CASE("container rules: coordinates near the largest float are no error", "[container]") {
  Parts parts = tiny_parts();
  MeshRecord& mesh = parts.tables.meshes[0];
  mesh.lattice_exponent = 126;  // x: 0 to 2^127; one more code, 3 x 2^126, would be allowed, but not 4 x 2^126
  mesh.bounds_max[0] = std::ldexp(1.0f, 127);
  CHECK(!verify_copy(file_of(parts)));
  mesh.lattice_exponent = 127;
  CHECK(verify_copy(file_of(parts)));
}

TEST_CASE("container rules: groups and nodes", "[container]") {
  const Breaker b(full_parts());
  using G = GroupRecord;
  using N = NodeRecord;
  const uint32_t end = b.string_bytes();
  const auto name = [&](const char* place) { return b.bad_string(place, end); };
  const auto groups = b.records<G>(TableKind::kGroups);
  groups(1, name("group 1"), [&](G& r) { r.name = end; });
  groups(1, ErrorCode::kReserved, "group 1: a reserved field is set", [](G& r) { r.reserved = 1; });
  groups(1, "group 1: 1 meshes from 1, expected from 2 to at most 3", [](G& r) { r.first_mesh = 1; });
  groups(1, "group 1: 4294967295 meshes from 2, expected from 2 to at most 3", [](G& r) { r.mesh_count = UINT32_MAX; });
  groups(1, "mesh 2: belongs to no group", [](G& r) { r.mesh_count = 0; });

  const auto nodes = b.records<N>(TableKind::kNodes);
  nodes(1, name("node 1"), [&](N& n) { n.name = end; });
  nodes(1, "node 1: parent 1, expected a node before it", [](N& n) { n.parent = 1; });
  nodes(0, "node 0: parent 3, expected a node before it", [](N& n) { n.parent = 3; });
  nodes(1, "node 1: group 2, but the file has 2 groups", [](N& n) { n.group = 2; });
  nodes(1, "node 1: camera 2, but the file has 2 cameras", [](N& n) { n.camera = 2; });
  nodes(1, ErrorCode::kReserved, "node 1: a reserved field or flag is set", [](N& n) { n.flags = 2; });
  nodes(1, ErrorCode::kReserved, "node 1: a reserved field or flag is set", [](N& n) { n.reserved = 2; });
  nodes(2, "node 2: 3 node instances from 0, but the file has 2", [](N& n) { n.node_instance_count = 3; });
  nodes(2, "node 2: 2 node instances from 18446744073709551615, but the file has 2",
        [](N& n) { n.first_node_instance = UINT64_MAX; });
  nodes(0, "node 0: a transform that is not finite", [](N& n) { n.local[15] = kNan; });
  nodes(1, "node 1: a transform that is not finite", [](N& n) { n.local[0] = HUGE_VAL; });
  nodes(1, ErrorCode::kReserved, "node 1: more than translation, rotation and scale", [](N& n) { n.local[10] = 1; });
  using I = NodeInstanceRecord;
  const auto node_instances = b.records<I>(TableKind::kNodeInstances);
  node_instances(1, "node instance 1: a transform that is not finite", [](I& i) { i.translation[2] = kInfinity; });
  node_instances(1, "node instance 1: a transform that is not finite", [](I& i) { i.rotation[3] = kInfinity; });
  node_instances(1, "node instance 1: a transform that is not finite", [](I& i) { i.scale[0] = float(kNan); });
}

TEST_CASE("container rules: instances and scenes", "[container]") {
  const Breaker b(full_parts());
  using I = InstanceRecord;
  const auto instances = b.records<I>(TableKind::kInstances);
  instances(0, "instance 0: mesh 3, but the file has 3 meshes", [](I& i) { i.mesh = 3; });
  instances(0, "instance 0: node 4, but the file has 4 nodes", [](I& i) { i.node = 4; });
  instances(0, "instance 0: matrix 2, but the file has 2 matrices", [](I& i) { i.matrix = 2; });
  instances(0, "instance 0: mesh 0 of group 0, but node 3 has group 1", [](I& i) { i.node = 3; });
  instances(0, "instance 0: mesh 0 of group 0, but node 0 has group 4294967295", [](I& i) { i.node = 0; });
  instances(0, "instance 0: node instance 1, but node 1 has 0", [](I& i) { i.node_instance = 1; });
  instances(1, "instance 1: node instance 2, but node 2 has 2", [](I& i) { i.node_instance = 2; });
  instances(0, "instance 1: mesh 0 after mesh 1, expected ascending order", [](I& i) { i.mesh = 1; });
  using M = MatrixRecord;
  const auto matrices = b.records<M>(TableKind::kMatrices);
  matrices(1, "matrix 1: not finite", [](M& m) { m.rows[2][3] = kNan; });

  using S = SceneRecord;
  const auto scenes = b.records<S>(TableKind::kScenes);
  scenes(1, ErrorCode::kReserved, "scene 1: flags 2", [](S& r) { r.flags = 2; });
  scenes(0, "scene 1: a second default scene", [](S& r) { r.flags = 1; });
  scenes(0, "scene 0: 4 roots from 0, but the file has 3", [](S& r) { r.root_count = 4; });
  scenes(0, "scene 0: 1 roots from 18446744073709551615, but the file has 3", [](S& r) { r.first_root = UINT64_MAX; });
  scenes(1, "scene 1: 2 instances from 3, expected from 4 to at most 6", [](S& r) { r.first_instance = 3; });
  scenes(1, "scene 1: 18446744073709551615 instances from 4, expected from 4 to at most 6",
         [](S& r) { r.instance_count = UINT64_MAX; });
  scenes(1, "instance 5: belongs to no scene", [](S& r) { r.instance_count = 1; });
  scenes(0, "scene 0: 783 triangles, but its instances have 782", [](S& r) { r.triangle_count += 1; });
  scenes(0, b.bad_string("scene 0", UINT32_MAX), [](S& r) { r.name = UINT32_MAX; });
  const auto roots = b.records<uint32_t>(TableKind::kSceneRoots);
  roots(2, "scene root 2: node 4, but the file has 4 nodes", [](uint32_t& root) { root = 4; });
}

TEST_CASE("container rules: materials, textures, images, cameras, source", "[container]") {
  const Breaker b(full_parts());
  const uint32_t end = b.string_bytes();
  const auto name = [&](const char* place) { return b.bad_string(place, end); };
  using M = MaterialRecord;
  const auto materials = b.records<M>(TableKind::kMaterials);
  materials(0, name("material 0"), [&](M& r) { r.name = end; });
  materials(1, "material 1: texture 1, but the file has 1 textures", [](M& r) { r.texture = 1; });
  materials(1, ErrorCode::kReserved, "material 1: a reserved field or flag is set", [](M& r) { r.flags |= 16; });
  materials(1, ErrorCode::kReserved, "material 1: a reserved field or flag is set", [](M& r) { r.reserved = 1; });
  const char* const factor = "material 1: a factor that is not finite";
  materials(1, factor, [](M& r) { r.base_color[3] = kInfinity; });
  materials(1, factor, [](M& r) { r.uv_offset[1] = kInfinity; });
  materials(1, factor, [](M& r) { r.uv_scale[1] = kInfinity; });
  materials(1, factor, [](M& r) { r.uv_rotation = kInfinity; });
  materials(1, factor, [](M& r) { r.alpha_cutoff = float(kNan); });

  using T = TextureRecord;
  const auto textures = b.records<T>(TableKind::kTextures);
  textures(0, name("texture 0"), [&](T& r) { r.name = end; });
  textures(0, "texture 0: image 4294967295, but the file has 1 images", [](T& r) { r.image = kNone; });
  textures(0, "texture 0: wrap 3 and 2", [](T& r) { r.wrap_s = Wrap{3}; });
  textures(0, "texture 0: wrap 1 and 65535", [](T& r) { r.wrap_t = Wrap{65535}; });
  textures(0, "texture 0: filters 9984 and 9987", [](T& r) { r.mag_filter = 9984; });
  textures(0, "texture 0: filters 9729 and 9988", [](T& r) { r.min_filter = 9988; });

  using I = ImageRecord;
  const auto images = b.records<I>(TableKind::kImages);
  images(0, name("image 0"), [&](I& r) { r.name = end; });
  images(0, "image 0: page 3, but the file has 3 pages", [](I& r) { r.page = 3; });
  images(0, "image 0: page 0 is of kind 1, which holds no image", [](I& r) { r.page = 0; });
  images(0, "image 0: codec 0", [](I& r) { r.codec = ImageCodec{0}; });
  images(0, "image 0: codec 5", [](I& r) { r.codec = ImageCodec{5}; });
  images(0, "image 0: 0 x 480 pixels, expected 1 to 16777216", [](I& r) { r.width = 0; });
  images(0, "image 0: 640 x 4294967295 pixels, expected 1 to 16777216", [](I& r) { r.height = UINT32_MAX; });
  images(0, "image 0: 0 channels", [](I& r) { r.channels = 0; });
  images(0, "image 0: 5 channels", [](I& r) { r.channels = 5; });
  images(0, ErrorCode::kReserved, "image 0: block format 7 and swizzle 0 of an image that has no blocks",
         [](I& r) { r.block_format = BlockFormat::kBc7; });
  images(0, ErrorCode::kReserved, "image 0: block format 0 and swizzle 1 of an image that has no blocks",
         [](I& r) { r.swizzle = 1; });
  images(0, "image 0: mip levels from 2, expected 4294967295", [](I& r) { r.first_level = 2; });
  images(0, "image 0: 1 mip levels, expected 0", [](I& r) { r.level_count = 1; });

  using C = CameraRecord;
  const auto cameras = b.records<C>(TableKind::kCameras);
  cameras(0, name("camera 0"), [&](C& r) { r.name = end; });
  cameras(0, "camera 0: kind 3", [](C& r) { r.kind = CameraKind{3}; });
  cameras(0, "camera 0: angle 0", [](C& r) { r.y = 0; });
  cameras(0, "camera 0: angle 3.2", [](C& r) { r.y = 3.2; });
  cameras(0, "camera 0: aspect ratio -1", [](C& r) { r.x = -1; });
  cameras(0, "camera 0: depths from 0 to 0", [](C& r) { r.z_near = 0; });
  cameras(0, "camera 0: depths from 0.1 to 0.1", [](C& r) { r.z_far = 0.1; });
  cameras(0, "camera 0: a number that is not finite", [](C& r) { r.z_far = HUGE_VAL; });
  cameras(1, "camera 1: size 0 by 10", [](C& r) { r.x = 0; });
  cameras(1, "camera 1: depths from -1 to 100", [](C& r) { r.z_near = -1; });
  cameras(1, "camera 1: depths from 0 to 0", [](C& r) { r.z_far = 0; });

  using S = SourceRecord;
  const auto sources = b.records<S>(TableKind::kSource);
  sources(0, name("source 0"), [&](S& r) { r.name = end; });
  sources(0, name("source 0"), [&](S& r) { r.options = end; });
  sources(0, name("source 0"), [&](S& r) { r.generator = end; });
  sources(0, name("source 0"), [&](S& r) { r.copyright = end; });
  using L = LeftOutRecord;
  const auto left_out = b.records<L>(TableKind::kLeftOut);
  left_out(1, name("left-out 1"), [&](L& r) { r.what = end; });
  left_out(1, ErrorCode::kReserved, "left-out 1: a reserved field is set", [&](L& r) { r.reserved = 1; });
}

TEST_CASE("container rules: costs of left-out data, one each or none", "[container]") {
  Parts parts = full_parts();
  REQUIRE(parts.tables.left_out.size() == 2);
  for (const size_t count : {0, 1, 2, 3}) {
    parts.tables.left_out_costs.assign(count, 7);
    const auto opened = Container::open(file_of(parts));
    CHECK(static_cast<bool>(opened) == (count == 0 || count == 2));
    if (!opened)
      CHECK(opened.error().message.find("left-out costs: " + std::to_string(count) + " records, expected 2") == 0);
  }
}

TEST_CASE("container rules: counts of triangles", "[container]") {
  // Triangles with index bits take bytes.
  Parts parts = tiny_parts();
  parts.tables.meshes[0].triangle_count = parts.tables.chunks[0].triangle_count = UINT32_MAX;
  parts.tables.chunks[0].bytes = 0;
  Breaker::expect(file_of(parts), "chunk 0: 0 bytes, but its streams take 3221225504", ErrorCode::kRange);

  // A scene with more triangles than 36-bit ids is a valid file.
  parts = tiny_parts();
  TableSet& tables = parts.tables;
  ChunkRecord& chunk = tables.chunks[0];
  chunk.triangle_count = kMaxChunkTriangles;
  chunk.index_bits = 0;
  chunk.bytes = 16;
  tables.chunks.resize(16, chunk);
  for (uint32_t i = 0; i < 16; ++i) tables.chunks[i].first_triangle = uint64_t{i} * kMaxChunkTriangles;
  tables.meshes[0].chunk_count = 16;
  tables.meshes[0].triangle_count = 16 * uint64_t{kMaxChunkTriangles};
  tables.meshes[0].vertex_count = 16 * 3;
  tables.instances.resize(65537, tables.instances[0]);
  tables.scenes[0].instance_count = tables.instances.size();
  tables.scenes[0].triangle_count = tables.instances.size() * tables.meshes[0].triangle_count;
  REQUIRE(tables.scenes[0].triangle_count > uint64_t{1} << 36);
  CHECK(!verify_copy(file_of(parts)));
}

}  // namespace
}  // namespace scree::tests
