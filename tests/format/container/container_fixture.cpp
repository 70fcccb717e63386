#include "tests/format/container/container_fixture.h"

#include <algorithm>
#include <cmath>

#include "format/bytes.h"
#include "format/geometry/chunk_layout.h"
#include "tests/results.h"

namespace scree::tests {

using namespace scree::format;

namespace {

Bytes bytes_of(std::initializer_list<unsigned> values) {
  Bytes bytes;
  for (const unsigned value : values) bytes.push_back(static_cast<std::byte>(value));
  return bytes;
}

MatrixRecord identity() {
  MatrixRecord matrix{};
  for (int i = 0; i < 3; ++i) matrix.rows[i][i] = 1;
  return matrix;
}

NodeRecord node_of(uint32_t name, uint32_t parent, uint32_t group) {
  return {.name = name,
          .parent = parent,
          .group = group,
          .camera = kNone,
          .local = {0, 0, 0, /* rotation */ 0, 0, 0, 1, /* scale */ 1, 1, 1}};
}

/// Places the chunk at the end of a page and adds its bytes to the page.
void place(const MeshRecord& mesh, ChunkRecord& chunk, uint32_t page, Bytes& raw) {
  chunk.page = page;
  chunk.offset = raw.size();
  chunk.bytes = chunk_streams(mesh, chunk).bytes;
  for (uint64_t i = 0; i < chunk.bytes; ++i) raw.push_back(static_cast<std::byte>(i / 16));
}

}  // namespace

Parts tiny_parts() {
  Parts parts;
  TableSet& tables = parts.tables;
  // Indices 0 1 2 of 2 bits. Positions (0 0 0) (3 0 0) (0 1 0) of 2 + 1 + 0 bits. Each stream has slack, up to 16
  // bytes.
  Bytes raw = bytes_of({0x24, 0,    0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0,  //
                        0x18, 0x01, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0});
  parts.pages.push_back(seal_page(PageKind::kGeometry, raw, 0));

  tables.meshes.push_back({.triangle_count = 1,
                           .vertex_count = 3,
                           .source_vertex_count = 3,
                           .chunk_count = 1,
                           .bounds_max = {0.75f, 0.25f, 0},
                           .max_position_error = 0.125 + std::ldexp(1, -25),
                           .lattice_exponent = -2,
                           .lattice_bits = {2, 1, 0}});
  tables.chunks.push_back(
      {.bytes = 32, .triangle_count = 1, .vertex_count = 3, .index_bits = 2, .position_bits = {2, 1, 0}});

  tables.groups.push_back({tables.strings.add("stone"), 0, 1, 0});
  tables.nodes.push_back(node_of(tables.strings.add("here"), kNone, 0));
  tables.instances.push_back({0, 0, 0, 0});
  tables.matrices.push_back(identity());
  tables.materials.push_back({.name = tables.strings.add("slate"),
                              .texture = kNone,
                              .base_color = {0.5f, 0.5f, 0.5f, 1},
                              .uv_scale = {1, 1},
                              .alpha_cutoff = 0.5f,
                              .flags = kMaterialDoubleSided});
  tables.scenes.push_back({.flags = 1, .instance_count = 1, .root_count = 1, .triangle_count = 1});
  tables.scene_roots.push_back(0);
  tables.source.json_bytes = 700;
  tables.source.buffer_bytes = 42;
  tables.source.index_bytes = 6;
  tables.source.position_bytes = 36;
  tables.source.name = tables.strings.add("tiny.gltf");
  tables.source.generator = tables.strings.add("scree 0.1.0");
  return parts;
}

Parts full_parts() {
  Parts parts;
  TableSet& tables = parts.tables;
  const auto name = [&](const char* text) { return tables.strings.add(text); };

  MeshRecord all{};  // every attribute, two chunks
  all.attributes = kHasUv | kHasColor | kHasNormal | kHasSourceIds;
  all.source_vertex_count = 300;
  all.lattice_exponent = -10;
  all.max_position_error = std::ldexp(1, -11);
  all.max_uv_error = std::ldexp(1.0f, -17);
  for (int axis = 0; axis < 3; ++axis) {
    all.lattice_min[axis] = -1000 * axis;
    all.lattice_bits[axis] = static_cast<uint8_t>(16 - axis);
    all.bounds_min[axis] = -1;
    all.bounds_max[axis] = 1;
  }
  all.material = 1;
  MeshRecord floats{};  // float32 positions, the default material
  floats.position_encoding = PositionEncoding::kFloat32;
  floats.material = kNone;
  floats.source_vertex_count = 100;
  floats.bounds_max[2] = 1000;
  MeshRecord empty{.material = 0, .group = 1};

  Bytes first_page, second_page;
  uint64_t triangles = 0;
  for (uint32_t c = 0; c < 2; ++c) {
    ChunkRecord chunk{.first_triangle = triangles,
                      .triangle_count = 100 + 28 * c,
                      .vertex_count = 90,
                      .index_min = 3,
                      .index_bits = 7};
    for (int axis = 0; axis < 3; ++axis) {
      chunk.position_min[axis] = 5;
      chunk.position_bits[axis] = static_cast<uint8_t>(12 + axis);
    }
    chunk.uv_exponent = -16;
    chunk.uv_min[0] = -7;
    chunk.uv_bits[0] = 16;
    chunk.uv_bits[1] = 24;
    chunk.normal_bits = 8;
    chunk.source_min = triangles;
    chunk.source_bits = 9;
    place(all, chunk, 0, first_page);
    all.triangle_count += chunk.triangle_count;
    all.vertex_count += chunk.vertex_count;
    triangles += chunk.triangle_count;
    tables.chunks.push_back(chunk);
  }
  all.chunk_count = 2;
  {
    ChunkRecord chunk{.mesh = 1, .triangle_count = 98, .vertex_count = 100, .index_bits = 7};
    for (uint8_t& bits : chunk.position_bits) bits = 32;
    place(floats, chunk, 1, second_page);
    tables.chunks.push_back(chunk);
    floats.first_chunk = 2;
    floats.chunk_count = 1;
    floats.triangle_count = 98;
    floats.vertex_count = 100;
  }
  empty.first_chunk = 3;
  tables.meshes = {all, floats, empty};

  parts.pages.push_back(seal_page(PageKind::kGeometry, first_page, 0));
  parts.pages.push_back(seal_page(PageKind::kGeometry, second_page, 9));
  parts.pages.push_back(seal_page(PageKind::kImage, bytes_of({0x89, 'P', 'N', 'G'}), 9));

  tables.groups = {{name("boulder"), 0, 2, 0}, {name("nothing"), 2, 1, 0}};
  tables.nodes = {node_of(name("root"), kNone, kNone), node_of(name("rock"), 0, 0), node_of(name("field"), 0, 0),
                  node_of(name("eye"), kNone, 1)};
  tables.nodes[0].flags = kNodeHasMatrix;
  for (int i = 0; i < 4; ++i) tables.nodes[0].local[5 * i] = 1;
  tables.nodes[2].node_instance_count = 2;
  tables.nodes[3].camera = 1;
  tables.node_instances = {{{1, 2, 3}, {0, 0, 0, 1}, {1, 1, 1}}, {{4, 5, 6}, {0, 0, 0, 1}, {2, 2, 2}}};
  tables.matrices = {identity(), identity()};
  tables.instances = {{0, 1, 0, 0}, {0, 2, 0, 0}, {0, 2, 1, 1}, {1, 1, 0, 0}, {1, 1, 1, 0}, {2, 3, 0, 0}};

  const MaterialRecord material{.name = name("gneiss"), .texture = kNone, .uv_scale = {1, 1}};
  tables.materials = {material, material};
  tables.materials[1].texture = 0;
  tables.materials[1].flags = kMaterialDoubleSided | kMaterialUnlit | kMaterialAlphaMask | kMaterialAlphaBlend;
  tables.textures = {{name("moss"), 0, Wrap::kMirror, Wrap::kClamp, 9729, 9987}};
  tables.images = {{name("moss.png"), 2, ImageCodec::kPng, 640, 480, 3, BlockFormat::kNoBlocks, 0, kNone, 0}};
  tables.cameras = {{name("wide"), CameraKind::kPerspective, 1.0, 0, 0.1, 0},
                    {name("flat"), CameraKind::kOrthographic, 10, 20, 0, 100}};
  tables.scenes = {{name("day"), 0, 0, 4, 0, 1, 3 * all.triangle_count + 98}, {name("night"), 1, 4, 2, 1, 2, 98}};
  tables.scene_roots = {0, 0, 3};
  tables.source.json_bytes = 1;
  tables.source.name = name("full.gltf");
  tables.left_out = {{name("skins"), 0, 3, 400}, {name("TANGENT"), 0, 1, 1600}};
  tables.left_out_costs = {0, 800};
  return parts;
}

Bytes file_of(const Parts& parts) {
  const TempFolder folder;
  const std::string path = folder.file("file.scree");
  auto writer = must(ContainerWriter::create(path));
  for (const SealedPage& page : parts.pages) REQUIRE(writer.append(page));
  const auto size = must(writer.finish(parts.tables));
  const Bytes file = read_bytes(path);
  REQUIRE(file.size() == size);
  return file;
}

size_t toc_entry_offset(const Bytes& file, TableKind kind) {
  const auto header = load<FileHeader>(file.data());
  for (uint32_t i = 0; i < header.toc_count; ++i) {
    const size_t offset = header.toc_offset + i * sizeof(TocEntry);
    if (load<TocEntry>(file.data() + offset).kind == kind) return offset;
  }
  FAIL("no table of kind " << static_cast<uint32_t>(kind));
  return 0;
}

size_t record_offset(const Bytes& file, TableKind kind, uint64_t index) {
  const auto entry = load<TocEntry>(file.data() + toc_entry_offset(file, kind));
  REQUIRE(index < entry.record_count);
  return entry.offset + index * entry.record_bytes;
}

RawFile::RawFile(const Bytes& file) {
  const auto header = load<FileHeader>(file.data());
  version_minor = header.version_minor;
  for (uint32_t i = 0; i < header.toc_count; ++i) {
    const auto entry = load<TocEntry>(file.data() + header.toc_offset + i * sizeof(TocEntry));
    const auto first = file.begin() + static_cast<ptrdiff_t>(entry.offset);
    tables.push_back({entry.kind, entry.record_bytes,
                      Bytes(first, first + static_cast<ptrdiff_t>(entry.record_bytes * entry.record_count))});
    if (i == 0) page_area.assign(file.begin() + kPageAlignment, first);
  }
}

RawTable& RawFile::table(TableKind kind) {
  const auto found = std::find_if(tables.begin(), tables.end(), [&](const RawTable& t) { return t.kind == kind; });
  REQUIRE(found != tables.end());
  return *found;
}

Bytes RawFile::build() const {
  Bytes file(kPageAlignment + page_area.size());
  std::copy(page_area.begin(), page_area.end(), file.begin() + kPageAlignment);
  std::vector<TocEntry> toc;
  for (const RawTable& table : tables) {
    file.resize(align_up(file.size(), kTableAlignment));
    const uint64_t count = table.record_bytes ? table.bytes.size() / table.record_bytes : 0;
    toc.push_back({table.kind, table.record_bytes, count, file.size(), 0});
    file.insert(file.end(), table.bytes.begin(), table.bytes.end());
  }
  file.resize(align_up(file.size(), kTableAlignment));
  FileHeader header{};
  std::memcpy(header.magic, kMagic, sizeof kMagic);
  header.version_major = version_major;
  header.version_minor = version_minor;
  header.header_bytes = sizeof header;
  header.toc_offset = file.size();
  header.toc_count = static_cast<uint32_t>(toc.size());
  const auto toc_bytes = std::as_bytes(std::span<const TocEntry>(toc));
  file.insert(file.end(), toc_bytes.begin(), toc_bytes.end());
  header.file_bytes = file.size();
  store(file.data(), header);
  reseal(file);
  return file;
}

}  // namespace scree::tests
