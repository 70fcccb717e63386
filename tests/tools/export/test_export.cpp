#include <algorithm>
#include <atomic>
#include <cstring>
#include <filesystem>
#include <numbers>
#include <string>
#include <vector>

#include "tests/format/container/container_fixture.h"
#include "tests/models.h"
#include "tests/results.h"
#include "tests/sanitized.h"
#include "tests/tools/compare/compare_scenes.h"
#include "tests/tools/packed_file.h"
#include "tests/tools/validator.h"
#include "tools/export/export.h"
#include "tools/export/primitives.h"
#include "tools/gltf/write/writer.h"
#include "tools/inspect/verify.h"

namespace scree {
namespace {

namespace fs = std::filesystem;

/// The options of model `number`. Encodings take turns, so that each is used on real models.
convert::ConvertOptions variant(size_t number) {
  convert::ConvertOptions options;
  options.source_ids = true;
  options.normals = number % 2 == 0 ? convert::Normals::kAlways : convert::Normals::kNever;
  options.drop_nonfinite = true;
  options.zstd_level = number % 3 == 0 ? 3 : 0;
  options.chunk_triangles = number % 4 == 1 ? 100 : number % 4 == 3 ? 0 : format::kMaxChunkTriangles;
  options.order = number % 5 == 4 ? convert::Order::kNone : convert::Order::kFifo;
  options.float32 = number % 7 == 6;
  if (number % 3 != 1) options.encoding = convert::Encoding::kClustered;
  if (number % 6 == 2) options.clusters = tools::ClusterEffort::kBest;
  if (number % 7 == 5) options.position_bits = 22;
  if (number % 7 == 3) options.position_bits = 10;
  // Indices of JPEGs would take most of the time.
  if (tests::kIsSanitized && number % 3 != 2) options.images.textures = convert::Textures::kRaw;
  return options;
}

tools::ExportOptions with_threads(uint32_t threads) {
  return {.threads = threads};
}

/// Converts, verifies, exports, imports again and compares. Returns false if the source cannot be converted.
bool round_trip(const fs::path& source_path, size_t number, const std::string& exported,
                const tests::TempFolder& folder) {
  INFO(source_path.string());
  const auto packed = tests::pack(source_path.string(), folder.file("packed.scree"), variant(number));
  if (!packed) {
    INFO(packed.error().message);
    // Refused input must have a reason that is not a bug.
    CHECK(packed.error().code != ErrorCode::kMemory);
    CHECK(packed.error().message.find("unexpected") == std::string::npos);
    return false;
  }
  const inspect::VerifyReport verified = inspect::verify(packed->file, packed->map.bytes(), 2);
  for (const inspect::Failure& failure : verified.failures) FAIL_CHECK(failure.error.message);
  CHECK(verified.failure_count == 0);
  CHECK(verified.chunks == packed->file.chunks().size());
  CHECK(verified.images == packed->file.images().size());

  const auto summary = tools::export_gltf(packed->file, exported, with_threads(2));
  if (!summary) {
    FAIL_CHECK(summary.error().message);
    return true;
  }
  uint64_t triangles = 0;
  for (uint64_t i = 0; i < packed->file.meshes().size(); ++i) triangles += packed->file.meshes()[i].triangle_count;
  CHECK(summary->triangles == triangles);

  const auto source = must(convert::import_gltf(source_path.string(), {}));
  const auto back = convert::import_gltf(exported, {});
  if (!back) {
    FAIL_CHECK(back.error().message);
    return true;
  }
  for (uint64_t i = 0; i < packed->file.left_out().size(); ++i)  // the export lacks data that are not stored
    if (packed->file.string(packed->file.left_out()[i].what) == "primitives their alpha masks hide") return true;
  for (const std::string& line : tests::compare_scenes(source, packed->file, *back)) FAIL_CHECK(line);
  return true;
}

/// Checks all sources. At least `share` of them must be converted.
void round_trip_all(const std::vector<fs::path>& sources, double share) {
  const tests::TempFolder folder, exports;
  size_t converted = 0;
  for (size_t i = 0; i < sources.size(); ++i) {
    // The number distinguishes exports of models with the same name. A .gltf has its own folder for its images.
    const std::string name = std::to_string(i) + "-" + sources[i].stem().string();
    fs::create_directories(exports.path() / name);
    const std::string exported = exports.file(name + "/" + sources[i].stem().string() + (i % 2 ? ".gltf" : ".glb"));
    converted += round_trip(sources[i], i, exported, folder);
  }
  CHECK(static_cast<double>(converted) >= share * static_cast<double>(sources.size()));
  const tests::ValidatorRun run = tests::run_validator(exports.path());
  if (!tests::validator_result_is_there(run)) return;
  INFO(run.output);
  CHECK(run.exit_code == 0);
  CHECK(run.output.find(std::to_string(converted) + " passed, 0 failed") != std::string::npos);
}

/// A triangle at node 0. `lights`: of KHR_lights_punctual; `nodes`: further nodes, each after a comma.
std::string lit_document(const std::string& lights, const std::string& nodes) {
  std::string roots = "0";
  for (size_t at = nodes.find("\"light\""), i = 1; at != std::string::npos; at = nodes.find("\"light\"", at + 1))
    roots += "," + std::to_string(i++);
  return R"({"asset": {"version": "2.0"}, "extensionsUsed": ["KHR_lights_punctual", "EXT_mesh_gpu_instancing"],
    "extensions": {"KHR_lights_punctual": {"lights": [)" +
         lights + R"(]}}, "scenes": [{"nodes": [)" + roots + R"(]}], "scene": 0, "nodes": [{"mesh": 0})" + nodes + R"(],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}], "accessors": [{"bufferView": 0,
    "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]}],
    "bufferViews": [{"buffer": 0, "byteLength": 36}], "buffers": [{"byteLength": 36,
    "uri": "data:;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA"}]})";
}

fs::path small_model() {
  return tests::data_path("textured_cube.glb");
}

}  // namespace

TEST_CASE("export: the models of tests/data are exported unchanged", "[export][roundtrip]") {
  const auto sources = tests::model_files(tests::kDataFolder);
  REQUIRE(sources.size() >= 2);
  round_trip_all(sources, 0.5);
}

TEST_CASE("export: real models are exported unchanged and the validator accepts them", "[export][roundtrip][models]") {
  const std::filesystem::path folder = scree::tests::real_models("scenes");
  if (folder.empty()) return;
  std::vector<fs::path> models = tests::model_files(folder);
  uint64_t number = 0;
  if (tests::kIsSanitized)  // every tenth, because each takes several times as long
    std::erase_if(models, [&](const fs::path&) { return number++ % 10 != 0; });
  // The remaining models are invalid.
  round_trip_all(models, 0.85);
}

TEST_CASE("export: a textured material on a primitive without texture coordinates becomes valid", "[export]") {
  // The source is invalid but common. Its export must be valid.
  const tests::TempFolder folder, exports;
  const float positions[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
  const float uvs[6] = {0, 0, 1, 0, 0, 1};
  std::string bin(reinterpret_cast<const char*>(positions), sizeof positions);
  bin.append(reinterpret_cast<const char*>(uvs), sizeof uvs);
  folder.write("a.bin", bin);
  fs::copy_file(tests::data_path("checker.png"), folder.path() / "checker.png");
  folder.write("a.gltf", R"({"asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "scene": 0,
    "nodes": [{"mesh": 0}], "images": [{"uri": "checker.png"}], "textures": [{"source": 0}],
    "materials": [{"name": "m", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "baseColorFactor": [1.0000001, 0.5, 0, 1]}}],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": 0},
                               {"attributes": {"POSITION": 0}, "material": 0},
                               {"attributes": {"POSITION": 0}, "material": 0}]}],
    "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]},
                  {"bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC2"}],
    "bufferViews": [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 24}],
    "buffers": [{"uri": "a.bin", "byteLength": 60}]})");
  CHECK(round_trip(folder.path() / "a.gltf", 0, exports.file("a.glb"), folder));
  const auto back = must(convert::import_gltf(exports.file("a.glb"), {}));
  REQUIRE(back.materials.size() == 2);  // one copy serves both primitives
  CHECK(back.materials[0].record.texture != format::kNone);
  CHECK(back.materials[1].record.texture == format::kNone);
  CHECK(back.materials[1].record.base_color[0] == 1.0f);
  CHECK(back.materials[1].record.base_color[1] == 0.5f);
  const tests::ValidatorRun run = tests::run_validator(exports.path());
  if (!tests::validator_result_is_there(run)) return;
  INFO(run.output);
  CHECK(run.exit_code == 0);
}

