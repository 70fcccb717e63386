#include <string>
#include <vector>

#include "tests/catch.h"
#include "tests/models.h"
#include "tools/convert/gltf_source.h"

namespace scree::convert {
namespace {

SourceScene import_data(const char* name) {
  auto scene = import_gltf(tests::data_path(name).string(), {});
  if (!scene) FAIL(scene.error().message);
  return std::move(scene).value();
}

TEST_CASE("a textured cube is imported from a .glb", "[import]") {
  const SourceScene scene = import_data("textured_cube.glb");
  REQUIRE(scene.groups.size() == 1);
  CHECK(scene.groups[0].name == "cube");
  REQUIRE(scene.primitives.size() == 1);
  const Primitive& cube = scene.primitives[0];
  CHECK(cube.vertex_count() == 24);
  CHECK(cube.triangle_count() == 12);
  REQUIRE(cube.uv);
  REQUIRE(cube.normal);
  CHECK_FALSE(cube.color);

  std::vector<uint32_t> triangles(36);
  REQUIRE(read_triangles(cube, 0, 12, triangles));
  CHECK(std::vector<uint32_t>(triangles.begin(), triangles.begin() + 6) == std::vector<uint32_t>{0, 1, 2, 0, 2, 3});
  std::vector<float> positions(72);
  REQUIRE(read_floats(cube.positions, 0, 24, positions));
  for (const float value : positions) CHECK(std::abs(value) == 1.0f);

  REQUIRE(scene.materials.size() == 1);
  REQUIRE(scene.textures.size() == 1);
  REQUIRE(scene.images.size() == 1);
  CHECK(scene.materials[0].name == "checker");
  CHECK(scene.materials[0].record.texture == 0);
  CHECK(scene.textures[0].record.wrap_t == format::Wrap::kMirror);
  CHECK(scene.textures[0].record.min_filter == 9987);
  CHECK(scene.images[0].codec == format::ImageCodec::kPng);
  REQUIRE(scene.scenes.size() == 1);
  CHECK(scene.scenes[0].is_default);
  CHECK(scene.scenes[0].roots == std::vector<uint32_t>{0});
}

TEST_CASE("two instances of a mesh are imported from a .gltf and its .bin", "[import]") {
  const SourceScene scene = import_data("two_instances.gltf");
  REQUIRE(scene.primitives.size() == 1);
  REQUIRE(scene.nodes.size() == 2);
  CHECK(scene.nodes[0].name == "left");
  CHECK(scene.nodes[0].group == 0);
  CHECK(scene.nodes[0].local[0] == -2.0);
  CHECK(scene.nodes[1].local[6] == Approx(std::sqrt(0.5)));
  CHECK(scene.nodes[1].local[8] == 2.0);
  CHECK(scene.primitives[0].material == format::kNone);
}

}  // namespace
}  // namespace scree::convert
