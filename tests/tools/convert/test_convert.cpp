// convert(): its output equals the source within the stated error, for all options and numbers of threads.
// test_convert_errors.cpp has the refused inputs.
#include "tools/convert/convert.h"

#include <array>
#include <filesystem>
#include <fstream>
#include <map>

#include "format/geometry/chunk_layout.h"
#include "runtime/images/image.h"
#include "runtime/images/png_writer.h"
#include "tests/tools/convert/convert_fixture.h"
#include "tests/tools/model_maker.h"
#include "tools/common/jobs/ordered_pool.h"

using namespace scree;
using namespace scree::tests;

TEST_CASE("every option keeps the triangles and the stated error", "[convert]") {
  const TempFolder folder;
  make_grids(folder.file("in.glb"));
  convert::ConvertOptions options = options_of(folder);

  SECTION("defaults") {
    CHECK(must_match(options).position_error > 0);
  }
  SECTION("8 bits") {
    options.position_bits = 8;
    CHECK(must_match(options).position_error > 1e-3);
  }
  SECTION("24 bits") {
    options.position_bits = 24;
    must_match(options);
  }
  SECTION("float32") {
    options.float32 = true;
    CHECK(must_match(options).position_error == 0);
  }
  SECTION("maximum error") {
    options.max_error = 0.01;
    const convert::ConvertReport report = must_match(options);
    CHECK(report.position_error_bound <= 0.0101);
    CHECK(report.position_error > 0.001);
  }
  SECTION("order none") {
    options.order = convert::Order::kNone;
    must_match(options);
  }
  SECTION("chunks of one triangle") {
    options.chunk_triangles = 1;
    CHECK(must_match(options).chunks == 2 * (60 * 40 + 31 * 40 + 16));
  }
  SECTION("chunks of seven, order none") {
    options.chunk_triangles = 7;
    options.order = convert::Order::kNone;
    must_match(options);
  }
  SECTION("chunks of whole meshes") {
    options.chunk_triangles = 0;
    CHECK(must_match(options).chunks == 3);
  }
  SECTION("chunks of whole meshes, order none") {
    options.chunk_triangles = 0;
    options.order = convert::Order::kNone;
    CHECK(must_match(options).chunks == 3);
  }
  SECTION("zstd") {
    const uint64_t raw = must_match(options).output_bytes;
    options.zstd_level = 9;
    CHECK(must_match(options).output_bytes < raw);
  }
  SECTION("normals") {
    options.normals = convert::Normals::kAlways;
    must_match(options);
  }
  SECTION("everything") {
    options.normals = convert::Normals::kAlways;
    options.zstd_level = 3;
    options.position_bits = 20;
    options.chunk_triangles = 100;
    must_match(options);
  }
  const tests::PackedFile opened = must_open(options.output);
  CHECK(opened.file.meshes().size() == 3);
  const uint32_t attributes = opened.file.meshes()[0].attributes;
  CHECK((attributes & format::kHasColor) != 0);
  CHECK(((attributes & format::kHasNormal) != 0) == (options.normals == convert::Normals::kAlways));
  CHECK((attributes & format::kHasUv) == 0);  // not needed without a texture
}

TEST_CASE("source ids change nothing but themselves", "[convert]") {
  const TempFolder folder;
  tests::make_model(folder.file("in.glb"), {.columns = 200, .rows = 200});
  convert::ConvertOptions with = options_of(folder);
  convert::ConvertOptions without = with;
  without.source_ids = false;
  without.output = folder.file("without.scree");
  must_match(with);
  must_convert(without);
  const tests::PackedFile a = must_open(with.output), b = must_open(without.output);
  REQUIRE(a.file.chunks().size() == b.file.chunks().size());
  tools::ChunkReader read_a(a.file), read_b(b.file);
  for (uint64_t i = 0; i < a.file.chunks().size(); ++i) {
    const auto chunk_a = must(read_a.read(i));
    const auto chunk_b = must(read_b.read(i));
    CHECK(chunk_a->indices == chunk_b->indices);
    CHECK(chunk_a->positions == chunk_b->positions);
    CHECK(chunk_b->source_ids.empty());
  }
}

