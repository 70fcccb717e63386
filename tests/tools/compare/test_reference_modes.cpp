// The reference rasteriser's roundings and colours. It uses none of the code that it judges.
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <random>
#include <regex>
#include <string>
#include <vector>

#include "kernels/raster/depth.h"
#include "runtime/scene/camera.h"
#include "tests/models.h"
#include "tests/runtime/frame.h"
#include "tests/runtime/load_scene.h"
#include "tests/tools/compare/reference_fixture.h"
#include "tests/tools/packed_file.h"
#include "tools/compare/against_source.h"
#include "tools/compare/reference_modes.h"
#include "tools/compare/reference_shade.h"

using namespace scree;
using namespace scree::tests;
using namespace compare;

namespace {

std::vector<ReferencePixel> draw(const std::vector<float>& points, const std::vector<uint32_t>& corners,
                                 const kernels::View& view, const ReferenceMode& mode) {
  const compare::ReferenceInstance instance = identity();
  return tests::draw_reference({points, corners, nullptr, false}, view, {&instance, 1}, mode);
}

/// A square of 8 pixels at z = 0, its lower left corner at (x, y).
std::vector<float> square(float x, float y) {
  return {x, y, 0, x + 8, y, 0, x + 8, y + 8, 0, x, y + 8, 0};
}

}  // namespace

TEST_CASE("snapping: corners move to the nearest step, and coverage is exact", "[reference]") {
  const kernels::View view = deep_view(32, 32);
  // The left and right edges lie 0.04 pixel left of centres. With a step of 1/8 pixel they go through the centres. The
  // left centres stay covered, because a left edge owns them, and the right ones stay uncovered.
  const std::vector<float> left = square(-3.54f, -4);
  CHECK(covered(draw(left, kSquareCorners, view, {})) == 64);
  CHECK(covered(draw(left, kSquareCorners, view, {.snap = 8, .depth_bits = 0})) == 64);
  // With the square 0.04 pixel to the right of them, the left column is lost and the right one is gained. 1/8 pixel
  // reverses both.
  const std::vector<float> right = square(-3.46f, -4);
  const auto exact = draw(right, kSquareCorners, view, {});
  const auto coarse = draw(right, kSquareCorners, view, {.snap = 8, .depth_bits = 0});
  const auto fine = draw(right, kSquareCorners, view, {.snap = 256, .depth_bits = 0});
  CHECK(exact[16 * 32 + 12].is_background());
  CHECK_FALSE(coarse[16 * 32 + 12].is_background());
  CHECK_FALSE(exact[16 * 32 + 20].is_background());
  CHECK(coarse[16 * 32 + 20].is_background());
  for (size_t i = 0; i < exact.size(); ++i) CHECK(fine[i].triangle == exact[i].triangle);
  CHECK(covered(coarse) == 64);
  CHECK(covered(fine) == 64);
}

TEST_CASE("snapping: a fine step draws the same as none, even across the near plane", "[reference]") {
  // A floor from behind the eye to far away, in a fan of strips whose borders lie on pixels.
  std::vector<float> points;
  std::vector<uint32_t> corners;
  constexpr uint32_t kStrips = 200;
  for (uint32_t i = 0; i <= kStrips; ++i) {
    const float x = (static_cast<float>(i) / kStrips - 0.5f) * 90 + 0.013f;
    points.insert(points.end(), {x, -5, 20, x, -5, -400});
  }
  for (uint32_t i = 0; i < kStrips; ++i)
    corners.insert(corners.end(), {2 * i, 2 * i + 2, 2 * i + 3, 2 * i, 2 * i + 3, 2 * i + 1});
  const kernels::View view = deep_view(64, 48);
  const auto exact = draw(points, corners, view, {});
  const auto fine = draw(points, corners, view, {.snap = 65536, .depth_bits = 0});
  REQUIRE(covered(exact) > 600);
  uint64_t differing = 0;
  for (size_t i = 0; i < exact.size(); ++i) {
    differing += exact[i].instance != fine[i].instance || exact[i].triangle != fine[i].triangle ? 1 : 0;
    if (!exact[i].is_background() && !fine[i].is_background())
      CHECK(std::abs(fine[i].depth / exact[i].depth - 1) < 1e-3);
  }
  CHECK(differing == 0);
  const auto coarse = draw(points, corners, view, {.snap = 4, .depth_bits = 0});
  CHECK(covered(coarse) > 600);  // no significant cracks, because strips share their corners
}

