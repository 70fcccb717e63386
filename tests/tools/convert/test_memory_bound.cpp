// The memory that convert takes for the most demanding inputs. It is not built with sanitizers, which multiply memory.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <numeric>
#include <random>
#include <string>
#include <vector>

#include "tests/tools/flat_images.h"
#include "tests/tools/gltf/meshopt/meshopt_streams.h"
#include "tests/tools/run_program.h"

using namespace scree;
using tests::TempFolder;

namespace {

/// A glTF with one triangle per picture that shows it.
std::string textured_gltf(const std::vector<std::string>& images) {
  std::string primitives, materials, textures, list;
  for (size_t i = 0; i < images.size(); ++i) {
    const std::string number = std::to_string(i);
    const std::string comma = i == 0 ? "" : ",";
    primitives += comma + R"({"attributes":{"POSITION":0,"TEXCOORD_0":1},"material":)" + number + "}";
    materials += comma + R"({"pbrMetallicRoughness":{"baseColorTexture":{"index":)" + number + "}}}";
    textures += comma + R"({"source":)" + number + "}";
    list += comma + R"({"uri":")" + images[i] + "\"}";
  }
  return R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],"meshes":[{"primitives":[)" +
         primitives + R"(]}],"materials":[)" + materials + R"(],"textures":[)" + textures + R"(],"images":[)" + list +
         R"(],"buffers":[{"byteLength":60,"uri":"points.bin"}],
"bufferViews":[{"buffer":0,"byteLength":36},{"buffer":0,"byteOffset":36,"byteLength":24}],
"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]},
{"bufferView":1,"componentType":5126,"count":3,"type":"VEC2"}]})";
}

std::string float_bytes(const std::vector<float>& values) {
  return {reinterpret_cast<const char*>(values.data()), 4 * values.size()};
}

/// Random triangles, all different, in one accessor, which needs the most memory. `input`: a .gltf; its .bin is written
/// beside it, 36 bytes per triangle.
void write_triangles(const TempFolder& folder, uint64_t triangles) {
  std::ofstream out(folder.file("soup.bin"), std::ios::binary);
  std::vector<float> block;
  uint64_t state = 1;
  for (uint64_t i = 0; i < 9 * triangles; ++i) {
    state = state * 6364136223846793005u + 1442695040888963407u;
    block.push_back(static_cast<float>(state >> 40) / 16777216.0f);
    if (block.size() < 9 * 4096 && i + 1 < 9 * triangles) continue;
    const std::string bytes = float_bytes(block);
    out.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    block.clear();
  }
  REQUIRE(out.good());
  const std::string bytes = std::to_string(36 * triangles);
  folder.write("soup.gltf",
               R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],"buffers":[{"uri":"soup.bin","byteLength":)" +
                   bytes + R"(}],"bufferViews":[{"buffer":0,"byteLength":)" + bytes +
                   R"(}],"accessors":[{"bufferView":0,"componentType":5126,"count":)" + std::to_string(3 * triangles) +
                   R"(,"type":"VEC3","min":[0,0,0],"max":[1,1,1]}]})");
}

