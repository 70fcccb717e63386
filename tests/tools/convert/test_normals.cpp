// Normals are stored if they change the picture.
#include <cmath>
#include <map>

#include "tests/models.h"
#include "tests/tools/convert/convert_fixture.h"
#include "tests/tools/model_maker.h"
#include "tools/convert/windows/face_normals.h"
#include "tools/gltf/source.h"

using namespace scree;
using namespace scree::convert;
using namespace scree::tests;

namespace {

/// A wavy ground of n x n squares whose triangles share no corner. All normals are the faces', and each is then turned
/// towards x by `degrees(triangle)`.
template <class Degrees>
tools::GltfPrimitive ground(tests::ModelMaker& maker, uint32_t n, const Degrees& degrees, float offset = 0) {
  std::vector<float> points, normals;
  const auto point = [&](uint32_t x, uint32_t z, float out[3]) {
    out[0] = offset + static_cast<float>(x);
    out[1] = std::sin(0.7f * static_cast<float>(x)) + std::cos(0.9f * static_cast<float>(z));
    out[2] = static_cast<float>(z);
  };
  uint32_t triangle = 0;
  for (uint32_t z = 0; z < n; ++z) {
    for (uint32_t x = 0; x < n; ++x) {
      const uint32_t corners[2][3][2] = {{{x, z}, {x, z + 1}, {x + 1, z}}, {{x + 1, z}, {x, z + 1}, {x + 1, z + 1}}};
      for (const auto& corner : corners) {
        float p[3][3];
        for (int i = 0; i < 3; ++i) point(corner[i][0], corner[i][1], p[i]);
        double e[2][3], face[3];
        for (int i = 0; i < 2; ++i)
          for (int c = 0; c < 3; ++c) e[i][c] = double{p[i + 1][c]} - double{p[0][c]};
        for (int c = 0; c < 3; ++c)
          face[c] = e[0][(c + 1) % 3] * e[1][(c + 2) % 3] - e[0][(c + 2) % 3] * e[1][(c + 1) % 3];
        const double length = std::hypot(face[0], face[1], face[2]);
        for (double& f : face) f /= length;
        // The component of x perpendicular to the face normal.
        double side[3] = {1 - face[0] * face[0], -face[0] * face[1], -face[0] * face[2]};
        const double side_length = std::hypot(side[0], side[1], side[2]);
        const double angle = degrees(triangle) * 3.14159265358979323846 / 180;
        for (int i = 0; i < 3; ++i) {
          points.insert(points.end(), p[i], p[i] + 3);
          for (int c = 0; c < 3; ++c)
            normals.push_back(static_cast<float>(std::cos(angle) * face[c] + std::sin(angle) * side[c] / side_length));
        }
        ++triangle;
      }
    }
  }
  tools::GltfPrimitive out = maker.primitive(points, {});
  out.attributes.emplace_back("NORMAL", maker.floats(normals, tools::GltfType::kVec3));
  return out;
}

ConvertOptions auto_options(const TempFolder& folder) {
  ConvertOptions options = options_of(folder);
  options.normals = Normals::kAuto;
  options.source_ids = false;
  return options;
}

bool has_normals(const format::Container& file, uint64_t mesh) {
  return (file.meshes()[mesh].attributes & format::kHasNormal) != 0;
}

}  // namespace

