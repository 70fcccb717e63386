// Equal meshes, textures and materials are stored once, and different ones are never merged.
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "tests/models.h"
#include "tests/tools/compare/compare_scenes.h"
#include "tests/tools/convert/convert_fixture.h"
#include "tests/tools/model_maker.h"
#include "tools/compare/geometry.h"
#include "tools/compare/source_model.h"
#include "tools/export/export.h"

using namespace scree;
using namespace scree::convert;
using namespace scree::tests;

namespace {

const std::vector<float> kQuad{0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0};
const std::vector<uint32_t> kQuadCorners{0, 1, 2, 1, 3, 2};

/// The number of stored meshes of a model with two glTF meshes, each of which is drawn once. `make` fills the model.
uint64_t stored_meshes(const std::function<void(tests::ModelMaker&)>& make, bool normals = false) {
  const TempFolder folder;
  tests::ModelMaker maker(folder.file("in.glb"));
  make(maker);
  maker.finish();
  ConvertOptions options = options_of(folder);
  options.normals = normals ? convert::Normals::kAlways : convert::Normals::kNever;
  options.drop_nonfinite = true;
  must_match(options);
  const tests::PackedFile packed = must_open(options.output);
  REQUIRE(packed.file.instances().size() >= 2);
  return packed.file.meshes().size();
}

void two(tests::ModelMaker& maker, std::vector<tools::GltfPrimitive> a, std::vector<tools::GltfPrimitive> b) {
  maker.draw("a", std::move(a));
  maker.draw("b", std::move(b), {3, 0, 0});
}

}  // namespace

TEST_CASE("duplicates: equal meshes become instances of the first", "[duplicates]") {
  const TempFolder folder;
  const tests::GridSpec spec{.columns = 400, .rows = 350};  // 280,000 triangles: two windows
  tests::GridSpec other = spec;
  other.origin = {0, 1, 0};
  tests::make_model(folder.file("in.glb"), [&](tests::ModelMaker& maker) {
    maker.draw("first", {maker.grid(spec)});
    maker.draw("other", {maker.grid(other)}, {50, 0, 0});
    maker.draw("repeat", {maker.grid(spec)}, {100, 0, 0});
  });
  ConvertOptions options = options_of(folder);
  const ConvertReport report = must_match(options);
  CHECK(report.triangles == 2 * 280000);
  CHECK(report.triangles_drawn == 3 * 280000);
  const std::string bytes = tests::read_whole(options.output);
  for (const uint32_t threads : {1u, 3u}) {
    options.threads = threads;
    must_convert(options);
    CHECK(tests::read_whole(options.output) == bytes);
  }

  const tests::PackedFile packed = must_open(options.output);
  REQUIRE(packed.file.meshes().size() == 2);
  REQUIRE(packed.file.instances().size() == 3);
  REQUIRE(packed.file.groups().size() == 3);
  CHECK(packed.file.groups()[2].mesh_count == 0);
  CHECK(packed.file.nodes()[2].group == 0);
  const format::InstanceRecord repeat = packed.file.instances()[1];  // instances are ordered by mesh, then by node
  CHECK(repeat.mesh == 0);
  CHECK(repeat.node == 2);
  CHECK(packed.file.matrices()[repeat.matrix].rows[0][3] == 100);

  // The comparison reads the repeated mesh's own vertices, and the export has three nodes of two meshes.
  const SourceScene source = must(import_gltf(options.input, {}));
  const auto geometry = must(compare::compare_geometry(source, packed.file));
  CHECK(geometry.meshes == 2);
  CHECK(geometry.broken.empty());
  CHECK(geometry.missing_triangles + geometry.unknown_triangles == 0);
  REQUIRE(tools::export_gltf(packed.file, folder.file("back.glb"), {}));
  const SourceScene back = must(import_gltf(folder.file("back.glb"), {}));
  CHECK(back.groups.size() == 2);
  for (const std::string& line : tests::compare_scenes(source, packed.file, back)) FAIL_CHECK(line);
}