/// A wavy sheet of 2^18 vertices in random order, and eight small overlapping triangles per vertex, also in random
/// order. All of it is sorted, and a sorting thread needs its maximum of memory. The .bin is written beside it.
void write_scattered_sheet(const TempFolder& folder) {
  constexpr uint32_t kSide = 512;
  std::mt19937 random(7);
  std::vector<uint32_t> number(kSide * kSide), squares(8 * number.size());
  std::iota(number.begin(), number.end(), 0u);
  std::shuffle(number.begin(), number.end(), random);
  std::vector<float> points(3 * number.size());
  for (uint32_t i = 0; i < number.size(); ++i) {
    const float x = static_cast<float>(i % kSide), z = static_cast<float>(i / kSide);
    const float place[3] = {x, 9 * std::sin(0.02f * x) * std::cos(0.03f * z), z};
    std::copy_n(place, 3, &points[3 * size_t{number[i]}]);
  }
  std::iota(squares.begin(), squares.end(), 0u);
  std::shuffle(squares.begin(), squares.end(), random);
  std::vector<uint32_t> corners;
  for (const uint32_t i : squares) {
    // Three of the four corners of a square with sides of one or two steps, clipped at the border.
    const uint32_t step = 1 + i / 4 % 2, x = i / 8 % kSide, z = i / 8 / kSide;
    const uint32_t to_x = std::min(x + step, kSide - 1), to_z = std::min(z + step, kSide - 1);
    const uint32_t square[4] = {z * kSide + x, to_z * kSide + x, to_z * kSide + to_x, z * kSide + to_x};
    for (uint32_t k = 0; k < 3; ++k) corners.push_back(number[square[(i + k) % 4]]);
  }
  const std::string point_bytes = float_bytes(points);
  const std::string corner_bytes(reinterpret_cast<const char*>(corners.data()), 4 * corners.size());
  folder.write("sheet.bin", point_bytes + corner_bytes);
  const std::string first = std::to_string(point_bytes.size()), second = std::to_string(corner_bytes.size());
  folder.write("sheet.gltf", R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1}]}],"buffers":[{"uri":"sheet.bin","byteLength":)" +
                                 std::to_string(point_bytes.size() + corner_bytes.size()) +
                                 R"(}],"bufferViews":[{"buffer":0,"byteLength":)" + first +
                                 R"(},{"buffer":0,"byteOffset":)" + first + R"(,"byteLength":)" + second +
                                 R"(}],"accessors":[
{"bufferView":0,"componentType":5126,"count":262144,"type":"VEC3","min":[0,-9,0],"max":[511,9,511]},
{"bufferView":1,"componentType":5125,"count":6291456,"type":"SCALAR"}]})");
}

/// A compressed sheet of `side` x `side` squares. Its positions lie in elements of 252 bytes, the largest allowed size.
void write_packed_sheet(const TempFolder& folder, uint32_t side) {
  constexpr size_t kStride = 252;
  const std::vector<float> positions = tests::grid_positions(side);
  tests::Bytes elements(positions.size() / 3 * kStride);
  for (size_t i = 0; i < positions.size() / 3; ++i) std::memcpy(&elements[i * kStride], &positions[3 * i], 12);
  const tests::Packed packed = tests::pack_attributes(elements, kStride);
  const std::string bytes = R"({"buffer":1,"byteLength":)" + std::to_string(elements.size());
  const std::string text =
      tests::meshopt_document(folder, tests::pack_triangles(tests::grid_indices(side), positions.size() / 3), packed);
  folder.write("sheet.gltf", tests::replaced(text, bytes, bytes + R"(,"byteStride":252)"));
}

/// Checks that the run stays within the README's bound. `more`: bytes that the input may take beyond it.
void check_bound(const tests::ProgramRun& run, uint64_t threads, uint64_t json_bytes, uint64_t more = 0) {
  INFO(run.output);
  REQUIRE(run.exit_code == 0);
  const uint64_t peak = tests::stated_peak(run.output);
  CHECK(peak > 1 << 20);
  CHECK(peak <= tests::convert_memory_bound(threads, json_bytes) + more);
}

/// Converts with up to 8 threads in a process whose data are limited to `data` bytes. That is more than the memory that
/// it uses, because stacks and vectors are not full. --memory `memory` must be kept, and must not change the bytes. A
/// larger value must fail, which shows that the limit is effective. Both are in bytes. Returns the program's output.
std::string check_kept_within(const TempFolder& folder, const std::string& input, uint64_t memory, uint64_t data) {
  const auto convert = [&](uint64_t limit, const std::string& output) {
    const std::string command = "cd '" + folder.path().string() + "' && ulimit -d " + std::to_string(data >> 10) +
                                " && '" + tests::kProgram + "' convert " + input + " -o " + output +
                                " --source-ids --stats --threads 8 --memory " + std::to_string(limit >> 20) +
                                "MiB >log 2>&1";
    const int status = std::system(command.c_str());
    REQUIRE(WIFEXITED(status));
    return WEXITSTATUS(status);
  };
  CHECK(convert(uint64_t{2} << 30, "broken.scree") == 2);
  const std::string refused = tests::read_whole(folder.file("log"));
  INFO(refused);
  CHECK(
      (refused.find("out of memory") != std::string::npos || refused.find("no memory to unpack") != std::string::npos));
  CHECK(convert(memory, "out.scree") == 0);
  const std::string said = tests::read_whole(folder.file("log"));
  INFO(said);
  CHECK(tests::stated_peak(said) > uint64_t{32} << 20);
  CHECK(tests::stated_peak(said) <= memory);
  CHECK(said.find("of 8 threads (--memory)") != std::string::npos);
  const tests::ProgramRun one =
      tests::must_run({"convert", folder.file(input), "-o", folder.file("one.scree"), "--source-ids", "--threads", "1"},
                      folder.file("log"));
  CHECK((tests::read_whole(folder.file("one.scree")) == tests::read_whole(folder.file("out.scree"))));
  return said;
}