TEST_CASE("snapping: every pixel of a closed fan has one owner at any step", "[reference]") {
  constexpr uint32_t kSpokes = 500;
  std::vector<float> points{0.37f, -0.21f, 0};
  std::vector<uint32_t> corners;
  for (uint32_t i = 0; i < kSpokes; ++i) {
    const double angle = 2 * 3.14159265358979 * i / kSpokes;
    points.insert(points.end(),
                  {static_cast<float>(40 * std::cos(angle)), static_cast<float>(40 * std::sin(angle)), 0});
    corners.insert(corners.end(), {0, 1 + i, 1 + (i + 1) % kSpokes});
  }
  const kernels::View view = deep_view(24, 24);
  const ReferenceMesh mesh{points, corners, nullptr, false};
  for (const uint32_t snap : {2u, 16u, 256u, 4096u}) {
    for (uint32_t y = 0; y < 24; ++y) {
      for (uint32_t x = 0; x < 24; ++x) {
        uint32_t owners = 0;
        for (uint64_t t = 0; t < kSpokes; ++t)
          owners +=
              compare::meet_snapped(view, compare::seen_corners(view, mesh, identity(), t), x, y, snap, false, false)
                  ? 1
                  : 0;
        CHECK(owners == 1);
      }
    }
  }
}

TEST_CASE("depth codes of the reference equal spec/rasterization.md", "[reference]") {
  const kernels::View view = deep_view(8, 8);
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> octaves(0, 40);
  for (int i = 0; i < 20000; ++i) {
    const double depth = std::exp2(octaves(random));
    const uint32_t code = kernels::perspective_depth_code(static_cast<float>(view.z_near / depth));
    const double coded = compare::coded_depth(view, depth, 28);
    CHECK(coded == kernels::depth_of_code(view, code));
    CHECK(std::abs(coded / depth - 1) <= 0x1p-22);
    CHECK(std::abs(compare::coded_depth(view, depth, 32) / depth - 1) <= 0x1p-24 * 1.0001);
  }
  kernels::View flat = view;
  flat.orthographic = true;
  flat.z_far = 1001;
  for (int i = 0; i < 1000; ++i) {
    const double depth = 1.5 + i;
    CHECK(std::abs(compare::coded_depth(flat, depth, 28) - depth) <= 0.5001 * 1000 * 0x1p-28);
    CHECK(std::abs(compare::coded_depth(flat, depth, 32) - depth) <= 0.5001 * 1000 * 0x1p-32);
  }
}

TEST_CASE("the first of two triangles with the same depth code is drawn", "[reference]") {
  // The second square is nearer by slightly less than a step of 28 bits, and by more than a step of 32 bits.
  const auto nearer = static_cast<float>(8 * 0x1p-23);
  std::vector<float> points = square(-4, -4), second = square(-4, -4);
  for (size_t i = 2; i < second.size(); i += 3) second[i] = nearer;
  points.insert(points.end(), second.begin(), second.end());
  const std::vector<uint32_t> corners{0, 1, 2, 0, 2, 3, 4, 5, 6, 4, 6, 7};
  const kernels::View view = deep_view(16, 16);
  const auto second_drawn = [&](const ReferenceMode& mode) {
    uint64_t count = 0;
    for (const ReferencePixel& pixel : draw(points, corners, view, mode))
      count += !pixel.is_background() && pixel.triangle >= 2 ? 1 : 0;
    return count;
  };
  CHECK(second_drawn({}) == 64);
  CHECK(second_drawn({.snap = 0, .depth_bits = 32}) == 64);
  CHECK(second_drawn({.snap = 0, .depth_bits = 28}) == 0);
}

