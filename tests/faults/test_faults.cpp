// Every command with every call failing once: files, memory, and the GPU (scree_faults does the work).
#include <string>
#include <vector>

#include "runtime/device_scene.h"
#include "tests/catch.h"
#include "tests/format/jpeg_maker.h"
#include "tests/models.h"
#include "tests/paths.h"
#include "tests/tools/model_maker.h"
#include "tests/tools/run_program.h"
#include "tests/tools/temp_folder.h"
#include "tools/convert/window.h"

namespace scree::tests {
namespace {

/// A primitive that is sorted, as small as one can be: a strip of two windows, both of which use all of its few
/// vertices, and between them triangles that only join.
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

/// A scene of a .gltf, its .bin and its images, and what the program made of it: the inputs of all commands.
class Inputs {
 public:
  Inputs() {
    JpegRecipe recipe;
    recipe.width = recipe.height = 70;
    recipe.factors = {{2, 2}, {1, 1}, {1, 1}};
    recipe.quality = 30;
    {
      ModelMaker maker(folder_.file("in.gltf"));
      GridSpec spec;
      spec.uv = spec.color = spec.normal = true;
      const uint32_t jpeg = maker.textured("jpeg", format::ImageCodec::kJpeg, make_jpeg(recipe));
      const std::string png = read_whole(data_path("checker.png").string());
      const uint32_t checker = maker.textured("png", format::ImageCodec::kPng, std::as_bytes(std::span(png)));
      maker.node("a", maker.mesh("a", {maker.grid(spec, jpeg), maker.grid(spec, checker)}));
      maker.node("b", maker.mesh("b", {maker.grid(GridSpec{})}), {1.5, 0, 0});
      maker.finish();
    }
    write_scattered(folder_);
    make("convert in.gltf -o in.scree --source-ids --normals --quiet --threads 1");
    make("convert in.gltf -o packed.scree --encoding clustered --zstd 3 --quiet --threads 1");
  }

  /// Runs scree_faults; fails the test with what it says where something is wrong.
  void check(const std::string& kind, const std::string& which, const std::string& outputs,
             const std::string& command) {
    const std::string log =
        (std::filesystem::temp_directory_path() / (folder_.path().filename().string() + ".log")).string();
    const std::string line = "\"" + std::string(tests::kFaultsProgram) + "\" " + kind + " " + which + " \"" +
                             folder_.path().string() + "\" \"" + outputs + "\" -- " + command + " >\"" + log +
                             "\" 2>&1";
    const int status = std::system(line.c_str());
    const std::string said = read_whole(log);
    std::filesystem::remove(log);
    INFO(command);
    if (status != 0) FAIL_CHECK(said);
    SUCCEED(said);
  }

 private:
  void make(const std::string& command) {
    const std::string line = "cd \"" + folder_.path().string() + "\" && \"" + tests::kProgram + "\" " + command;
    REQUIRE(std::system(line.c_str()) == 0);
  }

  TempFolder folder_;
};

struct Job {
  const char* outputs;
  const char* command;
};

// Pages stay raw where memory for compressing them is short (format::seal_page).
constexpr Job kConvert[] = {
    {"out.scree", "convert in.gltf -o out.scree --normals --quiet --threads 1"},
    {"~out.scree", "convert in.gltf -o out.scree --encoding clustered --zstd 3 --quiet --threads 2"},
};
// Of which only what comes once the file to sort through is made: unlink takes its name away.
constexpr Job kSort[] = {{"out.scree", "convert scattered.gltf -o out.scree --normals --quiet --threads 1"}};
constexpr Job kReaders[] = {
    {"", "inspect packed.scree --verify --threads 2"},
    {"", "inspect in.scree --json"},
    {"out.glb", "export in.scree -o out.glb --quiet --threads 1"},
    {"out.gltf+out.bin+out_jpeg.jpg+out_png.png", "export in.scree -o out.gltf --quiet --threads 2"},
    {"", "compare in.scree in.gltf --size 24x16 --threads 1"},
    {"out.png,out.pfm,out.bin",
     "render in.scree -o out.png --depth out.pfm --visbuffer out.bin --size 24x16 --ssao --pick 12,8 --backend cpu "
     "--quiet --threads 1"},
    {"out.png", "render packed.scree -o out.png --size 24x16 --samples 2 --backend cpu --quiet --threads 2"},
};
constexpr Job kDevice[] = {
    {"out.png,out.bin",
     "render in.scree -o out.png --visbuffer out.bin --size 640x480 --ssao --edl --pick 12,8 --backend cuda --quiet "
     "--threads 2"},
    {"out.png", "render packed.scree -o out.png --size 640x480 --samples 2 --backend cuda --quiet --threads 2"},
};

template <size_t kCount>
void check_all(const std::string& kind, const std::string& which, const Job (&jobs)[kCount]) {
  Inputs inputs;
  for (const Job& job : jobs) inputs.check(kind, which, job.outputs, job.command);
}

TEST_CASE("faults: every call for a file fails once while converting", "[faults]") {
  check_all("file", "all", kConvert);
}
TEST_CASE("faults: every call for a file fails once while sorting", "[faults]") {
  check_all("file", SCREE_FAULT_SORT_CALLS "@unlink", kSort);
}
TEST_CASE("faults: every place that takes memory fails once while sorting", "[faults]") {
  check_all("memory", SCREE_FAULT_SITES "@unlink", kSort);
}
TEST_CASE("faults: every call for a file fails once while reading", "[faults]") {
  check_all("file", "all", kReaders);
}
TEST_CASE("faults: every place that takes memory fails once while converting", "[faults]") {
  check_all("memory", SCREE_FAULT_SITES, kConvert);
}
TEST_CASE("faults: every place that takes memory fails once while reading", "[faults]") {
  check_all("memory", SCREE_FAULT_SITES, kReaders);
}
TEST_CASE("faults: every call fails once, also where that takes minutes", "[.][faults-all]") {
  check_all("file", "all", kSort);
  check_all("memory", "all", kConvert);
  check_all("memory", "all", kSort);
  check_all("memory", "all", kReaders);
}
TEST_CASE("faults: every CUDA call fails once", "[cuda][faults]") {
  if (const Result<void> device = runtime::find_device(); !device) {
    CHECK(device.error().code == ErrorCode::kDevice);
    WARN("skipped: " << device.error().message);
    return;
  }
  check_all("device", "all", kDevice);
}

}  // namespace
}  // namespace scree::tests