/// Converts scene.gltf, whose document must be refused because of --memory, within a limit of the program's data.
/// Returns the stated need in MiB.
uint64_t refused_document(const TempFolder& folder, const std::string& memory, uint64_t data_mib) {
  const std::string command = "cd '" + folder.path().string() + "' && ulimit -d " + std::to_string(data_mib << 10) +
                              " && '" + tests::kProgram + "' convert scene.gltf --threads 1 --memory " + memory +
                              " >log 2>&1";
  const int status = std::system(command.c_str());
  REQUIRE(WIFEXITED(status));
  const std::string said = tests::read_whole(folder.file("log"));
  INFO(memory << ": " << said);
  CHECK(WEXITSTATUS(status) == 1);
  CHECK(std::count(said.begin(), said.end(), '\n') == 1);
  CHECK(said.starts_with("scree convert: scene.gltf: --memory: " + memory.substr(0, memory.size() - 3)));
  const size_t at = said.find(" of JSON needs ");
  REQUIRE(at != std::string::npos);
  CHECK(folder.names() == std::vector<std::string>{"log", "scene.gltf"});
  return std::stoull(said.substr(said.find_first_of("0123456789", at)));
}

}  // namespace

TEST_CASE("convert keeps within its memory with pictures of 16384 x 16384", "[convert][memory]") {
  const TempFolder folder;
  const uint32_t side = 16384;
  folder.write("a.jpg", tests::flat_jpeg(side, tests::JpegKind::kBaseline));
  folder.write("b.jpg", tests::flat_jpeg(side, tests::JpegKind::kProgressive));
  tests::write_flat_png(folder.file("a.png"), side, false);
  tests::write_flat_png(folder.file("b.png"), side, true);
  folder.write("points.bin", float_bytes({0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 1}));
  const std::string json = textured_gltf({"a.jpg", "b.jpg", "a.png", "b.png"});
  const std::string input = folder.write("scene.gltf", json);
  const auto convert = [&](const std::string& gltf, const std::string& textures) {
    return tests::run_program({"convert", gltf, "--force", "--threads", "1", "--textures", textures},
                              folder.file("log"));
  };
  check_bound(convert(input, "raw"), 1, json.size());
  const std::string sequential = textured_gltf({"a.jpg", "a.png", "b.png"});
  check_bound(convert(folder.write("sequential.gltf", sequential), "keep"), 1, sequential.size());
  // To make a progressive picture sequential, libjpeg holds its coefficients: three components of 2 bytes per pixel.
  check_bound(convert(input, "keep"), 1, json.size(), uint64_t{6} * side * side);
}

TEST_CASE("convert keeps within its memory with three million instances of a node", "[convert][memory]") {
  const TempFolder folder;
  constexpr uint64_t kCount = 3'000'000;
  constexpr uint64_t kBlock = 1000;
  std::string bytes = float_bytes({0, 0, 0, 1, 0, 0, 0, 1, 0});
  {
    std::ofstream out(folder.file("points.bin"), std::ios::binary);
    out.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    for (uint64_t first = 0; first < kCount; first += kBlock) {
      std::vector<float> block;
      for (uint64_t i = first; i < first + kBlock; ++i)
        block.insert(block.end(), {static_cast<float>(i % 2000), static_cast<float>(i / 2000), 0});
      bytes = float_bytes(block);
      out.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    }
    REQUIRE(out.good());
  }
  const std::string places = std::to_string(12 * kCount);
  const std::string json =
      R"({"asset":{"version":"2.0"},"extensionsUsed":["EXT_mesh_gpu_instancing"],"scene":0,"scenes":[{"nodes":[0]}],
"nodes":[{"mesh":0,"extensions":{"EXT_mesh_gpu_instancing":{"attributes":{"TRANSLATION":1}}}}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],"buffers":[{"uri":"points.bin","byteLength":)" +
      std::to_string(36 + 12 * kCount) + R"(}],"bufferViews":[{"buffer":0,"byteLength":36},{"buffer":0,"byteOffset":36,
"byteLength":)" +
      places + R"(}],"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],