TEST_CASE("export: lights are exported unchanged", "[export]") {
  const tests::TempFolder folder, exports;
  const std::string source = folder.write(
      "a.gltf",
      lit_document(
          R"({"type": "directional", "name": "sun", "color": [1, 0.95, 0.1], "intensity": 3.3}, {"type": "point",
             "range": 7.1, "intensity": 0}, {"type": "spot"}, {"type": "spot", "name": "wide", "color": [0, 0, 0],
             "spot": {"innerConeAngle": 0.3, "outerConeAngle": 1.5707963267948966}})",
          R"(,{"name": "two", "extensions": {"KHR_lights_punctual": {"light": 3}}},
             {"rotation": [0.6, 0, 0, 0.8], "extensions": {"KHR_lights_punctual": {"light": 0}}},
             {"mesh": 0, "extensions": {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 0}},
                                        "KHR_lights_punctual": {"light": 1}}},
             {"extensions": {"KHR_lights_punctual": {"light": 3}}},
             {"matrix": [2,0,0,0, 0,2,0,0, 0,0,2,0, 5,6,7,1], "extensions": {"KHR_lights_punctual": {"light": 2}}})"));
  CHECK(round_trip(source, 0, exports.file("a.glb"), folder));
  const auto back = must(convert::import_gltf(exports.file("a.glb"), {}));
  REQUIRE(back.lights.size() == 5);  // one per node
  CHECK(back.lights[1].name == "sun");
  CHECK(back.lights[1].record.node == 2);
  CHECK(back.lights[1].record.color[1] == 0.95f);
  CHECK(back.lights[2].record.kind == format::LightKind::kPoint);
  CHECK(back.lights[2].record.range == 7.1f);
  CHECK(back.lights[3].record.outer_cone == static_cast<float>(std::numbers::pi / 2));
  CHECK(back.lights[4].record.kind == format::LightKind::kSpot);
  CHECK(back.lights[4].record.outer_cone == static_cast<float>(std::numbers::pi / 4));
  const tests::ValidatorRun run = tests::run_validator(exports.path());
  if (!tests::validator_result_is_there(run)) return;
  INFO(run.output);
  CHECK(run.exit_code == 0);
}

