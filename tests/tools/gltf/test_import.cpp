// The generated models of tests/data, value by value: the expected result of every accessor, material and node case.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <random>
#include <string>
#include <vector>

#include "tests/models.h"
#include "tests/results.h"
#include "tests/tools/compare/compare_scenes.h"
#include "tests/tools/gltf/read_all.h"
#include "tests/tools/temp_folder.h"
#include "tools/gltf/source.h"

namespace scree::convert {
namespace {

using Triangles = std::vector<uint32_t>;

SourceScene import_file(const std::string& path, const ImportOptions& options = {}) {
  return must(import_gltf(path, options));
}

SourceScene import_data(const char* name, const ImportOptions& options = {}) {
  return import_file(tests::data_path(name).string(), options);
}

Triangles all_triangles(const Primitive& primitive) {
  const Triangles out = tests::all_corners(primitive);
  // Reading triangle by triangle gives the same result: strips reverse every other triangle, wherever a window begins.
  for (uint64_t i = 0; i < primitive.triangle_count(); ++i) {
    std::array<uint32_t, 3> one;
    REQUIRE(read_triangles(primitive, i, 1, one));
    CHECK(std::equal(one.begin(), one.end(), out.begin() + static_cast<std::ptrdiff_t>(i * 3)));
  }
  return out;
}

const LeftOut* find_left_out(const SourceScene& scene, const std::string& what) {
  const auto found = std::find_if(scene.left_out.begin(), scene.left_out.end(),
                                  [&](const LeftOut& entry) { return entry.what == what; });
  return found == scene.left_out.end() ? nullptr : &*found;
}

bool warns(const SourceScene& scene, const std::string& part) {
  return std::any_of(scene.warnings.begin(), scene.warnings.end(),
                     [&](const std::string& line) { return line.find(part) != std::string::npos; });
}

const std::vector<float> kTetrahedron{0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1};
const Triangles kTetrahedronTriangles{0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3};

TEST_CASE("a textured cube is imported from a .glb", "[import]") {
  const SourceScene scene = import_data("textured_cube.glb");
  CHECK(scene.file_name == "textured_cube.glb");
  CHECK(scene.json_bytes > 500);
  CHECK(scene.buffer_bytes > 800);
  REQUIRE(scene.groups.size() == 1);
  CHECK(scene.groups[0].name == "cube");
  REQUIRE(scene.primitives.size() == 1);
  const Primitive& cube = scene.primitives[0];
  CHECK(cube.vertex_count() == 24);
  CHECK(cube.triangle_count() == 12);
  REQUIRE(cube.uv);
  REQUIRE(cube.normal);
  CHECK_FALSE(cube.color);

  const Triangles triangles = all_triangles(cube);
  CHECK(Triangles(triangles.begin(), triangles.begin() + 6) == Triangles{0, 1, 2, 0, 2, 3});
  for (const float value : tests::all_values(cube.positions)) CHECK(std::abs(value) == 1.0f);

  REQUIRE(scene.materials.size() == 1);
  REQUIRE(scene.textures.size() == 1);
  REQUIRE(scene.images.size() == 1);
  CHECK(scene.materials[0].name == "checker");
  CHECK(scene.materials[0].record.texture == 0);
  CHECK(scene.textures[0].record.wrap_s == format::Wrap::kRepeat);
  CHECK(scene.textures[0].record.wrap_t == format::Wrap::kMirror);
  CHECK(scene.textures[0].record.mag_filter == 9728);
  CHECK(scene.textures[0].record.min_filter == 9987);
  CHECK(scene.images[0].name == "checker");
  CHECK(scene.images[0].codec == format::ImageCodec::kPng);
  std::vector<std::byte> head(8);
  REQUIRE(scene.images[0].source->read(scene.images[0].offset, head));
  CHECK(std::memcmp(head.data(), "\x89PNG\r\n\x1a\n", 8) == 0);
  REQUIRE(scene.scenes.size() == 1);
  CHECK(scene.scenes[0].is_default);
  CHECK(scene.scenes[0].roots == std::vector<uint32_t>{0});
  CHECK(scene.warnings.empty());
}

TEST_CASE("two instances of a mesh are imported from a .gltf and its .bin", "[import]") {
  const SourceScene scene = import_data("two_instances.gltf");
  REQUIRE(scene.primitives.size() == 1);
  CHECK(scene.primitives[0].material == format::kNone);
  CHECK(all_triangles(scene.primitives[0]) == kTetrahedronTriangles);
  CHECK(tests::all_values(scene.primitives[0].positions) == kTetrahedron);
  REQUIRE(scene.nodes.size() == 2);
  CHECK(scene.nodes[0].name == "left");
  CHECK(scene.nodes[0].group == 0);
  CHECK(scene.nodes[0].local[0] == -2.0);
  CHECK(scene.nodes[0].local[6] == 1.0);
  CHECK(scene.nodes[1].group == 0);
  CHECK(scene.nodes[1].local[6] == Approx(std::sqrt(0.5)));
  CHECK(scene.nodes[1].local[8] == 2.0);
}

TEST_CASE("a data: URI holds a buffer", "[import]") {
  const SourceScene scene = import_data("data_uri.gltf");
  REQUIRE(scene.primitives.size() == 1);
  CHECK(all_triangles(scene.primitives[0]) == kTetrahedronTriangles);
  CHECK(tests::all_values(scene.primitives[0].positions) == kTetrahedron);

  // The same bytes percent-encoded, some of them as plain characters.
  const std::string text = tests::read_whole(tests::data_path("data_uri.gltf").string());
  const size_t begin = text.find("data:");
  const std::string uri = text.substr(begin, text.find('"', begin) - begin);
  std::string percent = "data:,";
  std::vector<std::byte> bytes(60);
  REQUIRE(scene.primitives[0].positions.source->read(0, bytes));
  for (const std::byte b : bytes) {
    char code[4];
    std::snprintf(code, sizeof code, "%%%02x", static_cast<unsigned>(b));
    percent += b == std::byte{'?'} ? "?" : code;
  }
  const tests::TempFolder folder;
  const SourceScene again = import_file(folder.write("percent.gltf", tests::replaced(text, uri, percent)));
  CHECK(tests::all_values(again.primitives[0].positions) == kTetrahedron);
}

TEST_CASE("indices of 8, 16 and 32 bits and no indices give the same triangles", "[import]") {
  const SourceScene scene = import_data("index_types.glb");
  REQUIRE(scene.primitives.size() == 4);
  for (size_t i = 0; i < 3; ++i) {
    REQUIRE(scene.primitives[i].indices);
    CHECK(scene.primitives[i].indices->type ==
          std::array{ComponentType::kUint8, ComponentType::kUint16, ComponentType::kUint32}[i]);
    CHECK(all_triangles(scene.primitives[i]) == kTetrahedronTriangles);
  }
  const Primitive& flat = scene.primitives[3];
  CHECK_FALSE(flat.indices);
  CHECK(flat.vertex_count() == 12);
  CHECK(all_triangles(flat) == Triangles{0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11});
}

TEST_CASE("strips and fans are read as triangles with their winding", "[import]") {
  const SourceScene scene = import_data("modes.glb");
  REQUIRE(scene.primitives.size() == 5);
  CHECK(all_triangles(scene.primitives[0]) == Triangles{0, 1, 2, 1, 3, 2, 2, 3, 4, 3, 5, 4, 4, 5, 6, 5, 7, 6});
  CHECK(all_triangles(scene.primitives[1]) ==
        Triangles{0, 1, 2, 1, 3, 2, 2, 3, 3, 3, 4, 3, 3, 4, 4, 4, 5, 4, 4, 5, 6, 5, 7, 6});
  const Triangles fan = all_triangles(scene.primitives[2]);
  REQUIRE(fan.size() == 8 * 3);
  CHECK(Triangles(fan.begin(), fan.begin() + 6) == Triangles{1, 2, 0, 2, 3, 0});
  CHECK(all_triangles(scene.primitives[3]) == Triangles{2, 4, 0, 4, 6, 0, 6, 8, 0});
  CHECK(all_triangles(scene.primitives[4]) == Triangles{0, 1, 2, 0, 2, 3});
  REQUIRE(find_left_out(scene, "points") != nullptr);
  CHECK(find_left_out(scene, "points")->count == 1);
  REQUIRE(find_left_out(scene, "lines") != nullptr);
  CHECK(find_left_out(scene, "lines")->count == 3);
  CHECK(warns(scene, "1 primitive of points"));
  CHECK(warns(scene, "3 primitives of lines"));
  CHECK(scene.groups.size() == 5);
  CHECK(scene.nodes[5].group == format::kNone);
  CHECK(scene.nodes[6].group == format::kNone);
}

TEST_CASE("interleaved attributes are read with their stride", "[import]") {
  const SourceScene scene = import_data("interleaved.glb");
  REQUIRE(scene.primitives.size() == 1);
  const Primitive& quad = scene.primitives[0];
  CHECK(quad.positions.stride == 40);
  CHECK(tests::all_values(quad.positions) == std::vector<float>{-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0});
  CHECK(tests::all_values(quad.uv) == std::vector<float>{0, 1, 1, 1, 1, 0, 0, 0});
  CHECK(tests::all_values(quad.normal) == std::vector<float>{0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1});
  const std::vector<float> colors = tests::all_values(quad.color);
  CHECK(colors[0] == 1.0f);
  CHECK(colors[1] == 0.0f);
  CHECK(colors[15] == 128.0f / 255.0f);
  REQUIRE(scene.images.size() == 1);
  CHECK(scene.images[0].codec == format::ImageCodec::kJpeg);
}

TEST_CASE("sparse accessors replace values of a base, of zeros and of indices", "[import]") {
  const SourceScene scene = import_data("sparse.gltf");
  REQUIRE(scene.primitives.size() == 3);
  std::vector<float> grid;
  for (int y = 0; y < 3; ++y)
    for (int x = 0; x < 3; ++x) grid.insert(grid.end(), {static_cast<float>(x), static_cast<float>(y), 0.0f});
  std::vector<float> raised = grid;
  raised[4 * 3 + 2] = 0.5f;
  raised[8 * 3] = raised[8 * 3 + 1] = 2.5f;
  raised[8 * 3 + 2] = 1.0f;
  CHECK(tests::all_values(scene.primitives[0].positions) == raised);
  CHECK(scene.primitives[1].positions.source == nullptr);
  CHECK(tests::all_values(scene.primitives[1].positions) == grid);
  const Triangles turned = all_triangles(scene.primitives[2]);
  CHECK(Triangles(turned.end() - 3, turned.end()) == Triangles{4, 4, 4});

  // Any window and any list of elements gives the same values.
  for (const auto& [primitive, whole] : {std::pair{0, raised}, std::pair{1, grid}}) {
    const Accessor& accessor = scene.primitives[static_cast<size_t>(primitive)].positions;
    for (uint64_t first = 0; first < 9; ++first) {
      for (uint64_t count = 0; count <= 9 - first; ++count) {
        std::vector<float> part(count * 3);
        REQUIRE(read_floats(accessor, first, count, part));
        CHECK(std::equal(part.begin(), part.end(), whole.begin() + static_cast<std::ptrdiff_t>(first * 3)));
      }
    }
    const std::array<uint32_t, 4> some{0, 4, 5, 8};
    std::vector<float> gathered(12);
    REQUIRE(gather_floats(accessor, some, gathered));
    for (size_t i = 0; i < some.size(); ++i)
      for (size_t c = 0; c < 3; ++c) CHECK(gathered[i * 3 + c] == whole[some[i] * 3 + c]);
  }
}

TEST_CASE("quantised attributes are scaled by glTF's rules", "[import]") {
  const SourceScene scene = import_data("quantized.glb");
  REQUIRE(scene.primitives.size() == 8);
  constexpr std::array<float, 4> kTop{127, 255, 32767, 65535};
  for (size_t i = 0; i < 8; ++i) {
    const Primitive& primitive = scene.primitives[i];
    const bool normalized = i % 2 == 1;
    const float top = normalized ? 1.0f : kTop[i / 2];
    const bool is_signed = i / 2 == 0 || i / 2 == 2;
    std::vector<float> expected(kTetrahedron);
    for (float& value : expected) value *= top;
    // The first corner has the lowest value of a signed type. Normalised, it becomes -1 like its neighbour.
    if (is_signed) std::fill_n(expected.begin(), 3, normalized ? -1.0f : -top - 1.0f);
    CHECK(tests::all_values(primitive.positions) == expected);
    CHECK(tests::all_values(primitive.uv)[6] == (normalized ? 1.0f : 2.0f));
    CHECK(tests::all_values(primitive.normal)[3] == 1.0f);
  }
}

TEST_CASE("materials, textures, images and texture coordinates are connected", "[import]") {
  const SourceScene scene = import_data("materials.gltf");
  REQUIRE(scene.materials.size() == 7);
  const auto material = [&](size_t i) { return scene.materials[i].record; };
  CHECK(scene.materials[0].name == "plain");
  CHECK(material(0).texture == format::kNone);
  CHECK(material(0).base_color[1] == 0.4f);
  CHECK(material(0).uv_scale[0] == 1.0f);
  CHECK(material(2).flags == format::kMaterialDoubleSided);
  CHECK(material(3).flags == format::kMaterialAlphaMask);
  CHECK(material(3).alpha_cutoff == 0.25f);
  CHECK(material(5).flags == format::kMaterialAlphaBlend);
  CHECK(material(6).flags == format::kMaterialUnlit);
  CHECK(material(4).uv_offset[0] == 0.25f);
  CHECK(material(4).uv_offset[1] == 0.5f);
  CHECK(material(4).uv_scale[0] == 2.0f);
  CHECK(material(4).uv_scale[1] == -3.0f);
  CHECK(material(4).uv_rotation == 0.5f);
  CHECK(scene.primitives[7].material == format::kNone);

  // Two textures share the checker image. The order of the materials determines the order of the textures.
  REQUIRE(scene.images.size() == 3);
  REQUIRE(scene.textures.size() == 4);
  CHECK(material(1).texture == material(6).texture);
  CHECK(material(1).texture != material(4).texture);
  CHECK(scene.textures[material(1).texture].record.image == scene.textures[material(4).texture].record.image);
  const format::TextureRecord& tiles = scene.textures[material(2).texture].record;
  CHECK(scene.images[tiles.image].codec == format::ImageCodec::kJpeg);
  CHECK(scene.images[tiles.image].bytes == 197);
  CHECK(tiles.wrap_s == format::Wrap::kClamp);
  CHECK(tiles.wrap_t == format::Wrap::kMirror);
  CHECK(tiles.min_filter == 9986);
  CHECK(scene.textures[material(4).texture].record.min_filter == 0);

  // Without a texture no coordinates are read. texCoord of KHR_texture_transform overrides that of the texture
  // information.
  CHECK_FALSE(scene.primitives[0].uv);
  CHECK(tests::all_values(scene.primitives[1].uv)[2] == 1.0f);
  CHECK(tests::all_values(scene.primitives[4].uv)[2] == 2.0f);
  CHECK(tests::all_values(scene.primitives[5].uv)[2] == 2.0f);
  CHECK_FALSE(scene.primitives[7].uv);

  REQUIRE(find_left_out(scene, "unused materials") != nullptr);
  CHECK(find_left_out(scene, "TEXCOORD_0") == nullptr);  // used by some primitives, so not left out
}

TEST_CASE("vertex colours of every type give the same values", "[import]") {
  const SourceScene scene = import_data("colors.glb");
  REQUIRE(scene.primitives.size() == 6);
  for (const Primitive& primitive : scene.primitives) {
    const std::vector<float> values = tests::all_values(primitive.color);
    const uint32_t width = primitive.color->components;
    for (size_t corner = 0; corner < 4; ++corner)
      for (size_t c = 0; c < 3; ++c) CHECK(values[corner * width + c] == (corner == 3 || corner == c ? 1.0f : 0.0f));
    if (width == 4) CHECK(values[15] == 0.0f);
  }
}

TEST_CASE("instances of EXT_mesh_gpu_instancing are imported", "[import]") {
  const SourceScene scene = import_data("gpu_instancing.glb");
  REQUIRE(scene.nodes.size() == 3);
  const SourceNode& all = scene.nodes[1];
  CHECK(all.name == "all");
  CHECK(all.parent == 0);
  const auto first = tests::all_instances(all);
  REQUIRE(first.size() == 6);
  CHECK(first[2].translation[0] == 4.0f);
  CHECK(first[2].translation[2] == 1.0f);
  CHECK(first[2].rotation[3] == 1.0f);
  CHECK(first[3].rotation[2] == Approx(std::sqrt(0.5)));
  CHECK(first[3].rotation[3] == Approx(std::sqrt(0.5)));
  CHECK(first[3].scale[1] == 4.0f);
  CHECK(first[3].scale[2] == -1.0f);
  const auto second = tests::all_instances(scene.nodes[2]);
  REQUIRE(second.size() == 2);
  CHECK(second[1].translation[0] == 1.0f);
  CHECK(second[1].rotation[3] == 1.0f);
  CHECK(second[1].scale[0] == 1.0f);
}

TEST_CASE("nodes are ordered parents first, with cameras and scenes", "[import]") {
  const SourceScene scene = import_data("nodes.gltf");
  std::vector<std::string> names;
  for (const SourceNode& node : scene.nodes) names.push_back(node.name);
  CHECK(names == std::vector<std::string>{"root", "branch", "leaf", "FogCard.001", "eye", "above", "flat", "empty"});
  for (uint32_t i = 0; i < scene.nodes.size(); ++i)
    CHECK((scene.nodes[i].parent == format::kNone || scene.nodes[i].parent < i));
  CHECK(scene.nodes[0].has_matrix);
  CHECK(scene.nodes[0].local[1] == 1.0);
  CHECK(scene.nodes[0].local[12] == 10.0);
  CHECK(scene.nodes[2].parent == 1);
  CHECK(scene.nodes[2].local[7] == -1.0);
  CHECK(scene.nodes[6].local[9] == 0.0);

  REQUIRE(scene.cameras.size() == 2);
  CHECK(scene.nodes[4].camera == 0);
  CHECK(scene.cameras[0].name == "wide");
  CHECK(scene.cameras[0].record.kind == format::CameraKind::kPerspective);
  CHECK(scene.cameras[0].record.y == 1.0);
  CHECK(scene.cameras[0].record.x == 1.5);
  CHECK(scene.cameras[0].record.z_far == 0.0);
  CHECK(scene.cameras[1].record.kind == format::CameraKind::kOrthographic);
  CHECK(scene.cameras[1].record.y == 3.0);
  CHECK(scene.cameras[1].record.x == 4.0);
  CHECK(scene.cameras[1].record.z_far == 100.0);

  REQUIRE(scene.scenes.size() == 2);
  CHECK(scene.scenes[0].name == "first");
  CHECK_FALSE(scene.scenes[0].is_default);
  CHECK(scene.scenes[0].roots == std::vector<uint32_t>{0, 4});
  CHECK(scene.scenes[1].is_default);
  CHECK(scene.scenes[1].roots == std::vector<uint32_t>{5, 6, 7, 0});
  REQUIRE(find_left_out(scene, "unused meshes") != nullptr);
  REQUIRE(find_left_out(scene, "nodes outside every scene") != nullptr);
  CHECK(find_left_out(scene, "nodes outside every scene")->count == 1);
}

TEST_CASE("the option --exclude drops matching nodes and all nodes below them", "[import]") {
  ImportOptions options{.exclude = "^FogCard|Plane"};
  const SourceScene scene = import_data("nodes.gltf", options);
  CHECK(scene.nodes.size() == 7);
  REQUIRE(find_left_out(scene, "excluded nodes") != nullptr);
  CHECK(find_left_out(scene, "excluded nodes")->count == 1);

  options.exclude = "^root$";
  const SourceScene pruned = import_data("nodes.gltf", options);
  REQUIRE(pruned.nodes.size() == 4);
  CHECK(find_left_out(pruned, "excluded nodes")->count == 4);
  CHECK(pruned.scenes[0].roots == std::vector<uint32_t>{0});
  CHECK(pruned.groups.size() == 1);  // "flat" still draws the mesh

  // Objects that only excluded nodes use are excluded as well.
  options.exclude = ".";
  const SourceScene none = import_data("textured_cube.glb", options);
  CHECK(none.nodes.empty());
  CHECK(none.groups.empty());
  CHECK(none.primitives.empty());
  CHECK(none.materials.empty());
  CHECK(none.images.empty());

  options.exclude = "no such name";
  CHECK(warns(import_data("nodes.gltf", options), "matches no node"));
  options.exclude = "[unclosed";
  CHECK(refusal(import_gltf(tests::data_path("nodes.gltf").string(), options)).code == ErrorCode::kUsage);
}

TEST_CASE("primitives with nothing to draw are left out, and all others are kept", "[import]") {
  const SourceScene scene = import_data("multi_primitive.glb");
  REQUIRE(scene.groups.size() == 1);
  REQUIRE(scene.primitives.size() == 2);
  CHECK(scene.primitives[0].place == 0);
  CHECK(scene.primitives[1].place == 2);
  CHECK(scene.primitives[1].normal);
  CHECK(scene.primitives[0].material == 0);
  CHECK(scene.primitives[1].material == 1);
  REQUIRE(scene.nodes.size() == 3);
  CHECK(scene.nodes[1].group == format::kNone);
  CHECK(scene.nodes[2].group == format::kNone);
  CHECK(find_left_out(scene, "primitives without triangles")->count == 2);
  CHECK(find_left_out(scene, "primitives without POSITION")->count == 1);
}

TEST_CASE("left-out data are listed with count and bytes", "[import]") {
  const SourceScene scene = import_data("left_out.glb");
  const auto expect = [&](const char* what, uint64_t count, uint64_t bytes) {
    INFO(what);
    const LeftOut* entry = find_left_out(scene, what);
    REQUIRE(entry != nullptr);
    CHECK(entry->count == count);
    CHECK(entry->source_bytes == bytes);
  };
  expect("NORMAL", 1, 48);
  expect("TANGENT", 1, 64);
  expect("TEXCOORD_0", 1, 32);
  expect("TEXCOORD_1", 1, 32);
  expect("COLOR_1", 1, 48);
  expect("JOINTS_0", 1, 16);
  expect("WEIGHTS_0", 1, 64);
  expect("application-specific attributes", 1, 16);
  expect("morph targets", 1, 48);
  expect("skins", 1, 64);
  expect("animations", 1, 8 + 24);
  CHECK(find_left_out(scene, "COLOR_0") == nullptr);
  CHECK(warns(scene, "1 skin is left out"));
  CHECK(warns(scene, "1 animation is left out"));
  CHECK(warns(scene, "morph targets of 1 primitive"));
  REQUIRE(scene.primitives.size() == 1);
  CHECK(scene.primitives[0].color);
}

TEST_CASE("a left-out accessor that two attributes share is counted once", "[import]") {
  const tests::TempFolder folder;
  std::string text = tests::read_whole(tests::data_path("data_uri.gltf").string());
  text = tests::replaced(text, R"("type":"SCALAR"}])",
                         R"("type":"SCALAR"},{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3"}])");
  text = tests::replaced(text, R"("POSITION":0})", R"("POSITION":0,"_A":2,"_B":2})");
  const SourceScene scene = import_file(folder.write("shared.gltf", text));
  REQUIRE(scene.left_out.size() == 1);
  CHECK(scene.left_out[0].what == "application-specific attributes");
  CHECK(scene.left_out[0].count == 1);
  CHECK(scene.left_out[0].source_bytes == 48);
}

