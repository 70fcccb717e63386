// Runs the fuzz targets over their committed corpus: the seeds, inputs that added coverage, and inputs that once broke
// something ("found-...").
#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

#include "format/container/container.h"
#include "runtime/draw/renderer.h"
#include "runtime/files/mapped_file.h"
#include "runtime/scene/camera.h"
#include "runtime/scene/scene.h"
#include "tests/catch.h"
#include "tests/format/container/container_fixture.h"
#include "tests/fuzz/targets.h"
#include "tests/paths.h"
#include "tests/runtime/load_scene.h"
#include "tools/gltf/source.h"
#include "tools/inspect/verify.h"

namespace scree::fuzz {
namespace {

/// Runs the target over the corpus of `folder` and over parts of it: both halves of every input, and an empty input.
void replay(const std::string& name, const std::string& folder) {
  const auto* const target = std::find_if(std::begin(kTargets), std::end(kTargets),
                                          [&](const Target& candidate) { return candidate.name == name; });
  REQUIRE(target != std::end(kTargets));
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator(std::filesystem::path(tests::kCorpusFolder) / folder))
    files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  REQUIRE(!files.empty());
  target->run({});
  for (const std::filesystem::path& file : files) {
    INFO(file.string());  // a broken promise ends the program
    const tests::Bytes bytes = tests::read_bytes(file.string());
    target->run(bytes);
    target->run(Bytes(bytes).first(bytes.size() / 2));
  }
  SUCCEED(files.size() << " inputs");
}

TEST_CASE("fuzz corpus: index_codec", "[fuzz]") {
  replay("index_codec", "index_codec");
}
TEST_CASE("fuzz corpus: position_codec", "[fuzz]") {
  replay("position_codec", "position_codec");
}
TEST_CASE("fuzz corpus: attribute_codec", "[fuzz]") {
  replay("attribute_codec", "attribute_codec");
}
TEST_CASE("fuzz corpus: cluster_codec", "[fuzz]") {
  replay("cluster_codec", "cluster_codec");
}
TEST_CASE("fuzz corpus: cluster_page", "[fuzz]") {
  replay("cluster_page", "cluster_page");
}
TEST_CASE("fuzz corpus: jpeg_index", "[fuzz]") {
  replay("jpeg_index", "jpeg_index");
}
TEST_CASE("fuzz corpus: jpeg_file", "[fuzz]") {
  replay("jpeg_file", "jpeg_file");
}
TEST_CASE("fuzz corpus: hdr", "[fuzz]") {
  replay("hdr", "hdr");
}

TEST_CASE("fuzz corpus: block_file", "[fuzz]") {
  replay("block_file", "block_file");
}
TEST_CASE("fuzz corpus: image", "[fuzz]") {
  replay("image", "image");
}
TEST_CASE("fuzz corpus: container", "[fuzz]") {
  replay("container", "container");
}
TEST_CASE("fuzz corpus: scene", "[fuzz]") {
  replay("scene", "container");
}
TEST_CASE("fuzz corpus: gltf", "[fuzz]") {
  replay("gltf", "gltf");
}
TEST_CASE("fuzz corpus: view_message", "[fuzz][view]") {
  replay("view_message", "view_message");
}
TEST_CASE("fuzz corpus: camera_path", "[fuzz][path]") {
  replay("camera_path", "camera_path");
}
TEST_CASE("fuzz corpus: shard", "[fuzz][shards]") {
  replay("shard", "shard");
}

/// The picture of a seed with the options of scripts/sanitize-gpu.
std::vector<uint8_t> picture_of(const std::filesystem::path& seed) {
  runtime::SceneOptions options;
  options.texture_cache = 65536;  // level 0 is decoded on demand
  const runtime::Scene scene = tests::must_load(seed.string(), options);
  const kernels::View view = tests::must_view(scene, {.width = 160, .height = 120});
  const auto frame = runtime::Frame::draw(scene, view, 1, 1);
  REQUIRE(frame);
  const auto picture = frame->shade({}, 1);
  REQUIRE(picture);
  return picture->pixels;
}

// Targets are silent about refused inputs, so this checks that these two inputs reach the code that they are for.
TEST_CASE("fuzz corpus: a damaged texture is drawn, and --verify finds it", "[fuzz]") {
  const std::filesystem::path folder = std::filesystem::path(tests::kCorpusFolder) / "container";
  CHECK(picture_of(folder / "magnified_damaged") != picture_of(folder / "magnified"));
  const auto map = runtime::MappedFile::open((folder / "magnified_damaged").string());
  REQUIRE(map);
  const auto container = format::Container::open(map->bytes());
  REQUIRE(container);
  CHECK(inspect::verify(*container, map->bytes(), 1).failure_count == 1);
}
TEST_CASE("fuzz corpus: the seed that meshopt compressed is unpacked", "[fuzz]") {
  const auto path = std::filesystem::path(tests::kCorpusFolder) / "gltf/meshopt.glb";
  const auto scene = convert::import_gltf(path.string(), {});
  REQUIRE(scene);
  REQUIRE(scene->primitives.size() == 2);
  std::vector<uint32_t> triangles(3 * 50), sequence(3 * 50);
  REQUIRE(convert::read_triangles(scene->primitives[0], 0, 50, triangles));
  REQUIRE(convert::read_triangles(scene->primitives[1], 0, 50, sequence));
  CHECK(std::is_permutation(triangles.begin(), triangles.end(), sequence.begin()));
}
TEST_CASE("fuzz corpus: the seed of version 1 of meshopt's vertex codec is unpacked", "[fuzz]") {
  const auto path = std::filesystem::path(tests::kCorpusFolder) / "gltf/meshopt_v1.glb";
  const auto scene = convert::import_gltf(path.string(), {});
  REQUIRE(scene);
  REQUIRE(scene->primitives.size() == 1);
  const convert::Primitive& primitive = scene->primitives[0];
  std::vector<float> positions(3 * 36), colors(4 * 36), normals(3 * 36);
  REQUIRE(convert::read_floats(primitive.positions, 0, 36, positions));
  REQUIRE(convert::read_floats(*primitive.color, 0, 36, colors));
  REQUIRE(convert::read_floats(*primitive.normal, 0, 36, normals));
  CHECK(positions[3 * 35] == 5);
  CHECK(colors[4 * 35] > 0.99f);
  CHECK(normals[3 * 35 + 2] == 1);
}

}  // namespace
}  // namespace scree::fuzz