TEST_CASE("export: lights that glTF cannot store as they are become equal ones", "[export]") {
  const tests::TempFolder folder, exports;
  const std::string source = folder.write(
      "a.gltf", lit_document(R"({"type": "point", "color": [4, 1, 0], "intensity": 3}, {"type": "directional"})",
                             R"(,{"extensions": {"KHR_lights_punctual": {"light": 0}}},
                                {"extensions": {"KHR_lights_punctual": {"light": 1}}})"));
  {
    const auto packed = must(tests::pack(source, folder.file("a.scree")));
    REQUIRE(packed.file.lights().size() == 2);
  }
  // Both lights at one node, which no conversion makes.
  const tests::Bytes both =
      tests::patched<format::LightRecord>(tests::read_bytes(folder.file("a.scree")), format::TableKind::kLights, 1,
                                          [](format::LightRecord& light) { light.node = 1; });
  REQUIRE(tools::export_gltf(must(format::Container::open(both)), exports.file("a.gltf"), {}));
  const auto back = must(convert::import_gltf(exports.file("a.gltf"), {}));
  REQUIRE(back.lights.size() == 2);
  CHECK(back.lights[0].record.node == 1);
  CHECK(back.lights[0].record.color[0] == 1);  // the most in a document
  CHECK(back.lights[0].record.color[1] == 0.25f);
  CHECK(back.lights[0].record.intensity == 12);
  CHECK(back.lights[1].record.kind == format::LightKind::kDirectional);
  CHECK(back.nodes.at(back.lights[1].record.node).parent == 1);
  const tests::ValidatorRun run = tests::run_validator(exports.path());
  if (!tests::validator_result_is_there(run)) return;
  INFO(run.output);
  CHECK(run.exit_code == 0);
}

TEST_CASE("export: the validator check can fail", "[export]") {
  const tests::TempFolder folder;
  const auto packed = must(tests::pack(small_model().string(), folder.file("a.scree")));
  const std::string path = folder.file("a.glb");
  REQUIRE(tools::export_gltf(packed.file, path, {}));
  std::string bytes = tests::read_whole(path);
  const size_t place = bytes.find("\"POSITION\"");
  REQUIRE(place != std::string::npos);
  std::memcpy(&bytes[place + 1], "POSITIOM", 8);  // no such attribute
  folder.write("a.glb", bytes);
  const tests::ValidatorRun run = tests::run_validator(folder.path());
  if (!tests::validator_result_is_there(run)) return;
  INFO(run.output);
  CHECK(run.exit_code == 1);
}

TEST_CASE("export: the bytes do not depend on the number of threads", "[export]") {
  const tests::TempFolder folder;
  convert::ConvertOptions options;
  options.chunk_triangles = 3;
  const auto packed = must(tests::pack(small_model().string(), folder.file("a.scree"), options));
  REQUIRE(tools::export_gltf(packed.file, folder.file("one.glb"), with_threads(1)));
  REQUIRE(tools::export_gltf(packed.file, folder.file("many.glb"), with_threads(7)));
  const std::string one = tests::read_whole(folder.file("one.glb"));
  CHECK(!one.empty());
  CHECK(one == tests::read_whole(folder.file("many.glb")));
}

TEST_CASE("export: a mesh with more vertices than an index can address is cut between chunks", "[export]") {
  const tests::TempFolder folder;
  convert::ConvertOptions options;
  options.chunk_triangles = 2;
  const auto packed = must(tests::pack(small_model().string(), folder.file("a.scree"), options));
  const format::MeshRecord& mesh = packed.file.meshes()[0];
  REQUIRE(mesh.chunk_count >= 3);
  auto writer = must(tools::GltfWriter::create(folder.file("cut.glb")));
  const uint64_t limit = mesh.vertex_count / 2 + 1;
  const auto cut = must(tools::write_primitives(packed.file, writer, with_threads(2), limit));
  CHECK(cut.size() > packed.file.meshes().size());
  uint64_t triangles = 0, vertices = 0;
  for (const tools::ExportedPrimitive& primitive : cut) {
    CHECK(primitive.vertices <= limit);
    CHECK(primitive.primitive.indices != format::kNone);
    triangles += primitive.triangles;
    vertices += primitive.vertices;
  }
  uint64_t all_triangles = 0, all_vertices = 0;
  for (uint64_t i = 0; i < packed.file.meshes().size(); ++i) {
    all_triangles += packed.file.meshes()[i].triangle_count;
    all_vertices += packed.file.meshes()[i].vertex_count;
  }
  CHECK(triangles == all_triangles);
  CHECK(vertices == all_vertices);
}

TEST_CASE("export: progress is reported, the input's pages are released, and a stop leaves nothing behind",
          "[export]") {
  const tests::TempFolder folder;
  convert::ConvertOptions options;
  options.chunk_triangles = 2;
  const auto packed = must(tests::pack(small_model().string(), folder.file("a.scree"), options));
  std::vector<uint64_t> done;
  uint64_t released = 0;
  tools::ExportOptions watched = with_threads(1);
  uint64_t written = 0;
  watched.progress = [&](uint64_t triangles, uint64_t bytes) {
    done.push_back(triangles);
    CHECK(bytes > written);
    written = bytes;
  };
  watched.is_done_with = [&](uint64_t offset, uint64_t bytes) {
    CHECK(offset + bytes <= packed.map.size());
    ++released;
  };
  const auto summary = must(tools::export_gltf(packed.file, folder.file("a.glb"), watched));
  REQUIRE(!done.empty());
  CHECK(std::is_sorted(done.begin(), done.end()));
  CHECK(done.back() == summary.triangles);
  CHECK(released == done.size());
  CHECK(written < summary.bytes);

  const std::atomic<bool> stop{true};
  watched.stop = &stop;
  CHECK(refusal(tools::export_gltf(packed.file, folder.file("b.glb"), watched)).message.find("interrupted") !=
        std::string::npos);
  CHECK(folder.names().size() == 2);
}

TEST_CASE("export: a failed write is an error and leaves nothing behind", "[export]") {
  const tests::TempFolder folder;
  const std::string scree = folder.file("a.scree");
  {
    const auto packed = must(tests::pack(small_model().string(), scree));
    CHECK(refusal(tools::export_gltf(packed.file, folder.file("a.obj"), {})).code == ErrorCode::kUsage);
    CHECK(refusal(tools::export_gltf(packed.file, folder.file("missing/a.glb"), {})).code == ErrorCode::kFile);
  }
  fs::copy_file(scree, folder.file("bad.scree"));
  tests::damage(folder.file("bad.scree"), must(tests::open_packed(scree)).file.pages()[0].offset);
  const auto bad = must(tests::open_packed(folder.file("bad.scree")));
  for (const char* name : {"bad.glb", "bad.gltf"})
    check_refusal(tools::export_gltf(bad.file, folder.file(name), {}), ErrorCode::kChecksum, "page 0");
  CHECK(folder.names() == std::vector<std::string>{"a.scree", "bad.scree"});
}

}  // namespace scree