TEST_CASE("the reference's colours equal those of kernels/", "[reference]") {
  for (const char* name : {"colors.glb", "multi_primitive.glb", "two_instances.gltf", "nodes.gltf", "modes.glb"}) {
    INFO(name);
    const std::string source = tests::data_path(name).string();
    const tests::TempFolder folder;
    convert::ConvertOptions options;
    options.float32 = true;
    options.source_ids = true;
    REQUIRE(tests::pack(source, folder.file("a.scree"), options));
    auto file = must(runtime::SceneFile::open(folder.file("a.scree")));
    const auto scene = must(runtime::Scene::load(std::move(file), 0, {false, 2}));
    const kernels::View view = tests::must_view(scene, {.width = 96, .height = 64});
    const auto gltf = must(convert::import_gltf(source, {}));
    const auto model = must(compare::load_source_model(gltf, scene.container(), 0));
    const auto expected = must(compare::draw_reference(model.views, model.instances, view, 2));
    const auto frame = tests::must_draw(scene, view);
    kernels::ShadeOptions shading{.show = kernels::Show::kColor};
    shading.background[3] = 1;
    const auto picture = must(frame.shade(shading, 2));
    const auto rgb = must(compare::shade_reference(model, expected, view, 1, 2));
    const auto report = must(compare::compare_frame(scene, frame.samples(), model, expected, view, 2));
    uint64_t same = 0;
    int largest = 0;
    for (size_t i = 0; i < report.kinds.size(); ++i) {
      if (report.kinds[i] != compare::PixelKind::kSame) continue;
      ++same;
      for (size_t c = 0; c < 3; ++c)
        largest = std::max(largest, std::abs(int{rgb[3 * i + c]} - int{picture[4 * i + c]}));
    }
    CHECK(same > 100);
    CHECK(largest <= 1);
  }
}

TEST_CASE("averages of 8 x 8 samples are in linear light", "[reference]") {
  // Half of a pixel is white (lit from the front), and half is background: 188 of 255. The mean of the coded values
  // would be 128.
  compare::SourceModel model;
  model.meshes.resize(1);
  model.meshes[0].positions = {-4, -4, 0, 0.5f, -4, 0, 0.5f, 4, 0, -4, 4, 0};
  model.meshes[0].corners = kSquareCorners;
  model.meshes[0].unlit = true;
  model.views.push_back({model.meshes[0].positions, model.meshes[0].corners, nullptr, false});
  model.instances.push_back(identity());
  kernels::View view = deep_view(16, 16);
  view.width = view.height = 128;
  const auto samples = must(compare::draw_reference(model.views, model.instances, view, 2));
  const auto rgb = must(compare::shade_reference(model, samples, view, 8, 2));
  REQUIRE(rgb.size() == 3 * 16 * 16);
  CHECK(rgb[3 * (8 * 16 + 7)] == 255);
  CHECK(rgb[3 * (8 * 16 + 8)] == 188);
  CHECK(rgb[3 * (8 * 16 + 9)] == 0);
}

TEST_CASE("the reference uses only a type and a limit of kernels/, and no code", "[reference]") {
  const std::filesystem::path folder = std::filesystem::path(tests::kDataFolder) / "../../tools/compare";
  const std::regex name("kernels::([A-Za-z_]+)"), include("#include \"kernels/([a-z_.]+)\"");
  uint64_t files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    if (!entry.path().filename().string().starts_with("reference")) continue;
    ++files;
    const std::string text = tests::read_whole(entry.path());
    INFO(entry.path().filename().string());
    for (std::sregex_iterator at(text.begin(), text.end(), name), end; at != end; ++at)
      CHECK(((*at)[1] == "View" || (*at)[1] == "kMaxImageSide"));
    for (std::sregex_iterator at(text.begin(), text.end(), include), end; at != end; ++at) CHECK((*at)[1] == "frame.h");
  }
  CHECK(files >= 6);
}
