// Every rule of spec/container.md for a record's fields is broken once, and open() must give the record.
#include <cmath>
#include <limits>

#include "format/blocks/format.h"
#include "format/bytes.h"
#include "format/container/container.h"
#include "tests/catch.h"
#include "tests/format/container/container_breaker.h"

namespace scree::tests {
namespace {

using namespace scree::format;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr float kInfinity = std::numeric_limits<float>::infinity();

TEST_CASE("container rules: meshes", "[container]") {
  const Breaker b(full_parts());
  using M = MeshRecord;
  constexpr TableKind k = TableKind::kMeshes;
  b.record<M>(
      k, 0, [](M& m) { m.group = 2; }, "mesh 0: group 2, but the file has 2 groups");
  b.record<M>(
      k, 0, [](M& m) { m.group = 1; }, "mesh 0: group 1, but it is a mesh of group 0");
  b.record<M>(
      k, 0, [](M& m) { m.group = kNone; }, "mesh 0: group 4294967295, but the file has 2 groups");
  b.record<M>(
      k, 0, [](M& m) { m.material = 2; }, "mesh 0: material 2, but the file has 2 materials");
  b.record<M>(
      k, 0, [](M& m) { m.attributes |= 16; }, "mesh 0: attributes 31", ErrorCode::kReserved);
  b.record<M>(
      k, 1, [](M& m) { m.bounds_max[2] = kInfinity; }, "mesh 1: bounds that are not finite");
  b.record<M>(
      k, 1, [](M& m) { m.bounds_min[0] = float(kNan); }, "mesh 1: bounds that are not finite");
  b.record<M>(
      k, 2, [](M& m) { m.bounds_min[1] = 0.5f; }, "mesh 2: bounds from 0.5 to 0");
  b.record<M>(
      k, 0, [](M& m) { m.max_position_error = -1; }, "mesh 0: position error -1");
  b.record<M>(
      k, 0, [](M& m) { m.max_position_error = kNan; }, "mesh 0: position error nan");
  b.record<M>(
      k, 1, [](M& m) { m.max_position_error = 1; }, "mesh 1: position error 1, but float32 positions");
  b.record<M>(
      k, 0, [](M& m) { m.max_uv_error = kInfinity; }, "mesh 0: uv error inf");
  b.record<M>(
      k, 0, [](M& m) { m.lattice_bits[1] = 25; }, "mesh 0: 25 lattice bits, expected at most 24");
  const char* const lattice = "mesh 0: lattice from 0, step 2^128, whose points are no finite floats";
  b.record<M>(
      k, 0, [](M& m) { m.lattice_exponent = 128; }, lattice);
  b.record<M>(
      k, 0, [](M& m) { m.lattice_exponent = INT32_MIN; },
      "mesh 0: lattice from 0, step 2^-2147483648, whose points are no finite floats");
  b.record<M>(
      k, 0, [](M& m) { m.lattice_exponent = 113; },
      "mesh 0: lattice from 0, step 2^113, whose points are no finite floats");
  b.record<M>(
      k, 0, [](M& m) { m.lattice_min[2] = int64_t{1} << 52; },
      "mesh 0: lattice from 4503599627370496, step 2^-10, whose points are no finite floats");
  b.record<M>(
      k, 0, [](M& m) { m.lattice_min[2] = INT64_MIN; },
      "mesh 0: lattice from -9223372036854775808, step 2^-10, whose points are no finite floats");
  b.record<M>(
      k, 1, [](M& m) { m.lattice_min[0] = 1; }, "mesh 1: a lattice, but float32 positions", ErrorCode::kReserved);
  b.record<M>(
      k, 1, [](M& m) { m.lattice_exponent = 1; }, "mesh 1: a lattice, but float32 positions", ErrorCode::kReserved);
  b.record<M>(
      k, 1, [](M& m) { m.lattice_bits[2] = 1; }, "mesh 1: a lattice, but float32 positions", ErrorCode::kReserved);
  b.record<M>(
      k, 1, [](M& m) { m.position_encoding = PositionEncoding{2}; }, "mesh 1: position encoding 2");
  b.record<M>(
      k, 1, [](M& m) { m.first_chunk = 1; }, "mesh 1: 1 chunks from 1, expected from 2 to at most 3");
  b.record<M>(
      k, 1, [](M& m) { m.chunk_count = 2; }, "mesh 1: 2 chunks from 2, expected from 2 to at most 3");
  b.record<M>(
      k, 1, [](M& m) { m.chunk_count = UINT64_MAX; },
      "mesh 1: 18446744073709551615 chunks from 2, expected from 2 to at most 3");
  b.record<M>(
      k, 0, [](M& m) { m.triangle_count += 1; },
      "mesh 0: 229 triangles and 180 vertices, but its chunks have 228 and 180");
  b.record<M>(
      k, 0, [](M& m) { m.vertex_count -= 1; },
      "mesh 0: 228 triangles and 179 vertices, but its chunks have 228 and 180");
  b.record<M>(
      k, 2, [](M& m) { m.triangle_count = 1; }, "mesh 2: 1 triangles and 0 vertices, but its chunks have 0 and 0");
  b.record<M>(
      k, 1, [](M& m) { m.source_vertex_count = UINT64_MAX; }, "mesh 1: 18446744073709551615 vertices in its source");
  // A chunk that belongs to no mesh.
  Parts parts = full_parts();
  parts.tables.chunks.push_back(parts.tables.chunks[2]);
  Breaker::expect(file_of(parts), "chunk 3: belongs to no mesh", ErrorCode::kRange);
}

TEST_CASE("container rules: clustered chunks", "[container]") {
  const Breaker b(full_parts());
  using C = ChunkRecord;
  constexpr TableKind k = TableKind::kChunks;
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
  b.record<C>(k, 2, clusters(1, 100), "chunk 2: clusters, but float32 positions");
  b.record<C>(
      k, 0, [](C& c) { c.encoding = ChunkEncoding::kClustered; }, "chunk 0: index fields are set, but it has clusters",
      ErrorCode::kReserved);
  b.record<C>(k, 0, clusters(0, 0), "chunk 0: 0 clusters of 100 triangles");
  b.record<C>(k, 0, clusters(101, 200), "chunk 0: 101 clusters of 100 triangles");
  b.record<C>(k, 0, clusters(1, 200, 129), "chunk 0: 1 clusters of 129 triangles");
  b.record<C>(k, 0, clusters(1, 200, 100, 129), "chunk 0: 1 clusters of 129 vertices");
  b.record<C>(k, 0, clusters(31, 200), "chunk 0: 31 clusters of 90 vertices");
  b.record<C>(k, 0, clusters(2, 1), "chunk 0: 1 words of 2 clusters");
  b.record<C>(k, 0, clusters(1, (1u << 29) + 1), "chunk 0: 536870913 words of 1 clusters");
  b.record<C>(
      k, 0, [&](C& c) { clusters(1, 200)(c), c.position_bits[2] = 15; },
      "chunk 0: positions from 5 of 15 bits, but the mesh's lattice has 14 bits");
}

TEST_CASE("container rules: chunks", "[container]") {
  const Breaker b(full_parts());
  using C = ChunkRecord;
  constexpr TableKind k = TableKind::kChunks;
  b.record<C>(
      k, 1, [](C& c) { c.page = 3; }, "chunk 1: page 3, but the file has 3 pages");
  b.record<C>(
      k, 1, [](C& c) { c.page = 2; }, "chunk 1: page 2 is of kind 2, which holds no chunks");
  b.record<C>(
      k, 1, [](C& c) { c.mesh = 1; }, "chunk 1: mesh 1, but it is a chunk of mesh 0");
  b.record<C>(
      k, 1, [](C& c) { c.encoding = ChunkEncoding{2}; }, "chunk 1: encoding 2");
  b.record<C>(
      k, 1, [](C& c) { c.cluster_words = 1; }, "chunk 1: cluster fields are set, but it is indexed",
      ErrorCode::kReserved);
  b.record<C>(
      k, 1, [](C& c) { c.second_uv_bits[1] = 1; }, "chunk 1: second uv bits are set, but the mesh has no second uv",
      ErrorCode::kReserved);
  b.record<C>(
      k, 1, [](C& c) { c.tangent_bits = 3; }, "chunk 1: tangent bits are set, but the mesh has no tangents",
      ErrorCode::kReserved);
  b.record<C>(
      k, 1, [](C& c) { c.first_triangle = 0; }, "chunk 1: first triangle 0, but the chunks before have 100");
  b.record<C>(
      k, 1, [](C& c) { c.triangle_count = 0; }, "chunk 1: no triangles");
  b.record<C>(
      k, 1, [](C& c) { c.triangle_count = 29; }, "chunk 1: 90 vertices, but 29 triangles");
  b.record<C>(
      k, 2, [](C& c) { c.vertex_count = 295; }, "chunk 2: 295 vertices, but 98 triangles");
  b.record<C>(
      k, 0, [](C& c) { c.bytes += 16; }, "chunk 0: 1888 bytes, but its streams take 1872");
  b.record<C>(
      k, 0, [](C& c) { c.offset = 8; }, "chunk 0: offset 8 is no multiple of 16");
  b.record<C>(
      k, 1, [](C& c) { c.offset += 16; }, "chunk 1: 1984 bytes at 1888 of page 0, which has 3856");
  b.record<C>(
      k, 1, [](C& c) { c.offset = UINT64_MAX - 15; },
      "chunk 1: 1984 bytes at 18446744073709551600 of page 0, which has 3856");

  b.record<C>(
      k, 0, [](C& c) { c.index_bits = 33; }, "chunk 0: 33 index bits");
  b.record<C>(
      k, 0, [](C& c) { c.index_min = 90; }, "chunk 0: indices from 90 of 7 bits, but it has 90 vertices");
  b.record<C>(
      k, 0, [](C& c) { c.index_min = 26; }, "chunk 0: indices from 26 of 7 bits, but it has 90 vertices");
  b.record<C>(
      k, 0, [](C& c) { c.index_min = UINT32_MAX; },
      "chunk 0: indices from 4294967295 of 7 bits, but it has 90 vertices");
  b.record<C>(
      k, 0, [](C& c) { c.index_bits = 32; }, "chunk 0: indices from 3 of 32 bits, but it has 90 vertices");
  b.record<C>(
      k, 0, [](C& c) { c.vertex_count = 0; }, "chunk 0: indices from 3 of 7 bits, but it has 0 vertices");
  b.record<C>(
      k, 0, [](C& c) { c.triangle_count = 65537, c.index_bits = 0; },
      "chunk 0: 65537 triangles of 0 index bits, expected at most 65536");
  b.record<C>(
      k, 0, [](C& c) { c.position_bits[0] = 25; },
      "chunk 0: positions from 5 of 25 bits, but the mesh's lattice has 16 bits");
  b.record<C>(
      k, 0, [](C& c) { c.position_bits[2] = 15; },
      "chunk 0: positions from 5 of 15 bits, but the mesh's lattice has 14 bits");
  b.record<C>(
      k, 0, [](C& c) { c.position_min[2] = 8192; },
      "chunk 0: positions from 8192 of 14 bits, but the mesh's lattice has 14 bits");
  b.record<C>(
      k, 0, [](C& c) { c.position_min[0] = UINT32_MAX; },
      "chunk 0: positions from 4294967295 of 12 bits, but the mesh's lattice has 16 bits");
  b.record<C>(
      k, 2, [](C& c) { c.position_bits[1] = 24; }, "chunk 2: position bits or minimum, but float32 positions");
  b.record<C>(
      k, 2, [](C& c) { c.position_min[1] = 1; }, "chunk 2: position bits or minimum, but float32 positions");
  b.record<C>(
      k, 0, [](C& c) { c.uv_bits[1] = 25; }, "chunk 0: 25 uv bits, expected at most 24");
  b.record<C>(
      k, 0, [](C& c) { c.uv_exponent = 127; },
      "chunk 0: uv lattice from -7, step 2^127, whose points are no finite floats");
  b.record<C>(
      k, 0, [](C& c) { c.uv_exponent = -150; },
      "chunk 0: uv lattice from -7, step 2^-150, whose points are no finite floats");
  b.record<C>(
      k, 0, [](C& c) { c.uv_min[1] = -(int64_t{1} << 52); },
      "chunk 0: uv lattice from -4503599627370496, step 2^-16, whose points are no finite floats");
  b.record<C>(
      k, 0, [](C& c) { c.normal_bits = 1; }, "chunk 0: 1 normal bits, expected 2 to 16");
  b.record<C>(
      k, 0, [](C& c) { c.normal_bits = 17; }, "chunk 0: 17 normal bits, expected 2 to 16");
  b.record<C>(
      k, 0, [](C& c) { c.source_bits = 33; }, "chunk 0: source triangles from 0 of 33 bits");
  b.record<C>(
      k, 0, [](C& c) { c.source_min = UINT64_MAX; }, "chunk 0: source triangles from 18446744073709551615 of 9 bits");
  const char* const uv = "chunk 2: uv fields are set, but the mesh has no uv";
  b.record<C>(
      k, 2, [](C& c) { c.uv_min[0] = 1; }, uv, ErrorCode::kReserved);
  b.record<C>(
      k, 2, [](C& c) { c.uv_exponent = 1; }, uv, ErrorCode::kReserved);
  b.record<C>(
      k, 2, [](C& c) { c.uv_bits[0] = 1; }, uv, ErrorCode::kReserved);
  b.record<C>(
      k, 2, [](C& c) { c.normal_bits = 8; }, "chunk 2: normal bits are set, but the mesh has no normals",
      ErrorCode::kReserved);
  const char* const ids = "chunk 2: source triangle fields are set, but the mesh has none";
  b.record<C>(
      k, 2, [](C& c) { c.source_bits = 1; }, ids, ErrorCode::kReserved);
  b.record<C>(
      k, 2, [](C& c) { c.source_min = 1; }, ids, ErrorCode::kReserved);
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
  const auto strings =
      std::to_string(load<TocEntry>(b.file().data() + toc_entry_offset(b.file(), TableKind::kStrings)).record_count);
  const uint32_t end = static_cast<uint32_t>(std::stoul(strings));
  const auto name = [&](const char* place) {
    return place + (": string at " + strings) + ", but the strings take " + strings + " bytes";
  };
  constexpr TableKind g = TableKind::kGroups;
  b.record<G>(
      g, 1, [&](G& r) { r.name = end; }, name("group 1").c_str());
  b.record<G>(
      g, 1, [](G& r) { r.reserved = 1; }, "group 1: a reserved field is set", ErrorCode::kReserved);
  b.record<G>(
      g, 1, [](G& r) { r.first_mesh = 1; }, "group 1: 1 meshes from 1, expected from 2 to at most 3");
  b.record<G>(
      g, 1, [](G& r) { r.mesh_count = UINT32_MAX; }, "group 1: 4294967295 meshes from 2, expected from 2 to at most 3");
  b.record<G>(
      g, 1, [](G& r) { r.mesh_count = 0; }, "mesh 2: belongs to no group");

  constexpr TableKind k = TableKind::kNodes;
  b.record<N>(
      k, 1, [&](N& n) { n.name = end; }, name("node 1").c_str());
  b.record<N>(
      k, 1, [](N& n) { n.parent = 1; }, "node 1: parent 1, expected a node before it");
  b.record<N>(
      k, 0, [](N& n) { n.parent = 3; }, "node 0: parent 3, expected a node before it");
  b.record<N>(
      k, 1, [](N& n) { n.group = 2; }, "node 1: group 2, but the file has 2 groups");
  b.record<N>(
      k, 1, [](N& n) { n.camera = 2; }, "node 1: camera 2, but the file has 2 cameras");
  b.record<N>(
      k, 1, [](N& n) { n.flags = 2; }, "node 1: a reserved field or flag is set", ErrorCode::kReserved);
  b.record<N>(
      k, 1, [](N& n) { n.reserved = 2; }, "node 1: a reserved field or flag is set", ErrorCode::kReserved);
  b.record<N>(
      k, 2, [](N& n) { n.node_instance_count = 3; }, "node 2: 3 node instances from 0, but the file has 2");
  b.record<N>(
      k, 2, [](N& n) { n.first_node_instance = UINT64_MAX; },
      "node 2: 2 node instances from 18446744073709551615, but the file has 2");
  b.record<N>(
      k, 0, [](N& n) { n.local[15] = kNan; }, "node 0: a transform that is not finite");
  b.record<N>(
      k, 1, [](N& n) { n.local[0] = HUGE_VAL; }, "node 1: a transform that is not finite");
  b.record<N>(
      k, 1, [](N& n) { n.local[10] = 1; }, "node 1: more than translation, rotation and scale", ErrorCode::kReserved);
  using I = NodeInstanceRecord;
  b.record<I>(
      TableKind::kNodeInstances, 1, [](I& i) { i.translation[2] = kInfinity; },
      "node instance 1: a transform that is not finite");
  b.record<I>(
      TableKind::kNodeInstances, 1, [](I& i) { i.rotation[3] = kInfinity; },
      "node instance 1: a transform that is not finite");
  b.record<I>(
      TableKind::kNodeInstances, 1, [](I& i) { i.scale[0] = float(kNan); },
      "node instance 1: a transform that is not finite");
}

TEST_CASE("container rules: instances and scenes", "[container]") {
  const Breaker b(full_parts());
  using I = InstanceRecord;
  constexpr TableKind k = TableKind::kInstances;
  b.record<I>(
      k, 0, [](I& i) { i.mesh = 3; }, "instance 0: mesh 3, but the file has 3 meshes");
  b.record<I>(
      k, 0, [](I& i) { i.node = 4; }, "instance 0: node 4, but the file has 4 nodes");
  b.record<I>(
      k, 0, [](I& i) { i.matrix = 2; }, "instance 0: matrix 2, but the file has 2 matrices");
  b.record<I>(
      k, 0, [](I& i) { i.node = 3; }, "instance 0: mesh 0 of group 0, but node 3 has group 1");
  b.record<I>(
      k, 0, [](I& i) { i.node = 0; }, "instance 0: mesh 0 of group 0, but node 0 has group 4294967295");
  b.record<I>(
      k, 0, [](I& i) { i.node_instance = 1; }, "instance 0: node instance 1, but node 1 has 0");
  b.record<I>(
      k, 1, [](I& i) { i.node_instance = 2; }, "instance 1: node instance 2, but node 2 has 2");
  b.record<I>(
      k, 0, [](I& i) { i.mesh = 1; }, "instance 1: mesh 0 after mesh 1, expected ascending order");
  using M = MatrixRecord;
  b.record<M>(
      TableKind::kMatrices, 1, [](M& m) { m.rows[2][3] = kNan; }, "matrix 1: not finite");

  using S = SceneRecord;
  constexpr TableKind s = TableKind::kScenes;
  b.record<S>(
      s, 1, [](S& r) { r.flags = 2; }, "scene 1: flags 2", ErrorCode::kReserved);
  b.record<S>(
      s, 0, [](S& r) { r.flags = 1; }, "scene 1: a second default scene");
  b.record<S>(
      s, 0, [](S& r) { r.root_count = 4; }, "scene 0: 4 roots from 0, but the file has 3");
  b.record<S>(
      s, 0, [](S& r) { r.first_root = UINT64_MAX; }, "scene 0: 1 roots from 18446744073709551615, but the file has 3");
  b.record<S>(
      s, 1, [](S& r) { r.first_instance = 3; }, "scene 1: 2 instances from 3, expected from 4 to at most 6");
  b.record<S>(
      s, 1, [](S& r) { r.instance_count = UINT64_MAX; },
      "scene 1: 18446744073709551615 instances from 4, expected from 4 to at most 6");
  b.record<S>(
      s, 1, [](S& r) { r.instance_count = 1; }, "instance 5: belongs to no scene");
  b.record<S>(
      s, 0, [](S& r) { r.triangle_count += 1; }, "scene 0: 783 triangles, but its instances have 782");
  b.record<S>(
      s, 0, [](S& r) { r.name = UINT32_MAX; },
      ("scene 0: string at 4294967295, but the strings take " +
       std::to_string(load<TocEntry>(b.file().data() + toc_entry_offset(b.file(), TableKind::kStrings)).record_count) +
       " bytes")
          .c_str());
  b.record<uint32_t>(
      TableKind::kSceneRoots, 2, [](uint32_t& root) { root = 4; }, "scene root 2: node 4, but the file has 4 nodes");
}

TEST_CASE("container rules: materials, textures, images, cameras, source", "[container]") {
  const Breaker b(full_parts());
  const auto strings =
      std::to_string(load<TocEntry>(b.file().data() + toc_entry_offset(b.file(), TableKind::kStrings)).record_count);
  const uint32_t end = static_cast<uint32_t>(std::stoul(strings));
  const auto name = [&](const char* place) {
    return place + (": string at " + strings) + ", but the strings take " + strings + " bytes";
  };
  using M = MaterialRecord;
  constexpr TableKind m = TableKind::kMaterials;
  b.record<M>(
      m, 0, [&](M& r) { r.name = end; }, name("material 0").c_str());
  b.record<M>(
      m, 1, [](M& r) { r.texture = 1; }, "material 1: texture 1, but the file has 1 textures");
  b.record<M>(
      m, 1, [](M& r) { r.flags |= 16; }, "material 1: a reserved field or flag is set", ErrorCode::kReserved);
  b.record<M>(
      m, 1, [](M& r) { r.reserved = 1; }, "material 1: a reserved field or flag is set", ErrorCode::kReserved);
  const char* const factor = "material 1: a factor that is not finite";
  b.record<M>(
      m, 1, [](M& r) { r.base_color[3] = kInfinity; }, factor);
  b.record<M>(
      m, 1, [](M& r) { r.uv_offset[1] = kInfinity; }, factor);
  b.record<M>(
      m, 1, [](M& r) { r.uv_scale[1] = kInfinity; }, factor);
  b.record<M>(
      m, 1, [](M& r) { r.uv_rotation = kInfinity; }, factor);
  b.record<M>(
      m, 1, [](M& r) { r.alpha_cutoff = float(kNan); }, factor);

  using T = TextureRecord;
  constexpr TableKind t = TableKind::kTextures;
  b.record<T>(
      t, 0, [&](T& r) { r.name = end; }, name("texture 0").c_str());
  b.record<T>(
      t, 0, [](T& r) { r.image = kNone; }, "texture 0: image 4294967295, but the file has 1 images");
  b.record<T>(
      t, 0, [](T& r) { r.wrap_s = Wrap{3}; }, "texture 0: wrap 3 and 2");
  b.record<T>(
      t, 0, [](T& r) { r.wrap_t = Wrap{65535}; }, "texture 0: wrap 1 and 65535");
  b.record<T>(
      t, 0, [](T& r) { r.mag_filter = 9984; }, "texture 0: filters 9984 and 9987");
  b.record<T>(
      t, 0, [](T& r) { r.min_filter = 9988; }, "texture 0: filters 9729 and 9988");

  using I = ImageRecord;
  constexpr TableKind i = TableKind::kImages;
  b.record<I>(
      i, 0, [&](I& r) { r.name = end; }, name("image 0").c_str());
  b.record<I>(
      i, 0, [](I& r) { r.page = 3; }, "image 0: page 3, but the file has 3 pages");
  b.record<I>(
      i, 0, [](I& r) { r.page = 0; }, "image 0: page 0 is of kind 1, which holds no image");
  b.record<I>(
      i, 0, [](I& r) { r.codec = ImageCodec{0}; }, "image 0: codec 0");
  b.record<I>(
      i, 0, [](I& r) { r.codec = ImageCodec{5}; }, "image 0: codec 5");
  b.record<I>(
      i, 0, [](I& r) { r.width = 0; }, "image 0: 0 x 480 pixels, expected 1 to 16777216");
  b.record<I>(
      i, 0, [](I& r) { r.height = UINT32_MAX; }, "image 0: 640 x 4294967295 pixels, expected 1 to 16777216");
  b.record<I>(
      i, 0, [](I& r) { r.channels = 0; }, "image 0: 0 channels");
  b.record<I>(
      i, 0, [](I& r) { r.channels = 5; }, "image 0: 5 channels");
  b.record<I>(
      i, 0, [](I& r) { r.block_format = BlockFormat::kBc7; },
      "image 0: block format 7 and swizzle 0 of an image that has no blocks", ErrorCode::kReserved);
  b.record<I>(
      i, 0, [](I& r) { r.swizzle = 1; }, "image 0: block format 0 and swizzle 1 of an image that has no blocks",
      ErrorCode::kReserved);
  b.record<I>(
      i, 0, [](I& r) { r.first_level = 2; }, "image 0: mip levels from 2, expected 4294967295");
  b.record<I>(
      i, 0, [](I& r) { r.level_count = 1; }, "image 0: 1 mip levels, expected 0");

  using C = CameraRecord;
  constexpr TableKind c = TableKind::kCameras;
  b.record<C>(
      c, 0, [&](C& r) { r.name = end; }, name("camera 0").c_str());
  b.record<C>(
      c, 0, [](C& r) { r.kind = CameraKind{3}; }, "camera 0: kind 3");
  b.record<C>(
      c, 0, [](C& r) { r.y = 0; }, "camera 0: angle 0");
  b.record<C>(
      c, 0, [](C& r) { r.y = 3.2; }, "camera 0: angle 3.2");
  b.record<C>(
      c, 0, [](C& r) { r.x = -1; }, "camera 0: aspect ratio -1");
  b.record<C>(
      c, 0, [](C& r) { r.z_near = 0; }, "camera 0: depths from 0 to 0");
  b.record<C>(
      c, 0, [](C& r) { r.z_far = 0.1; }, "camera 0: depths from 0.1 to 0.1");
  b.record<C>(
      c, 0, [](C& r) { r.z_far = HUGE_VAL; }, "camera 0: a number that is not finite");
  b.record<C>(
      c, 1, [](C& r) { r.x = 0; }, "camera 1: size 0 by 10");
  b.record<C>(
      c, 1, [](C& r) { r.z_near = -1; }, "camera 1: depths from -1 to 100");
  b.record<C>(
      c, 1, [](C& r) { r.z_far = 0; }, "camera 1: depths from 0 to 0");

  using S = SourceRecord;
  b.record<S>(
      TableKind::kSource, 0, [&](S& r) { r.name = end; }, name("source 0").c_str());
  b.record<S>(
      TableKind::kSource, 0, [&](S& r) { r.options = end; }, name("source 0").c_str());
  b.record<S>(
      TableKind::kSource, 0, [&](S& r) { r.generator = end; }, name("source 0").c_str());
  b.record<S>(
      TableKind::kSource, 0, [&](S& r) { r.copyright = end; }, name("source 0").c_str());
  using L = LeftOutRecord;
  b.record<L>(
      TableKind::kLeftOut, 1, [&](L& r) { r.what = end; }, name("left-out 1").c_str());
  b.record<L>(
      TableKind::kLeftOut, 1, [&](L& r) { r.reserved = 1; }, "left-out 1: a reserved field is set",
      ErrorCode::kReserved);
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
TEST_CASE("container rules: indexed JPEGs and their mip levels", "[container]") {
  scree::tests::Parts parts = full_parts();
  // 300 x 130 has levels of 150 x 65 and 75 x 32 pixels; 60 x 60 has none.
  parts.pages.push_back(seal_page(PageKind::kImage, Bytes(96, std::byte{1}), 0));
  ImageRecord small = parts.tables.images[0];
  small.codec = ImageCodec::kIndexedJpeg;
  small.page = 3;
  small.width = small.height = 60;
  ImageRecord large = small;
  large.width = 300;
  large.height = 130;
  large.channels = 1;
  large.first_level = 0;
  large.level_count = 2;
  parts.tables.images.push_back(small);
  parts.tables.images.push_back(large);
  parts.tables.mip_levels = {{0, 64, 3, 2}, {64, 32, 3, 2}};
  const Breaker b(parts);

  using I = ImageRecord;
  constexpr TableKind i = TableKind::kImages;
  b.record<I>(
      i, 2, [](I& r) { r.width = 65536; }, "image 2: 65536 x 130 pixels, expected 1 to 65535");
  b.record<I>(
      i, 1, [](I& r) { r.channels = 2; }, "image 1: 2 channels");
  b.record<I>(
      i, 1, [](I& r) { r.channels = 4; }, "image 1: 4 channels");
  b.record<I>(
      i, 2, [](I& r) { r.level_count = 1; }, "image 2: 1 mip levels, expected 2");
  b.record<I>(
      i, 2, [](I& r) { r.level_count = UINT32_MAX; }, "image 2: 4294967295 mip levels, expected 2");
  b.record<I>(
      i, 2, [](I& r) { r.first_level = 1; }, "image 2: mip levels from 1, expected 0");
  b.record<I>(
      i, 1, [](I& r) { r.first_level = 0; }, "image 1: mip levels from 0, expected 4294967295");
  b.record<I>(
      i, 2, [](I& r) { r.width = 127, r.height = 1, r.level_count = 0, r.first_level = kNone; },
      "mip level 0: belongs to no image");
  b.record<I>(
      i, 2, [](I& r) { r.width = 600, r.level_count = 3; }, "image 2: mip level 2, but the file has 2 mip levels");

  using L = MipLevelRecord;
  constexpr TableKind l = TableKind::kMipLevels;
  b.record<L>(
      l, 1, [](L& r) { r.image = 1; }, "mip level 1: image 1, expected 2");
  b.record<L>(
      l, 0, [](L& r) { r.page = 4; }, "mip level 0: page 4, but the file has 4 pages");
  b.record<L>(
      l, 0, [](L& r) { r.page = 0; }, "mip level 0: page 0 is of kind 1, which holds no image");
  b.record<L>(
      l, 0, [](L& r) { r.offset = 8; }, "mip level 0: 64 bytes at byte 8 of page 3, which has 96");
  b.record<L>(
      l, 1, [](L& r) { r.bytes = 33; }, "mip level 1: 33 bytes at byte 64 of page 3, which has 96");
  b.record<L>(
      l, 1, [](L& r) { r.bytes = UINT64_MAX; },
      "mip level 1: 18446744073709551615 bytes at byte 64 of page 3, which has 96");
}

TEST_CASE("container rules: surfaces and lights", "[container]") {
  scree::tests::Parts parts = full_parts();
  SurfaceRecord surface{};
  surface.ior = 1.5f;
  for (SurfaceTexture& use : surface.textures) use = {kNone, {0, 0}, {1, 1}, 0};
  parts.tables.surfaces = {surface, surface};
  parts.tables.surfaces[1].material = 1;
  parts.tables.surfaces[1].textures[2].texture = 0;
  LightRecord spot{};
  spot.kind = LightKind::kSpot;
  spot.outer_cone = 1;
  parts.tables.lights = {spot};
  const Breaker b(parts);

  using S = SurfaceRecord;
  constexpr TableKind s = TableKind::kSurfaces;
  b.record<S>(
      s, 0, [](S& r) { r.material = 2; }, "surface 0: material 2, but the file has 2 materials");
  b.record<S>(
      s, 1, [](S& r) { r.material = 0; }, "surface 1: material 0, expected 1 or more");
  b.record<S>(
      s, 0, [](S& r) { r.second_uv = 1; }, "surface 0: second uv of textures 1", ErrorCode::kReserved);
  b.record<S>(
      s, 0, [](S& r) { r.specular_color[2] = kInfinity; }, "surface 0: a factor that is not finite");
  b.record<S>(
      s, 0, [](S& r) { r.metallic = 1.5f; }, "surface 0: a factor of 1.5, expected 0 to 1");
  b.record<S>(
      s, 0, [](S& r) { r.occlusion_strength = -1; }, "surface 0: a factor of -1, expected 0 to 1");
  b.record<S>(
      s, 0, [](S& r) { r.emission[1] = -1; }, "surface 0: a colour below 0");
  b.record<S>(
      s, 0, [](S& r) { r.ior = 0.5f; }, "surface 0: index of refraction 0.5, expected 0, or 1 or more");
  b.record<S>(
      s, 1, [](S& r) { r.textures[2].texture = 1; }, "surface 1: texture 1, but the file has 1 textures");
  b.record<S>(
      s, 1, [](S& r) { r.textures[5].uv_rotation = float(kNan); }, "surface 1: a texture transform that is not finite");

  using L = LightRecord;
  constexpr TableKind l = TableKind::kLights;
  b.record<L>(
      l, 0, [](L& r) { r.name = kNone; },
      ("light 0: string at 4294967295, but the strings take " + std::to_string(parts.tables.strings.bytes().size()) +
       " bytes")
          .c_str());
  b.record<L>(
      l, 0, [](L& r) { r.node = 4; }, "light 0: node 4, but the file has 4 nodes");
  b.record<L>(
      l, 0, [](L& r) { r.kind = LightKind{4}; }, "light 0: kind 4");
  b.record<L>(
      l, 0, [](L& r) { r.reserved2 = 1; }, "light 0: a reserved field is set", ErrorCode::kReserved);
  b.record<L>(
      l, 0, [](L& r) { r.range = kInfinity; }, "light 0: a number that is not finite");
  b.record<L>(
      l, 0, [](L& r) { r.intensity = -2; }, "light 0: -2, expected 0 or more");
  b.record<L>(
      l, 0, [](L& r) { r.inner_cone = 1; }, "light 0: a cone from 1 to 1");
  b.record<L>(
      l, 0, [](L& r) { r.kind = LightKind::kPoint; }, "light 0: a cone from 0 to 1");
}

TEST_CASE("container rules: masks", "[container][mask]") {
  scree::tests::Parts parts = full_parts();
  // 5 x 3, 2 x 1 and 1 x 1 texels.
  parts.pages.push_back(seal_page(PageKind::kMask, Bytes(18, std::byte{1}), 0));
  MaskRecord mask{};
  mask.page = 3;
  mask.width = 5;
  mask.height = 3;
  mask.level_count = 3;
  mask.threshold = kMaxMaskThreshold;
  mask.wrap_s = Wrap::kClamp;
  mask.flags = kMaskNearest;
  mask.place[0][0] = mask.place[1][1] = 1;
  parts.tables.masks = {mask, mask};
  parts.tables.masks[1].material = 1;
  const Bytes file = file_of(parts);
  CHECK(load<FileHeader>(file.data()).version_minor == 1);
  CHECK(load<FileHeader>(file_of(full_parts()).data()).version_minor == 0);
  const Breaker b(parts);

  using M = MaskRecord;
  constexpr TableKind m = TableKind::kMasks;
  b.record<M>(
      m, 1, [](M& r) { r.material = 2; }, "mask 1: material 2, but the file has 2 materials");
  b.record<M>(
      m, 1, [](M& r) { r.material = 0; }, "mask 1: material 0 after material 0, expected ascending order");
  b.record<M>(
      m, 0, [](M& r) { r.page = 4; }, "mask 0: page 4, but the file has 4 pages");
  b.record<M>(
      m, 0, [](M& r) { r.page = 2; }, "mask 0: page 2 is of kind 2, which holds no mask");
  b.record<M>(
      m, 0, [](M& r) { r.width = 0; }, "mask 0: 0 x 3 texels, expected 1 to 65536");
  b.record<M>(
      m, 0, [](M& r) { r.height = 65537; }, "mask 0: 5 x 65537 texels, expected 1 to 65536");
  b.record<M>(
      m, 0, [](M& r) { r.level_count = 0; }, "mask 0: 0 levels, expected 1 to 3");
  b.record<M>(
      m, 0, [](M& r) { r.level_count = 4; }, "mask 0: 4 levels, expected 1 to 3");
  b.record<M>(
      m, 0, [](M& r) { r.level_count = UINT32_MAX; }, "mask 0: 4294967295 levels, expected 1 to 3");
  b.record<M>(
      m, 0, [](M& r) { r.level_count = 2; }, "mask 0: page 3 has 18 bytes, expected 17");
  b.record<M>(
      m, 0, [](M& r) { r.width = r.height = 65536; }, "mask 0: page 3 has 18 bytes, expected 5637144576");
  b.record<M>(
      m, 0, [](M& r) { r.threshold = 0; }, "mask 0: threshold 0, expected 1 to 16711680");
  b.record<M>(
      m, 0, [](M& r) { r.threshold = kMaxMaskThreshold + 1; }, "mask 0: threshold 16711681, expected 1 to 16711680");
  b.record<M>(
      m, 0, [](M& r) { r.wrap_t = Wrap{3}; }, "mask 0: wrap 2 and 3");
  b.record<M>(
      m, 0, [](M& r) { r.flags = 4; }, "mask 0: flags 4", ErrorCode::kReserved);
  b.record<M>(
      m, 1, [](M& r) { r.place[1][2] = kInfinity; }, "mask 1: a transform that is not finite");
}

TEST_CASE("container rules: block images and their mip levels", "[container]") {
  scree::tests::Parts parts = full_parts();
  // 9 x 6 pixels of BC1 have 3 x 2 blocks; its levels of 4 x 3 and 2 x 1 have one each.
  parts.pages.push_back(seal_page(PageKind::kImage, Bytes(48, std::byte{1}), 0));
  parts.pages.push_back(seal_page(PageKind::kImage, Bytes(24, std::byte{2}), 0));
  ImageRecord image = parts.tables.images[0];
  image.codec = ImageCodec::kBlocks;
  image.page = 3;
  image.width = 9;
  image.height = 6;
  image.channels = 4;
  image.block_format = BlockFormat::kBc1;
  image.swizzle = kOpaqueSwizzle;
  image.first_level = 0;
  image.level_count = 2;
  parts.tables.images.push_back(image);
  parts.tables.mip_levels = {{0, 8, 4, 1}, {16, 8, 4, 1}};
  const Breaker b(parts);

  using I = ImageRecord;
  constexpr TableKind i = TableKind::kImages;
  b.record<I>(
      i, 1, [](I& r) { r.block_format = BlockFormat::kNoBlocks; }, "image 1: block format 0, swizzle 2696");
  b.record<I>(
      i, 1, [](I& r) { r.block_format = BlockFormat{6}; }, "image 1: block format 6, swizzle 2696");
  b.record<I>(
      i, 1, [](I& r) { r.block_format = BlockFormat{11}; }, "image 1: block format 11, swizzle 2696");
  b.record<I>(
      i, 1, [](I& r) { r.swizzle = 6; }, "image 1: block format 1, swizzle 6");
  b.record<I>(
      i, 1, [](I& r) { r.swizzle |= 0x8000; }, "image 1: block format 1, swizzle 35464");
  b.record<I>(
      i, 1, [](I& r) { r.channels = 3; }, "image 1: 3 channels, but BC1 has 4");
  b.record<I>(
      i, 1, [](I& r) { r.width = 13; }, "image 1: page 3 has 48 bytes, expected 64");
  b.record<I>(
      i, 1, [](I& r) { r.width = 65537; }, "image 1: 65537 x 6 pixels, expected 1 to 65536");
  b.record<I>(
      i, 1, [](I& r) { r.level_count = 4; }, "image 1: 4 mip levels, expected at most 3");
  b.record<I>(
      i, 1, [](I& r) { r.level_count = 3; }, "image 1: mip level 2, but the file has 2 mip levels");

  using L = MipLevelRecord;
  constexpr TableKind l = TableKind::kMipLevels;
  b.record<L>(
      l, 1, [](L& r) { r.bytes = 7; }, "mip level 1: 7 bytes, expected 8");
  b.record<L>(
      l, 0, [](L& r) { r.bytes = 16; }, "mip level 0: 16 bytes, expected 8");
}

TEST_CASE("container rules: levels of blocks in several pages", "[container]") {
  scree::tests::Parts parts = full_parts();
  // 4096 x 1028 pixels of BC1 have 257 rows of 8192 bytes; 32 rows are a page. Level 1 has 129 rows, 64 in a page.
  const auto add_pages = [&](size_t count, size_t last) {
    for (size_t i = 0; i < count; ++i)
      parts.pages.push_back(seal_page(PageKind::kImage, Bytes(i + 1 == count ? last : kBlockPageBytes), 0));
  };
  add_pages(9, 8192);
  add_pages(3, 4096);
  ImageRecord image = parts.tables.images[0];
  image.codec = ImageCodec::kBlocks;
  image.page = 3;
  image.width = 4096;
  image.height = 1028;
  image.channels = 4;
  image.block_format = BlockFormat::kBc1;
  image.swizzle = kOpaqueSwizzle;
  image.first_level = 0;
  image.level_count = 1;
  parts.tables.images.push_back(image);
  parts.tables.mip_levels = {{0, 129 * 4096, 12, 1}};
  const Breaker b(parts);

  using I = ImageRecord;
  constexpr TableKind i = TableKind::kImages;
  b.record<I>(
      i, 1, [](I& r) { r.page = 4; }, "image 1: page 11 has 8192 bytes, expected 262144");
  b.record<I>(
      i, 1, [](I& r) { r.page = 12; }, "image 1: page 14 has 4096 bytes, expected 262144");
  b.record<I>(
      i, 1, [](I& r) { r.height = 1032; }, "image 1: page 11 has 8192 bytes, expected 16384");
  using L = MipLevelRecord;
  constexpr TableKind l = TableKind::kMipLevels;
  b.record<L>(
      l, 0, [](L& r) { r.page = 13; }, "mip level 0: page 14 has 4096 bytes, expected 262144");
  b.record<L>(
      l, 0, [](L& r) { r.offset = 16; }, "mip level 0: at byte 16 of its first page");
  b.record<L>(
      l, 0, [](L& r) { r.bytes = 4096; }, "mip level 0: 4096 bytes, expected 528384");
  using P = PageRecord;
  b.record<P>(
      TableKind::kPages, 8, [](P& r) { r.kind = PageKind{7}; }, "image 1: page 8 is of kind 7, which holds no image");
}

}  // namespace scree::tests