TEST_CASE("the bytes depend neither on threads nor on memory", "[convert]") {
  const TempFolder folder;
  tests::make_model(folder.file("in.glb"), [&](ModelMaker& maker) {
    GridSpec large;  // three windows
    large.columns = 700;
    large.rows = 400;
    large.color = true;
    maker.draw("large", {maker.grid(large)});
    for (int i = 0; i < 300; ++i) {  // more meshes than a batch of small ones
      const GridSpec small{.columns = 1 + static_cast<uint32_t>(i) % 7, .size = 1 + static_cast<float>(i)};
      maker.node("small " + std::to_string(i), maker.mesh("small", {maker.grid(small)}));
    }
  });
  convert::ConvertOptions options = options_of(folder);
  options.zstd_level = GENERATE(0, 1);
  options.threads = 1;
  const convert::ConvertReport report = must_match(options);
  CHECK(report.triangles > 2 * 700 * 400);
  const std::string one = tests::read_whole(options.output);
  REQUIRE(one.size() == report.output_bytes);
  for (const uint32_t threads : {2u, 3u, 9u}) {
    options.threads = threads;
    CHECK((tests::converted_bytes(options) == one));
  }
  for (const bool is_least : {true, false}) {
    const convert::ConvertReport bounded = must_convert_within(options, is_least ? 1 : 2 * options.memory);
    CHECK(options.memory > 1);  // one byte of memory was refused first
    CHECK(bounded.threads >= 1);
    CHECK(bounded.threads_asked == 9);
    CHECK((tests::read_whole(options.output) == one));
  }
}

TEST_CASE("pages and chunks stay within their limits", "[convert]") {
  const TempFolder folder;
  GridSpec spec{.columns = 300, .rows = 500};
  spec.indexed = false;  // three vertices per triangle
  spec.color = spec.normal = true;
  tests::make_model(folder.file("in.glb"), spec);
  convert::ConvertOptions options = options_of(folder);
  options.float32 = true;
  options.normals = convert::Normals::kAlways;
  options.weld = false;
  must_match(options);
  const tests::PackedFile opened = must_open(options.output);
  CHECK(opened.file.pages().size() > 10);
  for (uint64_t i = 0; i < opened.file.pages().size(); ++i)
    CHECK(opened.file.pages()[i].raw_bytes <= format::kPageTargetBytes);
  uint64_t smallest_end = format::kPageTargetBytes;
  for (uint64_t i = 0; i < opened.file.chunks().size(); ++i) {
    const format::ChunkRecord& chunk = opened.file.chunks()[i];
    CHECK(chunk.triangle_count <= format::kMaxChunkTriangles);
    CHECK(chunk.bytes == format::chunk_streams(opened.file.meshes()[chunk.mesh], chunk).bytes);
    if (i + 1 < opened.file.chunks().size()) smallest_end = std::min(smallest_end, chunk.bytes);
  }
  CHECK(smallest_end > format::kPageTargetBytes / 4);  // except a window's last chunk
}

TEST_CASE("neighbours have equal border points with --grid scene", "[convert]") {
  const TempFolder folder;
  tests::make_model(folder.file("in.glb"), [&](ModelMaker& maker) {
    const GridSpec wide{.size = 100};
    const GridSpec fine{.size = 3, .origin = {100, 0, 0}};
    maker.draw("wide", {maker.grid(wide)});
    maker.draw("fine", {maker.grid(fine)});
    maker.draw("elsewhere", {maker.grid(wide)}, {0, 50, 0});
  });
  convert::ConvertOptions options = options_of(folder);
  must_match(options);
  {
    const tests::PackedFile opened = must_open(options.output);
    CHECK(opened.file.meshes()[0].lattice_exponent > opened.file.meshes()[1].lattice_exponent);
  }
  options.grid = convert::Grid::kScene;
  must_match(options);
  const tests::PackedFile opened = must_open(options.output);
  CHECK(opened.file.meshes()[0].lattice_exponent == opened.file.meshes()[1].lattice_exponent);
  CHECK(opened.file.meshes()[0].lattice_bits[0] > 16);
  CHECK(opened.file.meshes()[2].lattice_exponent > opened.file.meshes()[1].lattice_exponent);

  tests::make_model(folder.file("in.glb"), [&](ModelMaker& maker) {
    const GridSpec wide{.size = 1e6f};
    maker.draw("both", {maker.grid(wide), maker.grid({.size = 1})});
  });
  std::filesystem::remove(options.output);
  must_fail(options, ErrorCode::kRange, "mesh 0 primitive 0");
}

