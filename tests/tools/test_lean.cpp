// Only what a scene needs: a scene of positions pays for nothing else, down to the overheads that spec/container.md 7
// states.
#include <bit>
#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "format/bytes.h"
#include "format/chunk_layout.h"
#include "tests/catch.h"
#include "tests/models.h"
#include "tests/paths.h"
#include "tests/tools/convert_fixture.h"
#include "tests/tools/model_maker.h"

using namespace scree;
using tests::GridSpec;
using tests::must_convert;
using tests::must_open;
using tests::OpenFile;
using tests::options_of;
using tests::TempFolder;

namespace {

// spec/container.md 7.
constexpr uint64_t kFileOverhead = 5632;  // and the strings
constexpr uint64_t kMeshOverhead = 420;   // with a root node of its own
constexpr uint64_t kChunkOverhead = 150;
constexpr uint64_t kPageOverhead = 40 + 4095;

/// 301 meshes: small ones, and one of many chunks. `with_ballast`: with everything that nobody needs.
void make_scene(const std::string& path, bool with_ballast) {
  tests::ModelMaker maker(path);
  uint32_t material = format::kNone;
  if (with_ballast) {
    const std::string png = tests::read_whole(std::string(tests::kDataFolder) + "/checker.png");
    maker.textured("nobody's", format::ImageCodec::kPng, std::as_bytes(std::span(png)));
  }
  for (uint32_t i = 0; i <= 300; ++i) {
    GridSpec spec;
    spec.columns = i == 300 ? 500 : 1 + i % 7;
    spec.rows = i == 300 ? 400 : 1 + i % 5;
    spec.size = 1 + 0.01f * static_cast<float>(i);
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
    maker.node("", maker.mesh("", {grid}), {static_cast<double>(i), 0, 0});
  }
  if (with_ballast) maker.mesh("nobody draws this", {maker.grid(GridSpec{})});
  maker.finish();
}

/// The bytes of each table by its kind.
std::map<format::TableKind, std::string> tables_of(const OpenFile& packed) {
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

}  // namespace

TEST_CASE("lean: a scene of positions pays for nothing else", "[lean]") {
  const TempFolder folder;
  convert::ConvertOptions options = options_of(folder);
  options.encoding = convert::Encoding::kIndexed;  // of which the bits are known
  options.source_ids = false;
  make_scene(folder.file("in.glb"), false);
  must_convert(options);
  const OpenFile packed = must_open(options.output);
  const format::Container& file = packed.file;
  REQUIRE(file.meshes().size() == 301);
  REQUIRE(file.chunks().size() >= 301 + 6);

  // The bits that indices and positions take, and not one byte more but for what is stated.
  uint64_t bits = 0;
  for (uint64_t i = 0; i < file.chunks().size(); ++i) {
    const format::ChunkRecord& chunk = file.chunks()[i];
    bits += uint64_t{3} * chunk.triangle_count * static_cast<uint64_t>(std::bit_width(chunk.vertex_count - 1));
    uint64_t vertex = 0;
    for (const uint8_t axis : chunk.position_bits) vertex += axis;
    bits += vertex * chunk.vertex_count;
    CHECK(chunk.uv_bits[0] + chunk.uv_bits[1] + chunk.normal_bits + chunk.source_bits == 0);
  }
  const std::map<format::TableKind, std::string> tables = tables_of(packed);
  const uint64_t strings = tables.at(format::TableKind::kStrings).size();
  const uint64_t file_bytes = packed.map.bytes().size();
  const uint64_t stated = kFileOverhead + strings + kMeshOverhead * file.meshes().size() +
                          kChunkOverhead * file.chunks().size() + kPageOverhead * file.pages().size();
  CAPTURE(file_bytes, bits / 8, stated, strings, file.pages().size());
  CHECK(file_bytes <= bits / 8 + stated);
  // Nor is more stated than is taken: padding of pages and streams apart, it is all there.
  CHECK(file_bytes >= bits / 8 + kMeshOverhead * file.meshes().size() + 104 * file.chunks().size());
  for (const format::TableKind kind :
       {format::TableKind::kMaterials, format::TableKind::kTextures, format::TableKind::kImages,
        format::TableKind::kCameras, format::TableKind::kNodeInstances, format::TableKind::kMipLevels,
        format::TableKind::kLeftOut, format::TableKind::kLeftOutCosts})
    CHECK(tables.count(kind) == 0);

  // The same scene with normals, texture coordinates, tangents, white colours, materials, a texture and a mesh that
  // nobody needs: the same pages and tables, but for what names the source.
  make_scene(folder.file("in.glb"), true);
  options.output = folder.file("ballast.scree");
  must_convert(options);
  const OpenFile ballast = must_open(options.output);
  std::map<format::TableKind, std::string> others = tables_of(ballast);
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

TEST_CASE("lean: what is left out is named with what it takes there and would take here", "[lean][inspect]") {
  const TempFolder folder;
  make_scene(folder.file("in.glb"), true);
  convert::ConvertOptions options = options_of(folder);
  options.source_ids = false;
  must_convert(options);
  const OpenFile lean = must_open(options.output);
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
  check("TANGENT", 301, 16 * vertices, 0);  // nothing that this version has
  check("TEXCOORD_0", 301, 8 * vertices, 4 * vertices);
  check("unused meshes", 1, 12 * 25 + 4 * 96, 0);
  check("unused materials", 1, 0, 56);
  const uint64_t checker = std::filesystem::file_size(tests::data_path("checker.png"));
  check("images not used for base colour", 1, checker, checker + 32);

  // What normals would have cost is what they cost where they are stored.
  options.normals = true;
  options.output = folder.file("normals.scree");
  must_convert(options);
  const OpenFile with_normals = must_open(options.output);
  const auto payload = [](const format::Container& file) {
    uint64_t sum = 0;
    for (uint64_t i = 0; i < file.chunks().size(); ++i) sum += file.chunks()[i].bytes;
    return sum;
  };
  REQUIRE(with_normals.file.chunks().size() == lean.file.chunks().size());
  check("NORMAL", 301, 12 * vertices, payload(with_normals.file) - payload(lean.file));
  check("COLOR_0 (all white)", 301, 16 * vertices, left_out["COLOR_0 (all white)"].cost);
  CHECK(left_out["COLOR_0 (all white)"].cost >= 4 * vertices);
}

TEST_CASE("lean: duplicates are named with what storing them would take", "[lean][inspect]") {
  const TempFolder folder;
  const std::string png = tests::read_whole(tests::data_path("checker.png").string());
  {
    tests::ModelMaker maker(folder.file("in.glb"));
    GridSpec spec;
    spec.uv = true;
    spec.indexed = false;
    for (int i = 0; i < 3; ++i) {
      const uint32_t material = maker.textured("", format::ImageCodec::kPng, std::as_bytes(std::span(png)));
      maker.node("", maker.mesh("", {maker.grid(spec, material)}), {2.0 * i, 0, 0});
    }
    maker.finish();
  }
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
  const OpenFile merged = convert("merged.scree", true), apart = convert("apart.scree", false);
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
  CHECK(entry("duplicate images", false) == 2);  // which are one in any case
  CHECK(entry("duplicate images", true) == 2 * (png.size() + 32));
  CHECK(entry("duplicate textures", true) == 2 * 16);
  CHECK(entry("duplicate materials", true) == 2 * 56);
  const format::ChunkRecord& one = merged.file.chunks()[0];
  CHECK(entry("duplicate vertices", false) == 96 - 25);
  uint64_t vertex_bits = one.uv_bits[0] + one.uv_bits[1];
  for (const uint8_t bits : one.position_bits) vertex_bits += bits;
  CHECK(entry("duplicate vertices", true) == 71 * vertex_bits / 8);
  // Of vertices kept apart the streams are larger by that, indices aside.
  CHECK(apart.file.chunks()[0].bytes - one.bytes >= entry("duplicate vertices", true) - 32);
}
