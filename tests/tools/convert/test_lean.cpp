// Only needed data are stored: for a scene of positions, nothing except the overheads of spec/container.md 7.
#include <bit>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "format/bytes.h"
#include "format/geometry/chunk_layout.h"
#include "format/geometry/cluster_layout.h"
#include "tests/models.h"
#include "tests/tools/convert/convert_fixture.h"
#include "tests/tools/model_maker.h"

using namespace scree;
using namespace scree::tests;

namespace {

// spec/container.md 7.
constexpr uint64_t kFileOverhead = 5632;  // in addition to the strings
constexpr uint64_t kMeshOverhead = 420;   // includes the mesh's own root node
constexpr uint64_t kIndexedChunkOverhead = 150;
constexpr uint64_t kClusteredChunkOverhead = 127;
constexpr uint64_t kGroupOverhead = 16;
constexpr uint64_t kClusterOverhead = 56;
constexpr uint64_t kPageOverhead = 40 + 4095;

/// 301 meshes: small ones, and one of many chunks. `with_ballast`: adds all kinds of data that are not needed.
void make_lean_scene(const std::string& path, bool with_ballast) {
  tests::ModelMaker maker(path);
  uint32_t material = format::kNone;
  if (with_ballast) maker.checker("nobody's");
  for (uint32_t i = 0; i <= 300; ++i) {
    const GridSpec spec{.columns = i == 300 ? 500 : 1 + i % 7,
                        .rows = i == 300 ? 400 : 1 + i % 5,
                        .size = 1 + 0.01f * static_cast<float>(i)};
    tools::GltfPrimitive grid = maker.grid(spec, material);
    if (with_ballast) {
      const size_t vertices = (spec.columns + 1) * (spec.rows + 1);
      const std::vector<float> ones(4 * vertices, 1.0f), twos(2 * vertices, 0.5f);
      grid.attributes.emplace_back("NORMAL",
                                   maker.floats(std::vector<float>(3 * vertices, 0.5f), tools::GltfType::kVec3));
      grid.attributes.emplace_back("TEXCOORD_0", maker.floats(twos, tools::GltfType::kVec2));
      grid.attributes.emplace_back("COLOR_0", maker.floats(ones, tools::GltfType::kVec4));
      grid.attributes.emplace_back("TANGENT", maker.floats(ones, tools::GltfType::kVec4));
    }
    maker.draw("", {grid}, {static_cast<double>(i), 0, 0});
  }
  if (with_ballast) {
    const uint32_t mesh = maker.mesh("nobody draws this", {maker.grid(GridSpec{})});
    tools::GltfNode outside;  // a node outside of the scene
    outside.mesh = mesh;
    for (int i = 0; i < 5; ++i) maker.writer().add_node(outside);
    for (int i = 0; i < 3; ++i) maker.node("excluded", mesh);
  }
  maker.finish();
}

/// The bytes of each table by its kind.
std::map<format::TableKind, std::string> tables_of(const PackedFile& packed) {
  const std::span<const std::byte> bytes = packed.map.bytes();
  const format::FileHeader& header = packed.file.header();
  std::map<format::TableKind, std::string> tables;
  for (uint32_t i = 0; i < header.toc_count; ++i) {
    const auto entry = format::load<format::TocEntry>(bytes.data() + header.toc_offset + i * sizeof(format::TocEntry));
    const auto table = bytes.subspan(entry.offset, entry.record_bytes * entry.record_count);
    tables[entry.kind] = {reinterpret_cast<const char*>(table.data()), table.size()};
  }
  return tables;
}

/// The bits of a file's triangles and positions, and bounds of the bytes that its chunks take beyond them: the stated
/// upper bound, and a lower bound without slack and rounding.
struct Geometry {
  uint64_t content_bits = 0, most_overhead = 0, least_overhead = 0;
};

void add_indexed(const format::ChunkRecord& chunk, Geometry& sum) {
  sum.content_bits +=
      uint64_t{3} * chunk.triangle_count * static_cast<uint64_t>(std::bit_width(chunk.vertex_count - 1));
  uint64_t vertex = 0;
  for (const uint8_t axis : chunk.position_bits) vertex += axis;
  sum.content_bits += vertex * chunk.vertex_count;
  sum.most_overhead += kIndexedChunkOverhead;
  sum.least_overhead += sizeof(format::ChunkRecord);
}

/// `records`: the chunk's stream of cluster records.
void add_clustered(const format::ChunkRecord& chunk, const std::byte* records, Geometry& sum) {
  for (uint64_t i = 0; i < chunk.cluster_count; ++i) {
    const auto record = format::load<format::ClusterRecord>(records + i * sizeof(format::ClusterRecord));
    const format::ClusterLayout layout = format::cluster_layout(record);
    sum.content_bits += uint64_t{layout.triangle_count} * ((layout.wide_steps ? 2 : 1) + 2 * layout.distance_bits);
    uint64_t vertex = 0;
    for (const uint32_t axis : layout.position_bits) vertex += axis;
    sum.content_bits += vertex * layout.vertex_count;
    sum.least_overhead += layout.predicted_axis == format::kNotPredicted ? 0 : 8;
  }
  const uint64_t groups = (chunk.cluster_count + format::kGroupClusters - 1) / format::kGroupClusters;
  sum.most_overhead += kClusteredChunkOverhead + kGroupOverhead * groups + kClusterOverhead * chunk.cluster_count;
  sum.least_overhead += sizeof(format::ChunkRecord) + kGroupOverhead * groups +
                        (sizeof(format::ClusterBounds) + sizeof(format::ClusterRecord)) * chunk.cluster_count;
}

/// The sum over all chunks. Checks that each chunk keeps the stated bounds.
Geometry geometry_of(const PackedFile& packed) {
  const format::Container& file = packed.file;
  Geometry sum;
  for (uint64_t i = 0; i < file.chunks().size(); ++i) {
    const format::ChunkRecord& chunk = file.chunks()[i];
    CHECK(chunk.uv_bits[0] + chunk.uv_bits[1] + chunk.normal_bits + chunk.source_bits == 0);
    Geometry own;
    if (chunk.encoding == format::ChunkEncoding::kIndexed) {
      add_indexed(chunk, own);
    } else {
      const format::PageRecord& page = file.pages()[chunk.page];
      REQUIRE(page.codec == format::PageCodec::kRaw);
      const uint64_t records = format::chunk_streams(file.meshes()[chunk.mesh], chunk).clusters.offset;
      add_clustered(chunk, packed.map.bytes().data() + page.offset + chunk.offset + records, own);
    }
    CHECK(sizeof(format::ChunkRecord) + chunk.bytes <= own.content_bits / 8 + own.most_overhead);
    CHECK(sizeof(format::ChunkRecord) + chunk.bytes >= own.content_bits / 8 + own.least_overhead);
    sum.content_bits += own.content_bits;
    sum.most_overhead += own.most_overhead;
    sum.least_overhead += own.least_overhead;
  }
  return sum;
}

/// Converts the scene with and without ballast to chunks of one encoding and compares it with the stated bounds.
void check_overheads(convert::Encoding encoding) {
  const TempFolder folder;
  convert::ConvertOptions options = options_of(folder);
  options.encoding = encoding;
  options.source_ids = false;
  make_lean_scene(folder.file("in.glb"), false);
  must_convert(options);
  const PackedFile packed = must_open(options.output);
  const format::Container& file = packed.file;
  REQUIRE(file.meshes().size() == 301);
  REQUIRE(file.chunks().size() >= 301 + 6);
  const format::ChunkEncoding stored =
      encoding == convert::Encoding::kIndexed ? format::ChunkEncoding::kIndexed : format::ChunkEncoding::kClustered;
  for (uint64_t i = 0; i < file.chunks().size(); ++i) REQUIRE(file.chunks()[i].encoding == stored);

  // The file takes the bits of triangles and positions, and no byte more than the stated overhead.
  const Geometry geometry = geometry_of(packed);
  const std::map<format::TableKind, std::string> tables = tables_of(packed);
  const uint64_t strings = tables.at(format::TableKind::kStrings).size();
  const uint64_t file_bytes = packed.map.bytes().size();
  const uint64_t stated = kFileOverhead + strings + kMeshOverhead * file.meshes().size() + geometry.most_overhead +
                          kPageOverhead * file.pages().size();
  CAPTURE(file_bytes, geometry.content_bits / 8, stated, strings, file.pages().size());
  CHECK(file_bytes <= geometry.content_bits / 8 + stated);
  // The stated overhead is not too large either: except for padding of pages, streams and clusters, everything is used.
  CHECK(file_bytes >= geometry.content_bits / 8 + geometry.least_overhead + kMeshOverhead * file.meshes().size());
  for (const format::TableKind kind :
       {format::TableKind::kMaterials, format::TableKind::kTextures, format::TableKind::kImages,
        format::TableKind::kCameras, format::TableKind::kNodeInstances, format::TableKind::kMipLevels,
        format::TableKind::kLeftOut, format::TableKind::kLeftOutCosts})
    CHECK(tables.count(kind) == 0);

  // The same scene with unneeded data: normals, texture coordinates, tangents, white colours, materials, a texture and
  // a mesh. Pages and tables are the same, except for the description of the source.
  make_lean_scene(folder.file("in.glb"), true);
  options.output = folder.file("ballast.scree");
  options.exclude = "excluded";
  must_convert(options);
  std::map<format::TableKind, std::string> others = tables_of(must_open(options.output));
  CHECK(others.erase(format::TableKind::kLeftOut) == 1);
  CHECK(others.erase(format::TableKind::kLeftOutCosts) == 1);
  for (const auto& [kind, table] : tables) {
    if (kind == format::TableKind::kStrings || kind == format::TableKind::kSource) continue;
    CAPTURE(static_cast<uint32_t>(kind));
    CHECK(others.count(kind) == 1);
    CHECK(others[kind] == table);
  }
  CHECK(others.size() == tables.size());
}

}  // namespace