TEST_CASE("triangles with positions that are not finite are left out on request", "[convert]") {
  const TempFolder folder;
  // By index, because Catch2 2.13 loses the last value when gcc optimises.
  const float bad = std::array{kNan, kInf, -kInf}[GENERATE(size_t{0}, size_t{1}, size_t{2})];
  tests::make_model(folder.file("in.glb"), [&](ModelMaker& maker) {
    // Vertex 4 is bad and used by one of three triangles; vertex 5 is bad and unused.
    const std::vector<float> points{0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0, 2, bad, 0, bad, bad, bad};
    maker.draw("good", {maker.primitive({0, 0, 0, 1, 0, 0, 0, 1, 0}, {})});
    maker.draw("bad", {maker.primitive(points, {0, 1, 2, 1, 3, 4, 2, 1, 3})});
    maker.draw("worse", {maker.primitive({bad, 0, 0, 1, 0, 0, 0, 1, 0}, {})});
  });
  convert::ConvertOptions options = options_of(folder);
  options.order = GENERATE(convert::Order::kFifo, convert::Order::kNone);
  must_fail(options, ErrorCode::kRange, "mesh 1 primitive 0: vertex 4: position (2, ");

  options.drop_nonfinite = true;
  const convert::ConvertReport report = must_match(options);
  CHECK(report.triangles == 3);
  CHECK(report.dropped_nonfinite == 2);
  CHECK(report.meshes == 2);
  REQUIRE_FALSE(report.warnings.empty());
  CHECK(report.warnings.back().find("2 triangles") != std::string::npos);
}

TEST_CASE("only the degenerate joining triangles of strips are left out", "[convert]") {
  const TempFolder folder;
  // The program's writer writes only triangle lists, so the test writes a strip itself.
  const float points[] = {0, 0, 0, 0, 1, 0, 1, 0, 0, 1, 1, 0, 5, 0, 0, 5, 1, 0, 6, 0, 0, 6, 1, 0};
  const uint16_t strip[] = {0, 1, 2, 3, 3, 4, 4, 5, 6, 7};
  std::ofstream bin(folder.file("in.bin"), std::ios::binary);
  bin.write(reinterpret_cast<const char*>(points), sizeof points);
  bin.write(reinterpret_cast<const char*>(strip), sizeof strip);
  bin.close();
  std::ofstream(folder.file("in.gltf")) << R"({"asset":{"version":"2.0"},"buffers":[{"uri":"in.bin","byteLength":116}],
"bufferViews":[{"buffer":0,"byteLength":96},{"buffer":0,"byteOffset":96,"byteLength":20}],
"accessors":[{"bufferView":0,"componentType":5126,"type":"VEC3","count":8,"min":[0,0,0],"max":[6,1,0]},
{"bufferView":1,"componentType":5123,"type":"SCALAR","count":10}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1,"mode":5}]}],
"nodes":[{"mesh":0}],"scenes":[{"nodes":[0]}]})";
  convert::ConvertOptions options = options_of(folder, "in.gltf");
  options.order = GENERATE(convert::Order::kFifo, convert::Order::kNone);
  const convert::ConvertReport report = must_match(options);
  CHECK(report.triangles == 4);
  CHECK(report.dropped_degenerate == 4);
}