TEST_CASE("duplicates: compare finds meshes that were wrongly stored as equal", "[duplicates][compare]") {
  const TempFolder folder;
  const auto make = [&](const std::string& name, float last) {
    std::vector<float> points = kQuad;
    tests::ModelMaker maker(folder.file(name));
    const tools::GltfPrimitive first = maker.primitive(points, kQuadCorners);
    points.back() = last;
    two(maker, {first}, {maker.primitive(points, kQuadCorners)});
    maker.finish();
  };
  make("in.glb", 0);
  make("changed.glb", 1e-30f);
  must_match(options_of(folder));
  const tests::PackedFile packed = must_open(folder.file("out.scree"));
  REQUIRE(packed.file.meshes().size() == 1);
  const auto judge = [&](const std::string& name) {
    return compare::load_source_model(must(import_gltf(folder.file(name), {})), packed.file, 0);
  };
  CHECK(judge("in.glb"));
  check_refusal(judge("changed.glb"), ErrorCode::kFormat,
                "glTF mesh 1 of changed.glb is stored as a repeat of 0, but they differ");
}

TEST_CASE("duplicates: equality does not depend on the vertices' places in the source", "[duplicates]") {
  CHECK(stored_meshes([](tests::ModelMaker& maker) {
          std::vector<float> twice = kQuad;
          twice.insert(twice.end(), kQuad.begin(), kQuad.end());
          std::vector<uint32_t> later;
          for (const uint32_t corner : kQuadCorners) later.push_back(corner + 4);
          tools::GltfPrimitive a = maker.primitive(twice, kQuadCorners), b = a;
          b.indices = maker.indices(later);
          two(maker, {a}, {b});
        }) == 1);
}

TEST_CASE("duplicates: meshes that differ in stored data stay apart", "[duplicates]") {
  const auto quad = [](tests::ModelMaker& maker) { return maker.primitive(kQuad, kQuadCorners); };
  SECTION("a coordinate, by one bit") {
    CHECK(stored_meshes([&](tests::ModelMaker& maker) {
            std::vector<float> points = kQuad;
            points[9] = std::nextafter(points[9], 2.0f);
            two(maker, {quad(maker)}, {maker.primitive(points, kQuadCorners)});
          }) == 2);
  }
  SECTION("the order of triangles") {
    CHECK(stored_meshes([&](tests::ModelMaker& maker) {
            two(maker, {quad(maker)}, {maker.primitive(kQuad, {1, 3, 2, 0, 1, 2})});
          }) == 2);
  }
  SECTION("the numbers of the left-out triangles") {
    // Both keep the same two triangles, but with different numbers.
    CHECK(stored_meshes([&](tests::ModelMaker& maker) {
            std::vector<float> points = kQuad;
            points.insert(points.end(), {std::numeric_limits<float>::infinity(), 0, 0});
            two(maker, {maker.primitive(points, {0, 1, 2, 1, 3, 2, 0, 1, 4})},
                {maker.primitive(points, {0, 1, 2, 0, 1, 4, 1, 3, 2})});
          }) == 2);
  }
  SECTION("as many kept triangles, but more triangles in the source") {
    CHECK(stored_meshes([&](tests::ModelMaker& maker) {
            std::vector<float> points = kQuad;
            points.insert(points.end(), {std::numeric_limits<float>::infinity(), 0, 0});
            two(maker, {maker.primitive({0, 0, 0, 1, 0, 0, 0, 2, 0, 1, 1, 0}, kQuadCorners)},
                {maker.primitive(points, {0, 1, 2, 1, 3, 2, 0, 1, 4})});
          }) == 2);
  }
  SECTION("colours") {
    const auto colored = [&](tests::ModelMaker& maker, float last) {
      tools::GltfPrimitive out = quad(maker);
      out.attributes.emplace_back("COLOR_0",
                                  maker.floats({1, 0, 0, 1, 0, 0, 1, 0, 0, 1, 0, last}, tools::GltfType::kVec3));
      return out;
    };
    CHECK(stored_meshes([&](tests::ModelMaker& maker) { two(maker, {colored(maker, 0)}, {colored(maker, 1)}); }) == 2);
    CHECK(stored_meshes([&](tests::ModelMaker& maker) { two(maker, {colored(maker, 1)}, {colored(maker, 1)}); }) == 1);
    CHECK(stored_meshes([&](tests::ModelMaker& maker) { two(maker, {colored(maker, 1)}, {quad(maker)}); }) == 2);
  }
  SECTION("normals, where they are stored") {
    const auto lit = [&](tests::ModelMaker& maker, float last) {
      tools::GltfPrimitive out = quad(maker);
      out.attributes.emplace_back("NORMAL",
                                  maker.floats({0, 0, 1, 0, 0, 1, 0, 0, 1, 0, last, 1}, tools::GltfType::kVec3));
      return out;
    };
    const auto make = [&](tests::ModelMaker& maker) { two(maker, {lit(maker, 0)}, {lit(maker, 1)}); };
    CHECK(stored_meshes(make, false) == 1);
    CHECK(stored_meshes(make, true) == 2);
  }
  SECTION("materials") {
    const auto make = [&](double red, const char* name) {
      return stored_meshes([&](tests::ModelMaker& maker) {
        tools::GltfMaterial material{.name = "paint"};
        tools::GltfPrimitive a = quad(maker), b = a;
        a.material = maker.writer().add_material(material);
        material.name = name;
        material.base_color[0] = red;
        b.material = maker.writer().add_material(material);
        two(maker, {a}, {b});
      });
    };
    CHECK(make(1, "paint") == 1);
    CHECK(make(0.5, "paint") == 2);
    CHECK(make(1, "another name") == 2);
  }
  SECTION("the number of primitives") {
    CHECK(stored_meshes([&](tests::ModelMaker& maker) { two(maker, {quad(maker)}, {quad(maker), quad(maker)}); }) == 3);
    CHECK(stored_meshes([&](tests::ModelMaker& maker) {
            two(maker, {quad(maker), quad(maker)}, {quad(maker), quad(maker)});
          }) == 2);
  }
}

