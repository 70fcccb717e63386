#include "tests/faults/fault_inputs.h"

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <numeric>
#include <random>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "tests/format/jpeg/jpeg_maker.h"
#include "tests/models.h"
#include "tests/runtime/images/block_files.h"
#include "tests/tools/model_maker.h"
#include "tools/convert/windows/window.h"
#include "tools/gltf/document/document.h"

namespace scree::tests {
namespace {

/// The smallest primitive that is sorted: a strip of two windows, each of which uses all of its few vertices, with
/// triangles between them that only join parts.
void write_scattered(const TempFolder& folder) {
  constexpr uint32_t kVertices = 64, kWindow = convert::kWindowTriangles, kCorners = kWindow + kVertices;
  std::vector<float> points, normals;
  for (uint32_t i = 0; i < kVertices; ++i) {
    const float along = 0.1f * static_cast<float>(i / 2);
    points.insert(points.end(), {along, 0.2f * along * along, static_cast<float>(i % 2)});
    normals.insert(normals.end(), {0, 1, 0});
  }
  std::vector<uint32_t> corners(kCorners);
  for (uint32_t i = 0; i < kVertices; ++i) corners[i] = corners[kWindow + i] = i;
  std::string bytes;
  const auto add = [&](const auto& values) {
    bytes.append(reinterpret_cast<const char*>(values.data()), 4 * values.size());
  };
  add(points);
  add(normals);
  add(corners);
  folder.write("scattered.bin", bytes);
  const std::string index_bytes = std::to_string(4 * kCorners);
  folder.write("scattered.gltf", R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],
"meshes":[{"primitives":[{"mode":5,"attributes":{"POSITION":0,"NORMAL":1},"indices":2}]}],
"buffers":[{"uri":"scattered.bin","byteLength":)" +
                                     std::to_string(bytes.size()) + R"(}],
"bufferViews":[{"buffer":0,"byteLength":768},{"buffer":0,"byteOffset":768,"byteLength":768},
{"buffer":0,"byteOffset":1536,"byteLength":)" +
                                     index_bytes + R"(}],
"accessors":[{"bufferView":0,"componentType":5126,"count":64,"type":"VEC3","min":[0,0,0],"max":[3.1,2,1]},
{"bufferView":1,"componentType":5126,"count":64,"type":"VEC3"},
{"bufferView":2,"componentType":5125,"type":"SCALAR","count":)" +
                                     std::to_string(kCorners) + "}]}");
}

/// Random triangles over random vertices, which take more than one block of a bucket.
void write_shuffled(const TempFolder& folder) {
  constexpr uint32_t kVertices = 3000, kTriangles = 5000;
  std::mt19937 random(7);
  std::vector<float> points(3 * kVertices);
  for (float& value : points) value = static_cast<float>(random() % 10000) * 0.01f;
  std::vector<uint32_t> corners(3 * kTriangles);
  for (uint32_t& corner : corners) corner = static_cast<uint32_t>(random() % kVertices);
  make_model(folder.file("shuffled.gltf"), points, corners);
}

/// giant.gltf and lying.gltf: a primitive of so many windows that one thread has written a page of it before the last,
/// short window is measured. The first file states the correct box of its positions. The second states a larger one,
/// and only the last window shows that it is wrong. The few used vertices come first; behind them are as many as the
/// box needs to be trusted.
void write_giant(const TempFolder& folder) {
  constexpr uint32_t kUsed = 2048;
  constexpr uint64_t kVertices = convert::kLeastBounded, kCorners = 3 * (4 * convert::kWindowTriangles + 1000);
  std::mt19937 random(7);
  std::vector<float> points(3 * kVertices);
  for (size_t i = 0; i < 3 * kUsed; ++i) points[i] = static_cast<float>(random() % 1001) * 0.001f;
  std::fill_n(points.begin(), 3, 0.0f);
  std::fill_n(points.begin() + 3, 3, 1.0f);
  std::vector<uint16_t> corners(kCorners);
  for (uint16_t& corner : corners) corner = static_cast<uint16_t>(random() % kUsed);
  std::iota(corners.begin(), corners.begin() + 3, uint16_t{0});
  std::string bytes(reinterpret_cast<const char*>(points.data()), 4 * points.size());
  bytes.append(reinterpret_cast<const char*>(corners.data()), 2 * corners.size());
  folder.write("giant.bin", bytes);
  const std::string vertices = std::to_string(kVertices), corner_count = std::to_string(kCorners);
  for (const auto& [name, largest] : {std::pair{"giant.gltf", "[1,1,1]"}, std::pair{"lying.gltf", "[2,1,1]"}})
    folder.write(name, R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1}]}],
"buffers":[{"uri":"giant.bin","byteLength":)" +
                           std::to_string(bytes.size()) + R"(}],
"bufferViews":[{"buffer":0,"byteLength":)" +
                           std::to_string(12 * kVertices) + R"(},{"buffer":0,"byteOffset":)" +
                           std::to_string(12 * kVertices) + R"(,"byteLength":)" + std::to_string(2 * kCorners) + R"(}],
"accessors":[{"bufferView":0,"componentType":5126,"count":)" +
                           vertices + R"(,"type":"VEC3","min":[0,0,0],"max":)" + largest +
                           R"(},{"bufferView":1,"componentType":5123,"type":"SCALAR","count":)" + corner_count + "}]}");
}

/// Two grids, each with a texture of which one level lies in a page of 25,600 bytes.
void write_blocks(const TempFolder& folder) {
  ModelMaker maker(folder.file("blocks.gltf"));
  for (uint32_t i = 0; i < 2; ++i) {
    const GridSpec spec{.uv = true};
    const FileBytes file = make_ktx2({.width = 160, .height = 160, .seed = i});
    const uint32_t blocks = maker.textured("blocks" + std::to_string(i), format::ImageCodec::kBlocks, file);
    maker.node("a", maker.mesh("grid", {maker.grid(spec, blocks)}), {1.1 * i, 0, 0});
  }
  maker.finish();
}

/// Grids around the origin, in front of and beside each other, so that some hide parts of others.
void write_many(const TempFolder& folder, uint32_t scale) {
  const JpegRecipe recipe{.width = 40, .height = 40, .factors = {{1, 1}, {1, 1}, {1, 1}}};
  ModelMaker maker(folder.file("many.gltf"));
  const uint32_t jpeg = maker.textured("many", format::ImageCodec::kJpeg, make_jpeg(recipe));
  for (uint32_t i = 0; i < 6; ++i) {
    GridSpec spec;
    spec.columns = spec.rows = (4 + i) * scale;
    spec.uv = spec.normal = i % 2 == 0;
    spec.flat = i == 3;
    const uint32_t mesh = maker.mesh("grid", {spec.uv ? maker.grid(spec, jpeg) : maker.grid(spec)});
    maker.node("a", mesh, {-1.0 + 0.3 * i, -0.5, -0.4 * i});
    if (i == 1) maker.node("b", mesh, {-0.5, -0.5, -3});
  }
  maker.finish();
}

}  // namespace

FaultInputs::FaultInputs() {
  const JpegRecipe recipe{.width = 70, .height = 70, .factors = {{2, 2}, {1, 1}, {1, 1}}, .quality = 30};
  tests::make_model(folder_.file("in.gltf"), [&](ModelMaker& maker) {
    const GridSpec spec{.uv = true, .color = true, .normal = true};
    const uint32_t jpeg = maker.textured("jpeg", format::ImageCodec::kJpeg, make_jpeg(recipe));
    maker.draw("a", {maker.grid(spec, jpeg), maker.grid(spec, maker.checker("png"))});
    maker.draw("b", {maker.grid(GridSpec{})}, {1.5, 0, 0});
  });
  write_scattered(folder_);
  write_shuffled(folder_);
  write_blocks(folder_);
  make("convert blocks.gltf -o blocks.scree --quiet --threads 1");
  make("convert in.gltf -o in.scree --source-ids --normals --quiet --threads 1");
  make("convert in.gltf -o packed.scree --encoding clustered --zstd 3 --quiet --threads 1");
  const std::string seen_from = " --size 24x16 --backend cpu --quiet --threads 1";
  make("render in.scree -o a.png --visbuffer a.vis" + seen_from);
  make("convert in.gltf -o coarse.scree --source-ids --normals --positions 8 --quiet --threads 1");
  make("render coarse.scree -o b.png --visbuffer b.vis" + seen_from);
}

void FaultInputs::add_many(uint32_t scale) {
  write_many(folder_, scale);
  const auto chunks_of = [&](uint32_t triangles) {
    return " --chunk-triangles " + std::to_string(triangles * scale * scale) + " --quiet --threads 1";
  };
  make("convert many.gltf -o many.scree" + chunks_of(20));
  make("convert many.gltf -o many_packed.scree --encoding clustered --zstd 1" + chunks_of(32));
}

void FaultInputs::add_shuffled() {
  make("convert shuffled.gltf -o shuffled.scree --quiet --threads 1");
  make("convert shuffled.gltf -o shuffled_packed.scree --zstd 3 --quiet --threads 1");
}

void FaultInputs::add_giant() {
  write_giant(folder_);
}

void FaultInputs::check(const std::string& kind, const std::string& which, const std::string& outputs,
                        const std::string& command, const std::string& options) {
  const std::string log =
      (std::filesystem::temp_directory_path() / (folder_.path().filename().string() + ".log")).string();
  // With a process per run, sites take many times as long.
  const std::string shared_process = which.starts_with("sites") ? "-p " : "";
  const std::string line = "\"" + std::string(tests::kFaultsProgram) + "\" " + shared_process + options + " " + kind +
                           " " + which + " \"" + folder_.path().string() + "\" \"" + outputs + "\" -- " + command +
                           " >\"" + log + "\" 2>&1";
  const int status = std::system(line.c_str());
  const std::string said = read_whole(log);
  std::filesystem::remove(log);
  INFO(command);
  if (status != 0) FAIL_CHECK(said);
  SUCCEED(said);
}

void FaultInputs::make(const std::string& command) {
  const std::string line = "cd \"" + folder_.path().string() + "\" && \"" + tests::kProgram + "\" " + command;
  REQUIRE(std::system(line.c_str()) == 0);
}

}  // namespace scree::tests