TEST_CASE("a list keeps its degenerate and duplicate triangles", "[convert]") {
  const TempFolder folder;
  tests::make_model(folder.file("in.glb"), [&](ModelMaker& maker) {
    maker.draw("a",
               {maker.primitive({0, 0, 0, 1, 0, 0, 0, 1, 0}, {0, 1, 2, 0, 1, 2, 2, 2, 2, 0, 1, 2, 1, 2, 0, 0, 0, 1})});
    // A single point: every stream of the chunk has 0 bytes.
    maker.draw("b", {maker.primitive({7, 8, 9}, {0, 0, 0})});
    maker.draw("c", {maker.primitive({7, 8, 9, 1, 1, 1, 2, 2, 2}, {0, 1, 2})});
  });
  convert::ConvertOptions options = options_of(folder);
  options.order = GENERATE(convert::Order::kFifo, convert::Order::kNone);
  options.source_ids = true;
  const convert::ConvertReport report = must_match(options);
  CHECK(report.triangles == 8);
  CHECK(report.dropped_degenerate == 0);
}

TEST_CASE("scattered vertices and wide index ranges are converted", "[convert]") {
  const TempFolder folder;
  tests::make_model(folder.file("in.glb"), [&](ModelMaker& maker) {
    std::vector<float> points;
    for (uint32_t i = 0; i < 40000; ++i) {
      const float x = static_cast<float>(i);
      points.insert(points.end(), {std::sin(x), std::cos(x * 0.7f), x * 1e-3f});
    }
    std::vector<uint32_t> corners;
    for (uint32_t i = 0; i < 300; ++i) corners.push_back(i * 7919 % 40000);
    maker.draw("a", {maker.primitive(points, corners)});
  });
  convert::ConvertOptions options = options_of(folder);
  options.order = GENERATE(convert::Order::kFifo, convert::Order::kNone);
  CHECK(must_match(options).triangles == 100);
  CHECK(must_open(options.output).file.meshes()[0].vertex_count == 300);
}

TEST_CASE("extents at the limits of float32 are converted", "[convert]") {
  const TempFolder folder;
  const float size = GENERATE(1e-42f, 1e-30f, 1e30f, 3e38f);
  tests::make_model(folder.file("in.glb"), [&](ModelMaker& maker) {
    maker.draw("a", {maker.primitive({-size, 0, 0, size, size, 0, 0, size / 3, 0}, {0, 1, 2})});
  });
  must_match(options_of(folder));
}

TEST_CASE("attributes are kept only if they are needed", "[convert]") {
  const TempFolder folder;
  const std::vector<uint8_t> pixels(4 * 4 * 3, 200);
  const std::vector<std::byte> png = must(runtime::encode_png({4, 4, 3, pixels}));
  tests::make_model(folder.file("in.glb"), [&](ModelMaker& maker) {
    const uint32_t unused = maker.textured("unused", format::ImageCodec::kPng, png);
    CHECK(unused == 0);
    const uint32_t plain = maker.writer().add_material({});
    const uint32_t first = maker.writer().add_texture(maker.texture("first", format::ImageCodec::kPng, png));
    const uint32_t textured = maker.writer().add_material({.name = "textured", .texture = first});
    const uint32_t also = maker.textured("same bytes", format::ImageCodec::kPng, png);
    const GridSpec spec{.uv = true, .white = true, .normal = true};
    maker.draw("a", {maker.grid(spec, plain), maker.grid(spec, textured), maker.grid(spec, also)});
    maker.mesh("nobody draws this", {maker.grid(spec, unused)});
  });
  const convert::ConvertOptions options = options_of(folder);
  must_match(options);
  const tests::PackedFile opened = must_open(options.output);
  const format::Container& file = opened.file;
  REQUIRE(file.meshes().size() == 3);
  CHECK(file.meshes()[0].attributes == format::kHasSourceIds);
  CHECK(file.meshes()[1].attributes == (format::kHasUv | format::kHasSourceIds));
  CHECK(file.materials().size() == 3);
  CHECK(file.textures().size() == 1);  // one of several equal files is stored
  REQUIRE(file.images().size() == 1);
  CHECK(file.images()[0].width == 4);
  CHECK(file.images()[0].channels == 3);
  CHECK(file.textures()[0].image == 0);
  CHECK(file.materials()[2].texture == 0);
  CHECK(file.string(file.materials()[file.meshes()[1].material].name) == "textured");
  std::vector<std::byte> scratch;
  CHECK(std::ranges::equal(must(file.load_page(file.images()[0].page, scratch)), png));
  std::map<std::string, uint64_t> left_out = tests::left_out(file);
  CHECK(left_out["COLOR_0 (all white)"] == 3);
  CHECK(left_out["NORMAL"] >= 3);
}

