// Runs the fuzz targets over their committed corpus: the seeds, inputs that added coverage, and inputs that once broke
// a target ("found-...").
#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

#include "format/container/container.h"
#include "runtime/files/mapped_file.h"
#include "runtime/scene/camera.h"
#include "runtime/scene/scene.h"
#include "tests/format/container/container_fixture.h"
#include "tests/fuzz/targets.h"
#include "tests/runtime/frame.h"
#include "tests/runtime/load_scene.h"
#include "tests/tools/gltf/read_all.h"
#include "tools/convert/passes/shard.h"
#include "tools/gltf/source.h"
#include "tools/inspect/verify.h"

namespace scree::fuzz {
namespace {

TEST_CASE("fuzz corpus: every target accepts every input, both halves of it, and no bytes", "[fuzz]") {
  for (const Target& target : kTargets) {
    const std::string folder = target.is_container ? "container" : target.name;
    std::vector<std::filesystem::path> files;
    for (const auto& entry : std::filesystem::directory_iterator(std::filesystem::path(tests::kCorpusFolder) / folder))
      files.push_back(entry.path());
    INFO(target.name);
    REQUIRE(!files.empty());
    std::sort(files.begin(), files.end());
    target.run({});
    for (const std::filesystem::path& file : files) {
      INFO(file.string());  // a broken promise ends the program
      const tests::Bytes bytes = tests::read_bytes(file.string());
      target.run(bytes);
      target.run(Bytes(bytes).first(bytes.size() / 2));
    }
  }
}

/// The picture of a seed with the options of scripts/sanitize-gpu.
std::vector<uint8_t> picture_of(const std::filesystem::path& seed) {
  runtime::SceneOptions options;
  options.texture_cache = 65536;  // level 0 is decoded on demand
  const runtime::Scene scene = tests::must_load(seed.string(), options);
  const kernels::View view = tests::must_view(scene, {.width = 160, .height = 120});
  const auto frame = must(tests::Frame::draw(scene, view, 1, 1));
  return must(frame.shade({}, 1));
}

// Targets are silent about refused inputs, so this test checks that the next inputs reach the code for which they were
// made.
TEST_CASE("fuzz corpus: a damaged texture is drawn, and --verify finds it", "[fuzz]") {
  const std::filesystem::path folder = std::filesystem::path(tests::kCorpusFolder) / "container";
  CHECK(picture_of(folder / "magnified_damaged") != picture_of(folder / "magnified"));
  const auto map = must(runtime::MappedFile::open((folder / "magnified_damaged").string()));
  CHECK(inspect::verify(must(format::Container::open(map.bytes())), map.bytes(), 1).failure_count == 1);
}
TEST_CASE("fuzz corpus: the seeds of a shard are unpacked", "[fuzz]") {
  const std::filesystem::path folder = std::filesystem::path(tests::kCorpusFolder) / "shard";
  CHECK_FALSE(must(convert::unpack_plan(tests::read_bytes((folder / "plan").string()))).measurement.windows.empty());
  CHECK_FALSE(must(convert::unpack_share(tests::read_bytes((folder / "share").string()))).windows.empty());
}
TEST_CASE("fuzz corpus: the seed that meshopt compressed is unpacked", "[fuzz]") {
  const auto path = std::filesystem::path(tests::kCorpusFolder) / "gltf/meshopt.glb";
  const auto scene = must(convert::import_gltf(path.string(), {}));
  REQUIRE(scene.primitives.size() == 2);
  const std::vector<uint32_t> triangles = tests::all_corners(scene.primitives[0]);
  const std::vector<uint32_t> sequence = tests::all_corners(scene.primitives[1]);
  REQUIRE(triangles.size() == 3 * 50);
  CHECK(std::is_permutation(triangles.begin(), triangles.end(), sequence.begin(), sequence.end()));
}
TEST_CASE("fuzz corpus: the seed of version 1 of meshopt's vertex codec is unpacked", "[fuzz]") {
  const auto path = std::filesystem::path(tests::kCorpusFolder) / "gltf/meshopt_v1.glb";
  const auto scene = must(convert::import_gltf(path.string(), {}));
  REQUIRE(scene.primitives.size() == 1);
  const convert::Primitive& primitive = scene.primitives[0];
  CHECK(tests::all_values(primitive.positions).at(3 * 35) == 5);
  CHECK(tests::all_values(*primitive.color).at(4 * 35) > 0.99f);
  CHECK(tests::all_values(*primitive.normal).at(3 * 35 + 2) == 1);
}

}  // namespace
}  // namespace scree::fuzz
