// The glTF writer: its output is valid JSON with the given content, and a failed write leaves no files.
#include "tools/gltf/write/writer.h"

#include <chrono>
#include <filesystem>
#include <limits>
#include <nlohmann/json.hpp>

#include "format/bytes.h"
#include "tests/full_disk.h"
#include "tests/tools/model_maker.h"
#include "tests/tools/temp_folder.h"
#include "tools/common/output/json_writer.h"
#include "tools/gltf/source.h"

using namespace scree;
using namespace scree::tools;
using nlohmann::json;
using tests::read_whole;
using tests::TempFolder;

namespace {

std::span<const std::byte> bytes_of(std::string_view text) {
  return std::as_bytes(std::span(text));
}

/// Adds one of everything.
void fill(GltfWriter& writer) {
  const float positions[9] = {0, 0, 0, 0.1f, 0, 0, 0, 1e-7f, -0.0f};
  const uint64_t offset = must(writer.append(std::as_bytes(std::span(positions)), 16));
  REQUIRE(writer.append(bytes_of("abc"), 1));  // so that the next part begins unaligned
  const uint32_t view = writer.add_buffer_view({offset, sizeof positions, 0, GltfTarget::kVertices});
  const uint32_t position =
      writer.add_accessor({.buffer_view = view, .count = 3, .min = {0, 0, -0.0}, .max = {0.1f, 1e-7f, 0}});
  const uint32_t image = must(writer.add_image("a/b ü", format::ImageCodec::kPng, bytes_of("PNG")));
  REQUIRE(writer.add_image("A/B ü", format::ImageCodec::kPng, bytes_of("PNG2")));
  const GltfTexture texture{.image = image, .wrap_t = format::Wrap::kClamp};
  GltfMaterial material{.name = "quote \" back \\ bell \a \xff umlaut ü", .texture = writer.add_texture(texture)};
  material.transform.scale[0] = 0.5;
  material.unlit = true;
  GltfMesh mesh{"mesh", {{{{"POSITION", position}}, format::kNone, writer.add_material(material)}}};
  const uint32_t mesh_index = writer.add_mesh(mesh);
  GltfNode node{.name = "leaf", .mesh = mesh_index};
  node.local[0] = 0.1f;
  const uint32_t leaf = writer.add_node(node);
  const GltfNode root{
      .has_matrix = true, .local = {1, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0, 0, 1e300, 0, 0, 1}, .children = {leaf}};
  writer.add_camera({});
  writer.add_scene({"scene", {writer.add_node(root)}});
}

void check_document(const json& document) {
  CHECK(document["materials"][0]["name"] == "quote \" back \\ bell \a \xef\xbf\xbd umlaut ü");
  CHECK(static_cast<float>(document["accessors"][0]["max"][0].get<double>()) == 0.1f);
  CHECK(document["accessors"][0]["max"][0].get<double>() == double{0.1f});
  CHECK(document["nodes"][0]["translation"][0].get<double>() == double{0.1f});
  CHECK(!document["nodes"][0].contains("rotation"));
  CHECK(document["nodes"][1]["matrix"][12] == 1e300);
  CHECK(document["nodes"][1]["children"] == json{0});
  CHECK(document["extensionsUsed"] == json{"KHR_materials_unlit", "KHR_texture_transform"});
  CHECK(!document.contains("extensionsRequired"));
  CHECK(document["samplers"] == json::parse(R"([{"wrapT":33071}])"));
  CHECK(document["buffers"][0]["byteLength"].get<uint64_t>() >= 39);
  CHECK(!document.contains("animations"));
}

}  // namespace

TEST_CASE("a .gltf is written with its .bin and its images", "[gltf_writer]") {
  const TempFolder folder;
  GltfWriter writer = must(GltfWriter::create(folder.file("a b%.gltf")));
  fill(writer);
  for (const std::string& name : folder.names()) CHECK(std::filesystem::path(name).extension() == ".part");
  REQUIRE(writer.finish());
  CHECK(folder.names() == std::vector<std::string>{"a b%.bin", "a b%.gltf", "a b%_A_B____2.png", "a b%_a_b___.png"});
  const json document = json::parse(read_whole(folder.file("a b%.gltf")));
  check_document(document);
  CHECK(document["buffers"][0]["uri"] == "a%20b%25.bin");
  CHECK(document["images"][1]["uri"] == "a%20b%25_A_B____2.png");
  CHECK(read_whole(folder.file("a b%_A_B____2.png")) == "PNG2");
  CHECK(std::filesystem::file_size(folder.file("a b%.bin")) == document["buffers"][0]["byteLength"]);
}