TEST_CASE("attributes that are not finite are repaired and counted", "[convert]") {
  const TempFolder folder;
  tests::make_model(folder.file("in.glb"), [&](ModelMaker& maker) {
    tools::GltfPrimitive primitive = maker.primitive({0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0}, {0, 1, 2, 1, 3, 2});
    primitive.material = maker.checker();
    primitive.attributes.emplace_back("TEXCOORD_0",
                                      maker.floats({0, 0, kNan, 1, 0.5f, kInf, 3, 3}, tools::GltfType::kVec2));
    primitive.attributes.emplace_back("COLOR_0",
                                      maker.floats({kNan, 0, 0, 2, 0, -5, 0, 1, 1, 1, 1, 1}, tools::GltfType::kVec3));
    primitive.attributes.emplace_back(
        "NORMAL", maker.floats({0, 0, 0, kNan, 0, 0, 0, 1, 0, 0, 3e38f, 3e38f}, tools::GltfType::kVec3));
    maker.draw("a", {primitive});
  });
  convert::ConvertOptions options = options_of(folder);
  options.normals = convert::Normals::kAlways;
  const convert::ConvertReport report = must_match(options);
  std::string all;
  for (const std::string& warning : report.warnings) all += warning + "\n";
  INFO(all);
  CHECK(all.find("2 texture coordinates") != std::string::npos);
  CHECK(all.find("1 vertex colour is") != std::string::npos);
  CHECK(all.find(" normals are zero or not finite") != std::string::npos);
}

TEST_CASE("nodes, world matrices, instances and scenes are stored", "[convert]") {
  const TempFolder folder;
  tests::make_model(folder.file("in.glb"), [&](ModelMaker& maker) {
    GridSpec spec;
    const uint32_t two = maker.mesh("two", {maker.grid(spec), maker.grid(spec)});
    const uint32_t one = maker.mesh("one", {maker.grid(spec)});
    const uint32_t child_number = maker.writer().add_node({.mesh = one, .local = {0, 2, 0, 0, 0, 0, 1, 3, 3, -3}});
    const uint32_t root = maker.node("root", two, {1, 0, 0});
    maker.writer().node(root).children.push_back(child_number);
    maker.node("again", two, {1, 0, 0});  // has the same world matrix
    const std::vector<float> places{0, 0, 0, 0, 0, 9, 0, 0, 18};
    const uint32_t many = maker.node("many", one, {0, 5, 0});
    maker.writer().node(many).instancing.emplace_back("TRANSLATION", maker.floats(places, tools::GltfType::kVec3));
  });
  const convert::ConvertOptions options = options_of(folder);
  const convert::ConvertReport report = must_match(options);
  const tests::PackedFile opened = must_open(options.output);
  const format::Container& file = opened.file;
  REQUIRE(file.instances().size() == 2 * 2 + 1 + 3);
  CHECK(file.matrices().size() == 5);
  REQUIRE(file.scenes().size() == 1);
  CHECK(file.scenes()[0].triangle_count == 8 * 32);
  CHECK(report.triangles_drawn == 8 * 32);
  CHECK(report.triangles == 3 * 32);
  for (uint64_t i = 1; i < file.instances().size(); ++i) {
    const format::InstanceRecord& a = file.instances()[i - 1];
    const format::InstanceRecord& b = file.instances()[i];
    CHECK(std::tie(a.mesh, a.node, a.node_instance) < std::tie(b.mesh, b.node, b.node_instance));
  }
  bool found_child = false;
  for (uint64_t i = 0; i < file.instances().size(); ++i) {
    const format::InstanceRecord& instance = file.instances()[i];
    const format::MatrixRecord& m = file.matrices()[instance.matrix];
    const format::NodeRecord& node = file.nodes()[instance.node];
    if (file.string(node.name) == "many") {
      CHECK(m.rows[1][3] == 5);
      CHECK(m.rows[2][3] == 9 * instance.node_instance);
    }
    if (node.parent == format::kNone) continue;
    found_child = true;
    CHECK(m.rows[0][0] == 3);
    CHECK(m.rows[2][2] == -3);
    CHECK(m.rows[0][3] == 1);
    CHECK(m.rows[1][3] == 2);
  }
  CHECK(found_child);
}