TEST_CASE("normals: a mesh's normals are stored unless they equal its faces'", "[convert][normals]") {
  const TempFolder folder;
  tests::make_model(folder.file("in.glb"), [&](tests::ModelMaker& maker) {
    maker.draw("faces", {ground(maker, 6, [](uint32_t) { return 0.0; })});
    maker.draw("nearly", {ground(maker, 6, [](uint32_t) { return 0.09; })});
    maker.draw("not quite", {ground(maker, 6, [](uint32_t) { return 0.11; })});
    maker.draw("one", {ground(maker, 6, [](uint32_t triangle) { return triangle == 71 ? 5.0 : 0.0; })});
    maker.draw("inwards", {ground(maker, 6, [](uint32_t) { return 180.0; })});
    // From 2^21 on floats have steps of a quarter, so that face normals are inexact.
    const auto ten = [](uint32_t) { return 10.0; };
    maker.draw("far away", {ground(maker, 6, ten, 4e6f)});
    tools::GltfPrimitive unlit = ground(maker, 6, [](uint32_t) { return 30.0; });
    unlit.material = maker.writer().add_material({.unlit = true});
    maker.draw("unlit", {unlit});
  });
  ConvertOptions options = auto_options(folder);
  options.share = false;
  must_convert(options);
  const tests::PackedFile automatic = must_open(options.output);
  const std::vector<bool> expected{false, false, true, true, true, false, false};
  REQUIRE(automatic.file.meshes().size() == expected.size());
  for (size_t i = 0; i < expected.size(); ++i) {
    CAPTURE(i);
    CHECK(has_normals(automatic.file, i) == expected[i]);
  }
  std::map<std::string, uint64_t> out = left_out(automatic.file);
  CHECK(out["NORMAL (as of the faces)"] == 3);
  CHECK(out["NORMAL (of unlit materials)"] == 1);
  CHECK(out.count("NORMAL") == 0);

  options.normals = Normals::kAlways;
  must_convert(options);
  const tests::PackedFile always = must_open(options.output);
  for (size_t i = 0; i < expected.size(); ++i) CHECK(has_normals(always.file, i));
  options.normals = Normals::kNever;
  CHECK(must_convert(options).left_out.at(0).what == "NORMAL");
  const tests::PackedFile never = must_open(options.output);
  for (size_t i = 0; i < expected.size(); ++i) CHECK(!has_normals(never.file, i));
}

TEST_CASE("normals of 8-bit components equal the faces' within a degree", "[convert][normals]") {
  const TempFolder folder;
  for (const double degrees : {0.0, 0.9, 1.1}) {
    tests::make_model(folder.file("in.glb"), [&](tests::ModelMaker& maker) {
      maker.draw("", {ground(maker, 3, [&](uint32_t) { return degrees; })});
    });
    const auto scene = must(import_gltf(folder.file("in.glb"), {}));
    const Primitive& primitive = scene.primitives[0];
    Window window;
    REQUIRE(window.load(primitive, 0, primitive.triangle_count(), false, Window::Find::kTriangles));
    std::vector<float> normals;
    REQUIRE(read_vertices(*primitive.normal, window.vertices(), normals));
    Accessor bytes = *primitive.normal;
    bytes.type = ComponentType::kInt8;
    CHECK(are_face_normals(window, normals, *primitive.normal) == (degrees == 0));
    CHECK(are_face_normals(window, normals, bytes) == (degrees < 1));
    // Normals without a direction are ignored.
    normals[0] = normals[1] = normals[2] = 0;
    normals[3] = NAN;
    CHECK(are_face_normals(window, normals, bytes) == (degrees < 1));
  }
}

TEST_CASE("normals: the result does not depend on threads or on the place of the triangle that needs them",
          "[convert][normals]") {
  const TempFolder folder;
  constexpr uint32_t kSide = 400;  // 320,000 triangles: two windows
  for (const uint32_t odd : {0u, 2 * kSide * kSide - 1, UINT32_MAX}) {
    tests::make_model(folder.file("in.glb"), [&](tests::ModelMaker& maker) {
      maker.draw("", {ground(maker, kSide, [&](uint32_t triangle) { return triangle == odd ? 3.0 : 0.0; })});
    });
    std::string first;
    for (const uint32_t threads : {1u, 4u}) {
      for (const uint64_t memory : {uint64_t{2} << 30, uint64_t{96} << 20}) {
        ConvertOptions options = auto_options(folder);
        options.threads = threads;
        tests::must_convert_within(options, memory);
        CHECK(has_normals(must_open(options.output).file, 0) == (odd != UINT32_MAX));
        const std::string bytes = tests::read_whole(options.output);
        if (first.empty()) first = bytes;
        CHECK(bytes == first);
      }
    }
  }
}

TEST_CASE("normals: meshes that differ only in dropped normals are duplicates", "[convert][normals][duplicates]") {
  const TempFolder folder;
  const auto stored = [&](double a, double b) {
    tests::make_model(folder.file("in.glb"), [&](tests::ModelMaker& maker) {
      maker.draw("a", {ground(maker, 4, [&](uint32_t) { return a; })});
      maker.draw("b", {ground(maker, 4, [&](uint32_t) { return b; })});
    });
    const ConvertOptions options = auto_options(folder);
    must_convert(options);
    return must_open(options.output).file.meshes().size();
  };
  CHECK(stored(0, 0.05) == 1);
  CHECK(stored(5, 5) == 1);
  CHECK(stored(0, 5) == 2);
  CHECK(stored(5, 6) == 2);
}