TEST_CASE("images of equal names get the first free numbers, in time in proportion to the images", "[gltf_writer]") {
  const TempFolder folder;
  GltfWriter writer = must(GltfWriter::create(folder.file("x.gltf")));
  for (const char* name : {"a", "A", "a_2", "a_4", "a", "a"})
    REQUIRE(writer.add_image(name, format::ImageCodec::kPng, bytes_of("PNG")));
  const std::vector<GltfWriter::PlannedImage> planned(20000, {"", format::ImageCodec::kPng});
  const auto start = std::chrono::steady_clock::now();
  REQUIRE(writer.check_files(planned, folder.file("source")));
  CHECK(std::chrono::steady_clock::now() - start < std::chrono::seconds(20));
  REQUIRE(writer.finish());
  CHECK(folder.names() == std::vector<std::string>{"x.gltf", "x_A_2.png", "x_a.png", "x_a_2_2.png", "x_a_3.png",
                                                   "x_a_4.png", "x_a_5.png"});
}

TEST_CASE("a .glb that exceeds the lengths of version 2 has version 3", "[gltf_writer]") {
  const TempFolder folder;
  const auto written = [&](uint64_t most) {
    GltfWriter writer = must(GltfWriter::create(folder.file("x.glb")));
    fill(writer);
    writer.set_most_version_2_bytes(most);
    REQUIRE(writer.finish());
    const std::string file = read_whole(folder.file("x.glb"));
    CHECK(file.size() == writer.total_bytes());
    CHECK(folder.names() == std::vector<std::string>{"x.glb"});
    CHECK(writer.is_version_3() == (static_cast<unsigned char>(file[4]) == 3));
    return file;
  };
  const std::string narrow = written(uint64_t{1} << 32);
  CHECK(written(narrow.size()) == narrow);
  // It exceeds them by its buffer, and by its document alone.
  for (const uint64_t most : {uint64_t{1}, uint64_t{narrow.size() - 1}}) {
    const std::string wide = written(most);
    const auto* const bytes = reinterpret_cast<const std::byte*>(wide.data());
    REQUIRE(format::load<uint32_t>(bytes + 4) == 3);
    CHECK(format::load<uint64_t>(bytes + 8) == wide.size());
    CHECK(wide.substr(16, 4) == "JSON");
    CHECK(format::load<uint32_t>(bytes + 20) == 0);
    const uint64_t json_bytes = format::load<uint64_t>(bytes + 24);
    CHECK(json_bytes % 8 == 0);
    const json document = json::parse(wide.substr(32, json_bytes));
    check_document(document);
    const uint64_t chunk = 32 + json_bytes;
    CHECK(wide.substr(chunk, 4) == std::string("BIN\0", 4));
    const uint64_t binary_bytes = format::load<uint64_t>(bytes + chunk + 8);
    CHECK(chunk + 16 + binary_bytes == wide.size());
    CHECK(binary_bytes - document["buffers"][0]["byteLength"].get<uint64_t>() < 8);
    CHECK(format::load<float>(bytes + chunk + 16 + 12) == 0.1f);
  }
  // convert's reader returns the written data.
  tests::ModelMaker maker(folder.file("y.glb"));
  maker.writer().set_most_version_2_bytes(1);
  maker.node("node", maker.mesh("mesh", {maker.primitive({0, 0, 0, 0.1f, 0, 0, 0, 1, 0}, {0, 1, 2})}));
  maker.finish();
  CHECK(maker.writer().is_version_3());
  const auto scene = must(convert::import_gltf(folder.file("y.glb"), {}));
  std::vector<float> positions(9);
  REQUIRE(read_floats(scene.primitives.at(0).positions, 0, 3, positions));
  CHECK(positions[3] == 0.1f);
}

TEST_CASE("a .glb is written with its chunks", "[gltf_writer]") {
  const TempFolder folder;
  GltfWriter writer = must(GltfWriter::create(folder.file("x.glb")));
  fill(writer);
  REQUIRE(writer.finish());
  CHECK(folder.names() == std::vector<std::string>{"x.glb"});
  const std::string file = read_whole(folder.file("x.glb"));
  CHECK(file.size() == writer.total_bytes());
  const auto u32 = [&](size_t place) {
    return format::load<uint32_t>(reinterpret_cast<const std::byte*>(&file[place]));
  };
  CHECK(file.substr(0, 4) == "glTF");
  CHECK(u32(4) == 2);
  CHECK(u32(8) == file.size());
  const uint32_t json_bytes = u32(12);
  CHECK(json_bytes % 4 == 0);
  CHECK(file.substr(16, 4) == "JSON");
  const json document = json::parse(file.substr(20, json_bytes));
  check_document(document);
  CHECK(u32(20 + json_bytes) == file.size() - 28 - json_bytes);
  CHECK(file.substr(24 + json_bytes, 4) == std::string("BIN\0", 4));
  const auto& view = document["bufferViews"][document["images"][1]["bufferView"].get<size_t>()];
  CHECK(file.substr(28 + json_bytes + view["byteOffset"].get<size_t>(), view["byteLength"]) == "PNG2");
}