TEST_CASE("lean: a scene of positions stores nothing else", "[lean]") {
  check_overheads(convert::Encoding::kIndexed);
}

TEST_CASE("lean: a scene of positions stores nothing else, in clusters", "[lean][clusters]") {
  check_overheads(convert::Encoding::kClustered);
}

TEST_CASE("lean: left-out data are listed with their bytes in the source and in the file", "[lean][inspect]") {
  const TempFolder folder;
  make_lean_scene(folder.file("in.glb"), true);
  convert::ConvertOptions options = options_of(folder);
  options.source_ids = false;
  options.exclude = "excluded";
  must_convert(options);
  const PackedFile lean = must_open(options.output);
  struct Entry {
    uint64_t count, source_bytes, cost;
  };
  std::map<std::string, Entry> left_out;
  REQUIRE(lean.file.left_out_costs().size() == lean.file.left_out().size());
  for (uint64_t i = 0; i < lean.file.left_out().size(); ++i) {
    const format::LeftOutRecord& record = lean.file.left_out()[i];
    left_out[std::string(lean.file.string(record.what))] = {record.count, record.source_bytes,
                                                            lean.file.left_out_costs()[i]};
  }
  uint64_t vertices = 0;
  for (uint64_t i = 0; i < lean.file.meshes().size(); ++i) vertices += lean.file.meshes()[i].source_vertex_count;

  const auto check = [&](const char* what, uint64_t count, uint64_t source_bytes, uint64_t cost) {
    CAPTURE(what);
    REQUIRE(left_out.count(what) == 1);
    CHECK(left_out[what].count == count);
    CHECK(left_out[what].source_bytes == source_bytes);
    CHECK(left_out[what].cost == cost);
  };
  check("TANGENT", 301, 16 * vertices, 0);  // not supported by this version
  check("TEXCOORD_0", 301, 8 * vertices, 4 * vertices);
  check("unused meshes", 1, 12 * 25 + 4 * 96, 0);
  check("unused materials", 1, 0, 56);
  check("unused textures", 1, 0, 16);
  check("nodes outside every scene", 5, 0, 5 * 168);
  check("excluded nodes", 3, 0, 3 * 168);
  const uint64_t checker = std::filesystem::file_size(tests::data_path("checker.png"));
  check("unused images", 1, checker, checker + 32);

  // The reported cost of normals equals the bytes that they take when they are stored.
  options.normals = convert::Normals::kAlways;
  options.output = folder.file("normals.scree");
  must_convert(options);
  const PackedFile with_normals = must_open(options.output);
  REQUIRE(with_normals.file.chunks().size() == lean.file.chunks().size());
  check("NORMAL", 301, 12 * vertices, tests::chunk_bytes(with_normals.file) - tests::chunk_bytes(lean.file));
  // Four bytes per stored vertex, in streams of multiples of 16 bytes.
  uint64_t colors = 0;
  for (uint64_t i = 0; i < lean.file.chunks().size(); ++i)
    colors += (4 * uint64_t{lean.file.chunks()[i].vertex_count} + 15) / 16 * 16;
  check("COLOR_0 (all white)", 301, 16 * vertices, colors);
}