TEST_CASE("duplicates: equal images are stored as one texture, one material and one mesh", "[duplicates]") {
  const TempFolder folder;
  const auto checker = tests::read_bytes(tests::data_path("checker.png"));
  const auto make = [&](bool is_same_wrap) {
    tests::ModelMaker maker(folder.file("in.glb"));
    const auto textured = [&](format::Wrap wrap) {
      tools::GltfTexture texture = maker.texture("", format::ImageCodec::kPng, checker);
      texture.wrap_s = wrap;
      const tools::GltfMaterial material{.texture = maker.writer().add_texture(texture)};
      tools::GltfPrimitive out = maker.primitive(kQuad, kQuadCorners);
      out.attributes.emplace_back("TEXCOORD_0", maker.floats({0, 0, 1, 0, 0, 1, 1, 1}, tools::GltfType::kVec2));
      out.material = maker.writer().add_material(material);
      return out;
    };
    two(maker, {textured(format::Wrap::kRepeat)},
        {textured(is_same_wrap ? format::Wrap::kRepeat : format::Wrap::kClamp)});
    maker.finish();
    must_match(options_of(folder));
    return must_open(folder.file("out.scree"));
  };
  const tests::PackedFile same = make(true);
  CHECK(same.file.images().size() == 1);
  CHECK(same.file.textures().size() == 1);
  CHECK(same.file.materials().size() == 1);
  CHECK(same.file.meshes().size() == 1);
  CHECK(same.file.instances().size() == 2);
  ConvertOptions apart = options_of(folder);
  apart.share = false;
  must_match(apart);
  const tests::PackedFile all = must_open(apart.output);
  CHECK(all.file.images().size() == 1);
  CHECK(all.file.textures().size() == 2);
  CHECK(all.file.materials().size() == 2);
  CHECK(all.file.meshes().size() == 2);
  const tests::PackedFile other = make(false);
  CHECK(other.file.images().size() == 1);
  CHECK(other.file.textures().size() == 2);
  CHECK(other.file.materials().size() == 2);
  CHECK(other.file.meshes().size() == 2);
}