"max":[1,1,0]},{"bufferView":1,"componentType":5126,"count":)" +
      std::to_string(kCount) + R"(,"type":"VEC3"}]})";
  const std::string input = folder.write("scene.gltf", json);
  const tests::ProgramRun run = tests::run_program({"convert", input, "--threads", "1"}, folder.file("log"));
  check_bound(run, 1, json.size());
}

TEST_CASE("convert refuses a document that exceeds --memory while reading it", "[convert][memory]") {
  const TempFolder folder;
  {
    std::ofstream out(folder.file("scene.gltf"), std::ios::binary);
    out << R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"name":"root"})";
    for (uint32_t i = 0; i < 700'000; ++i)
      out << R"(,{"name":"node )" << i << R"(","translation":[1.5,2.25,)" << i % 1000 << R"(.5],"scale":[1,2,3]})";
    out << "]}";
    REQUIRE(out.good());
  }
  const uint64_t bytes = std::filesystem::file_size(folder.file("scene.gltf"));
  REQUIRE(bytes > uint64_t{45} << 20);
  // The text alone exceeds this memory, and so does its parsed form. The data limit has room neither for all of it nor
  // for half more than the allowed memory.
  CHECK(refused_document(folder, "32.0MiB", 64) >= bytes >> 20);
  const uint64_t needed = refused_document(folder, "96.0MiB", 240);
  CHECK(needed > 200);
  // The reported memory must equal the used memory.
  const tests::ProgramRun whole =
      tests::must_run({"convert", folder.file("scene.gltf"), "--threads", "1"}, folder.file("log"));
  const uint64_t peak = tests::stated_peak(whole.output) >> 20;
  CAPTURE(needed, peak);
  CHECK(needed <= peak + peak / 4);
  CHECK(needed >= peak - peak / 4);
}

TEST_CASE("convert checks --memory while it reads buffers, lights and data: URIs", "[convert][memory]") {
  const TempFolder folder;
  const auto list = [](const std::string& element, uint32_t count) {
    std::string elements = element;
    for (uint32_t i = 1; i < count; ++i) elements += "," + element;
    return elements;
  };
  const auto refused = [&](const std::string& members) {
    folder.write("scene.gltf", R"({"asset":{"version":"2.0"},)" + members + "}");
    return refused_document(folder, "140MiB", 400);
  };
  // Records of 64 and 120 bytes, whose vectors double while they grow.
  CHECK(refused(R"("buffers":[)" + list(R"({"byteLength":1})", 2'500'000) + "]") > 160);
  CHECK(refused(R"("extensions":{"KHR_lights_punctual":{"lights":[)" + list(R"({"type":"point"})", 1'300'000) + "]}}") >
        150);
  // Parsing copies the digits several times.
  CHECK(refused(R"("buffers":[{"byteLength":1,"uri":"data:;base64,)" + std::string(32 << 20, 'A') + R"("}])") > 140);
}

TEST_CASE("convert keeps within --memory with any number of threads", "[convert][memory]") {
  const TempFolder folder;
  write_triangles(folder, 10 * 262144);
  check_kept_within(folder, "soup.gltf", uint64_t{280} << 20, uint64_t{350} << 20);
}

TEST_CASE("convert keeps within --memory while it sorts", "[convert][memory][sort]") {
  const TempFolder folder;
  write_scattered_sheet(folder);
  // 140 MiB of data suffice. Sorting with all 8 threads would take 180, everything else with all threads 240.
  const std::string said = check_kept_within(folder, "sheet.gltf", uint64_t{112} << 20, uint64_t{160} << 20);
  CHECK(said.find("sorted 2.10 M triangles without locality") != std::string::npos);
}

TEST_CASE("convert keeps within a --memory below the size of a compressed view", "[convert][memory][meshopt]") {
  const TempFolder folder;
  write_packed_sheet(folder, 1500);  // 568 MB of vertices
  check_kept_within(folder, "sheet.gltf", uint64_t{320} << 20, uint64_t{368} << 20);
}