TEST_CASE("an unfinished glTF leaves nothing behind", "[gltf_writer]") {
  const TempFolder folder;
  for (const char* name : {"x.gltf", "x.glb"}) {
    GltfWriter writer = must(GltfWriter::create(folder.file(name)));
    fill(writer);
  }
  CHECK(folder.names().empty());
}

TEST_CASE("the writer refuses invalid input", "[gltf_writer]") {
  const TempFolder folder;
  CHECK(GltfWriter::create(folder.file("x.obj")).error().code == ErrorCode::kUsage);
  CHECK(GltfWriter::create(folder.file("missing/x.glb")).error().code == ErrorCode::kFile);
  {
    GltfWriter writer = must(GltfWriter::create(folder.file("x.glb")));
    REQUIRE(writer.reserve(uint64_t{1} << 62));
    check_refusal(writer.reserve(100), ErrorCode::kRange, "a buffer of more than 2^62 bytes");
  }
  {
    GltfWriter writer = must(GltfWriter::create(folder.file("x.gltf")));
    GltfNode node;
    node.local[1] = std::numeric_limits<double>::quiet_NaN();
    writer.add_node(node);
    CHECK(writer.finish().error().code == ErrorCode::kRange);
  }
  // The document can no longer get its name, so the buffer, which was already renamed, is removed.
  {
    GltfWriter writer = must(GltfWriter::create(folder.file("dir.gltf")));
    fill(writer);
    std::filesystem::create_directory(folder.file("dir.gltf"));
    CHECK(writer.finish().error().code == ErrorCode::kFile);
  }
  CHECK(folder.names() == std::vector<std::string>{"dir.gltf"});
  CHECK(GltfWriter::create(folder.file("dir.gltf")).error().message.find("dir.gltf: is a folder") != std::string::npos);
}

TEST_CASE("a full disk leaves nothing behind", "[gltf_writer]") {
  const TempFolder folder;
  Result<uint64_t> offset = uint64_t{0};
  Result<void> finished;
  tests::on_full_disk(64 << 10, [&] {
    Result<GltfWriter> writer = GltfWriter::create(folder.file("x.gltf"));
    if (writer) offset = writer->append(std::vector<std::byte>(65 << 10));
    Result<GltfWriter> glb = GltfWriter::create(folder.file("y.glb"));  // each of the two parts fits, but not both
    if (glb && glb->append(std::vector<std::byte>(64 << 10))) finished = glb->finish();
  });
  CHECK(refusal(offset).code == ErrorCode::kFile);
  CHECK(refusal(finished).code == ErrorCode::kFile);
  CHECK(folder.names().empty());
}

TEST_CASE("JSON numbers and strings are read as they were written", "[gltf_writer]") {
  std::string text;
  JsonWriter writer(text);
  writer.begin_array();
  const double numbers[] = {0.1, 1.0 / 3.0, 5e-324, 1.7976931348623157e308, -0.0, 1e21, 123456789.0, double{0.1f}};
  for (const double number : numbers) writer.value(number);
  writer.begin_object();
  writer.member("k\"", uint64_t{0xffffffffffffffff});
  writer.member("t", true);
  writer.end_object();
  writer.begin_array();
  writer.end_array();
  writer.end_array();
  CHECK(!writer.met_non_finite());
  const json parsed = json::parse(text);
  for (size_t i = 0; i < std::size(numbers); ++i) CHECK(parsed[i].get<double>() == numbers[i]);
  CHECK(parsed[std::size(numbers)]["k\""] == 0xffffffffffffffff);
  CHECK(json::parse("\"" + json_escaped("\xed\xa0\x80 \xc0\x80 \xf0\x9f\x98\x80 \xe2\x82") + "\"") ==
        "\xef\xbf\xbd\xef\xbf\xbd\xef\xbf\xbd \xef\xbf\xbd\xef\xbf\xbd \xf0\x9f\x98\x80 \xef\xbf\xbd\xef\xbf\xbd");
}