TEST_CASE("lean: duplicates are listed with the bytes that they would take", "[lean][inspect]") {
  const TempFolder folder;
  tests::make_model(folder.file("in.glb"), [&](tests::ModelMaker& maker) {
    const GridSpec spec{.uv = true, .indexed = false};
    for (int i = 0; i < 3; ++i) maker.draw("", {maker.grid(spec, maker.checker(""))}, {2.0 * i, 0, 0});
  });
  const auto convert = [&](const char* output, bool merge) {
    convert::ConvertOptions options = options_of(folder);
    options.encoding = convert::Encoding::kIndexed;
    options.source_ids = false;
    options.order = convert::Order::kNone;
    options.weld = options.share = merge;
    options.output = folder.file(output);
    must_convert(options);
    return must_open(options.output);
  };
  const PackedFile merged = convert("merged.scree", true), apart = convert("apart.scree", false);
  const auto entry = [&](std::string_view what, bool cost) {
    for (uint64_t i = 0; i < merged.file.left_out().size(); ++i)
      if (merged.file.string(merged.file.left_out()[i].what) == what)
        return cost ? merged.file.left_out_costs()[i] : merged.file.left_out()[i].count;
    return uint64_t{0};
  };
  REQUIRE(merged.file.chunks().size() == 1);
  REQUIRE(apart.file.chunks().size() == 3);
  CHECK(entry("duplicate meshes", false) == 2);
  CHECK(entry("duplicate meshes", true) == 2 * (120 + 104 + merged.file.chunks()[0].bytes));
  CHECK(entry("duplicate images", false) == 2);  // stored once in any case
  CHECK(entry("duplicate images", true) == 2 * (std::filesystem::file_size(tests::data_path("checker.png")) + 32));
  CHECK(entry("duplicate textures", true) == 2 * 16);
  CHECK(entry("duplicate materials", true) == 2 * 56);
  const format::ChunkRecord& one = merged.file.chunks()[0];
  CHECK(entry("duplicate vertices", false) == 96 - 25);
  uint64_t vertex_bits = one.uv_bits[0] + one.uv_bits[1];
  for (const uint8_t bits : one.position_bits) vertex_bits += bits;
  CHECK(entry("duplicate vertices", true) == 71 * vertex_bits / 8);
  // Without welding, the vertex streams are larger by that amount, which does not include indices.
  CHECK(apart.file.chunks()[0].bytes - one.bytes >= entry("duplicate vertices", true) - 32);
}