TEST_CASE("gathering a list of elements equals reading them one by one", "[import]") {
  const SourceScene scene = import_data("grid.glb");
  REQUIRE(scene.primitives.size() == 1);
  const Primitive& sheet = scene.primitives[0];
  CHECK(sheet.triangle_count() == 2048);
  std::mt19937 random(7);
  const auto below = [&](uint32_t n) { return static_cast<uint32_t>(random() % n); };
  for (const Accessor* accessor : {&sheet.positions, &*sheet.uv}) {
    const std::vector<float> whole = tests::all_values(*accessor);
    for (const uint32_t step : {1u, 2u, 5u, 300u, 5000u}) {
      std::vector<uint32_t> numbers;
      for (uint32_t at = below(3); at < accessor->count; at += 1 + below(step)) numbers.push_back(at);
      std::vector<float> gathered(numbers.size() * accessor->components);
      REQUIRE(gather_floats(*accessor, numbers, gathered));
      for (size_t i = 0; i < numbers.size(); ++i) {
        for (uint32_t c = 0; c < accessor->components; ++c)
          REQUIRE(gathered[i * accessor->components + c] == whole[size_t{numbers[i]} * accessor->components + c]);
      }
    }
  }
}

TEST_CASE("accessors longer than a window are read completely", "[import]") {
  // 60,000 vertices 20 bytes apart and as many 16-bit indices; windows hold 64 KiB.
  constexpr uint32_t kCount = 60000;
  std::string bin(kCount * 22, '\0');
  for (uint32_t i = 0; i < kCount; ++i) {
    const std::array<float, 3> p{static_cast<float>(i), static_cast<float>(i) / 4, -1.0f};
    std::memcpy(bin.data() + i * 20, p.data(), 12);
    const uint16_t index = static_cast<uint16_t>((i * 7) % kCount);
    std::memcpy(bin.data() + kCount * 20 + i * 2, &index, 2);
  }
  const tests::TempFolder folder;
  folder.write("long.bin", bin);
  const auto scene_of = [&](int mode) {
    return import_file(folder.write(
        "long.gltf",
        R"({"asset":{"version":"2.0"},"buffers":[{"uri":"long.bin","byteLength":1320000}],"bufferViews":[{"buffer":0,
        "byteLength":1200000,"byteStride":20},{"buffer":0,"byteOffset":1200000,"byteLength":120000}],"accessors":[{
        "bufferView":0,"componentType":5126,"type":"VEC3","count":60000},{"bufferView":1,"componentType":5123,"type":
        "SCALAR","count":60000}],"meshes":[{"primitives":[{"mode":)" +
            std::to_string(mode) +
            R"(,"attributes":{"POSITION":0},"indices":1}]}],"nodes":[{"mesh":0}],"scenes":[{"nodes":[0]}]})"));
  };
  const auto index = [&](uint64_t i) { return static_cast<uint32_t>((i * 7) % kCount); };
  const SourceScene list = scene_of(4);
  const std::vector<float> positions = tests::all_values(list.primitives[0].positions);
  for (uint32_t i = 0; i < kCount; ++i) {
    REQUIRE(positions[i * 3] == static_cast<float>(i));
    REQUIRE(positions[i * 3 + 2] == -1.0f);
  }
  Triangles triangles(kCount);
  REQUIRE(read_triangles(list.primitives[0], 0, kCount / 3, triangles));
  for (uint32_t i = 0; i < kCount; ++i) REQUIRE(triangles[i] == index(i));

  const SourceScene strip = scene_of(5), fan = scene_of(6);
  constexpr uint64_t kFirst = 4091;
  constexpr uint64_t kSome = 9000;
  Triangles of_strip(kSome * 3), of_fan(kSome * 3);
  REQUIRE(read_triangles(strip.primitives[0], kFirst, kSome, of_strip));
  REQUIRE(read_triangles(fan.primitives[0], kFirst, kSome, of_fan));
  for (uint64_t i = 0; i < kSome; ++i) {
    const uint64_t place = kFirst + i;
    const bool odd = place % 2 == 1;
    REQUIRE(of_strip[i * 3] == index(place));
    REQUIRE(of_strip[i * 3 + 1] == index(place + (odd ? 2 : 1)));
    REQUIRE(of_strip[i * 3 + 2] == index(place + (odd ? 1 : 2)));
    REQUIRE(of_fan[i * 3] == index(place + 1));
    REQUIRE(of_fan[i * 3 + 1] == index(place + 2));
    REQUIRE(of_fan[i * 3 + 2] == 0);
  }
}

}  // namespace
}  // namespace scree::convert