TEST_CASE("a document without scenes draws all its roots", "[convert]") {
  const TempFolder folder;
  {
    ModelMaker maker(folder.file("in.glb"));
    maker.draw("a", {maker.grid({})});
    maker.node("b", 0, {1, 2, 3});
    maker.finish(false);
  }
  const convert::ConvertOptions options = options_of(folder);
  must_match(options);
  const tests::PackedFile opened = must_open(options.output);
  REQUIRE(opened.file.scenes().size() == 1);
  CHECK(opened.file.scenes()[0].root_count == 2);
  CHECK(opened.file.scenes()[0].instance_count == 2);
}

TEST_CASE("the option --exclude leaves out nodes and data that only they use", "[convert]") {
  const TempFolder folder;
  tests::make_model(folder.file("in.glb"), [&](ModelMaker& maker) {
    maker.node("FogCard 1", maker.mesh("fog", {maker.grid({})}));
    maker.draw("rock", {maker.grid({})});
  });
  convert::ConvertOptions options = options_of(folder);
  options.exclude = "FogCard|Plane";
  CHECK(must_match(options).meshes == 1);
  options.exclude = "(";
  std::filesystem::remove(options.output);
  must_fail(options, ErrorCode::kUsage, "");
}

TEST_CASE("the report describes the result", "[convert]") {
  const TempFolder folder;
  tests::make_model(folder.file("in.glb"), {.columns = 50, .rows = 50});
  convert::ConvertOptions options = options_of(folder);
  const convert::ConvertReport report = must_match(options);
  CHECK(report.input_bytes > 51 * 51 * 12 + 5000 * 12);
  CHECK(report.input_bytes == std::filesystem::file_size(options.input));
  CHECK(report.output_bytes == std::filesystem::file_size(options.output));
  CHECK(report.peak_bytes > 1000000);
  CHECK(report.relative_position_error > 0);
  CHECK(report.relative_position_error < 2e-5);  // half of 1 / 65536 per axis, at worst twice that
  const std::string text = convert::describe(options, report, false);
  INFO(text);
  CHECK(std::count(text.begin(), text.end(), '\n') == 2);  // nothing was left out
  CHECK(text.find("bits/triangle") != std::string::npos);
  CHECK(convert::describe(options, report, true).find("triangles/s") != std::string::npos);
  CHECK(convert::json_report(options, report).find("\"triangles\":5000,") != std::string::npos);
  CHECK(report.geometry_bytes > 0);
  CHECK(report.geometry_bytes < report.output_bytes);
  const tests::PackedFile opened = must_open(options.output);
  CHECK(opened.file.string(opened.file.source().name) == "in.glb");
  CHECK(opened.file.source().position_bytes == 51 * 51 * 12);
  CHECK(opened.file.source().index_bytes == 5000 * 12);
  CHECK(opened.file.string(opened.file.source().options).find("--positions 16") != std::string_view::npos);
}
