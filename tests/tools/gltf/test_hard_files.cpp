// Hard cases between glTF and the picture: shared borders, coordinates far from the origin, texture coordinates in the
// thousands. tests/kernels/raster/test_hard_cases.cpp has the rasteriser's hard cases.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <optional>
#include <random>
#include <utility>
#include <vector>

#include "kernels/frame.h"
#include "kernels/visbuffer.h"
#include "runtime/draw/device_scene.h"
#include "runtime/scene/scene.h"
#include "tests/gpu.h"
#include "tests/kernels/raster/hard_cases.h"
#include "tests/paths.h"
#include "tests/runtime/frame.h"
#include "tests/sanitized.h"
#include "tests/tools/convert/convert_fixture.h"
#include "tests/tools/model_maker.h"

using namespace scree;
using namespace scree::tests;

namespace {

constexpr int kSide = 48;                                 // squares along an edge of the room
constexpr std::array<int, 5> kCuts{0, 5, 18, 27, kSide};  // its walls have tiles of different sizes

/// A point of the room's bumpy surface. It depends only on the three numbers, so that tiles have common borders.
std::array<float, 3> room_point(const std::array<int, 3>& at) {
  std::array<double, 3> p;
  for (size_t i = 0; i < 3; ++i) p[i] = 10.0 * at[i] / kSide - 5;
  std::array<float, 3> out;
  for (size_t i = 0; i < 3; ++i)
    out[i] = static_cast<float>(p[i] + 0.05 * std::sin(7.3 * p[(i + 1) % 3] + 3.1 * p[(i + 2) % 3] + 2.7 * p[i]));
  return out;
}

/// A closed room of 96 meshes, double-sided.
void make_room(const std::string& path) {
  tests::ModelMaker maker(path);
  const uint32_t both_sides = maker.writer().add_material({.double_sided = true});
  for (size_t axis = 0; axis < 3; ++axis) {
    for (const int side : {0, kSide}) {
      for (size_t a = 0; a + 1 < kCuts.size(); ++a) {
        for (size_t b = 0; b + 1 < kCuts.size(); ++b) {
          std::vector<float> points;
          std::vector<uint32_t> corners;
          const int columns = kCuts[a + 1] - kCuts[a];
          for (int v = kCuts[b]; v <= kCuts[b + 1]; ++v) {
            for (int u = kCuts[a]; u <= kCuts[a + 1]; ++u) {
              std::array<int, 3> at{};
              at[axis] = side;
              at[(axis + 1) % 3] = u;
              at[(axis + 2) % 3] = v;
              const std::array<float, 3> point = room_point(at);
              points.insert(points.end(), point.begin(), point.end());
              if (u == kCuts[a + 1] || v == kCuts[b + 1]) continue;
              const auto first = static_cast<uint32_t>((v - kCuts[b]) * (columns + 1) + u - kCuts[a]);
              const auto next = first + static_cast<uint32_t>(columns) + 1;
              corners.insert(corners.end(), {first, first + 1, next + 1, first, next + 1, next});
            }
          }
          tools::GltfPrimitive tile = maker.primitive(points, corners);
          tile.material = both_sides;
          maker.draw("tile", {tile});
        }
      }
    }
  }
  maker.finish();
}

/// The number of background pixels that 100 cameras see, which look in random directions from within the room. Every
/// such pixel is a crack. `on_gpu`: draws on a GPU.
uint64_t crack_pixels(const std::string& path, bool on_gpu = false) {
  const auto scene = must(runtime::Scene::open(path, {false, 2}));
  std::optional<runtime::DeviceScene> device;
  if (on_gpu) device.emplace(must(runtime::DeviceScene::upload(scene, 0, 2)));
  std::mt19937 random(71);
  std::uniform_real_distribution<double> unit(-1, 1);
  uint64_t cracks = 0;
  for (int i = 0; i < 100; ++i) {
    const std::array<double, 3> eye{4 * unit(random), 4 * unit(random), 4 * unit(random)};
    const kernels::View view =
        tests::look_at(eye, {eye[0] + unit(random), eye[1] + unit(random), eye[2] + unit(random)}, 320, 240, 0.01, 1.2);
    auto frame = tests::must_draw(scene, view, 1, device ? &*device : nullptr);
    REQUIRE(frame.read_samples());
    const auto is_background = [](uint64_t sample) { return sample == kernels::kBackground; };
    cracks += static_cast<uint64_t>(std::count_if(frame.samples().begin(), frame.samples().end(), is_background));
  }
  return cracks;
}

std::vector<double> decoded(const std::string& path) {
  const tests::PackedFile packed = must_open(path);
  tools::ChunkReader reader(packed.file);
  std::vector<double> out;
  for (uint64_t i = 0; i < packed.file.chunks().size(); ++i) {
    const auto chunk = must(reader.read(i));
    out.insert(out.end(), chunk->positions.begin(), chunk->positions.end());
  }
  return out;
}

}  // namespace

TEST_CASE("hard: meshes on the scene grid have no cracks between them, on their own grids a known number", "[hard]") {
  const TempFolder folder;
  make_room(folder.file("in.glb"));
  convert::ConvertOptions options = options_of(folder);
  const auto encoding = GENERATE(convert::Encoding::kIndexed, convert::Encoding::kClustered);
  options.encoding = encoding;
  for (const uint32_t bits : {8u, 10u, 12u, 16u}) {
    CAPTURE(bits);
    if (encoding == convert::Encoding::kClustered && bits != 8) continue;  // the same points as with 8 bits
    if (tests::kIsSanitized && bits != 8 && bits != 16) continue;
    options.position_bits = bits;
    options.grid = convert::Grid::kScene;
    must_match(options);
    REQUIRE(must_open(options.output).file.meshes().size() == 96);
    const uint64_t scene = crack_pixels(options.output);
    options.grid = convert::Grid::kMesh;
    must_match(options);
    const uint64_t mesh = crack_pixels(options.output);
    tests::note(
        "cracks, " + std::to_string(bits) + " bits" + (encoding == convert::Encoding::kClustered ? ", clustered" : ""),
        std::to_string(scene) + " background pixels of 7,680,000 on the scene grid, " + std::to_string(mesh) +
            " on mesh grids");
    CHECK(scene == 0);
    if (bits == 8) CHECK(mesh > 0);  // the mesh is visible
    if (bits == 16) CHECK(mesh < 1000);
  }
  if (encoding == convert::Encoding::kClustered) return;
  options.float32 = true;
  must_match(options);
  const uint64_t floats = crack_pixels(options.output);
  tests::note("cracks, float32", std::to_string(floats) + " background pixels");
  CHECK(floats == 0);
}

TEST_CASE("hard: no cracks between meshes on the scene grid on a GPU", "[cuda][hard]") {
  if (!tests::has_gpu()) return;
  const TempFolder folder;
  make_room(folder.file("in.glb"));
  convert::ConvertOptions options = options_of(folder);
  options.position_bits = 8;
  for (const auto encoding : {convert::Encoding::kIndexed, convert::Encoding::kClustered}) {
    if (tests::kEmulatesGpu && encoding == convert::Encoding::kIndexed) continue;
    options.encoding = encoding;
    options.grid = convert::Grid::kScene;
    must_convert(options);
    CHECK(crack_pixels(options.output, true) == 0);
    options.grid = convert::Grid::kMesh;
    must_convert(options);
    CHECK(crack_pixels(options.output, true) == crack_pixels(options.output));
  }
}

TEST_CASE("hard: georeferenced detail is kept by the node's translation, not by float32 vertices", "[hard]") {
  const TempFolder folder;
  const std::array<double, 3> away{1e7, -5e6, 2.5e6};
  const tests::Soup ball = tests::sphere(40, 0.001);
  std::vector<float> moved;
  for (size_t i = 0; i < ball.positions.size(); ++i)
    moved.push_back(static_cast<float>(static_cast<double>(ball.positions[i]) + away[i % 3]));
  const auto error_of = [&](const std::vector<float>& points, const std::array<double, 3>& node) {
    tests::make_model(folder.file("in.glb"), points, ball.indices, node);
    convert::ConvertOptions options = options_of(folder);
    options.order = convert::Order::kNone;  // and one chunk, so that vertices are as in the source
    options.encoding = convert::Encoding::kIndexed;
    options.weld = false;
    must_match(options);
    const tests::PackedFile packed = must_open(options.output);
    REQUIRE(packed.file.chunks().size() == 1);
    const std::vector<double> found = decoded(options.output);
    REQUIRE(found.size() == ball.positions.size());
    double largest = 0;
    for (size_t i = 0; i < found.size(); ++i) {
      const double world = found[i] + packed.file.matrices()[0].rows[i % 3][3];
      largest = std::max(largest, std::abs(world - (static_cast<double>(ball.positions[i]) + away[i % 3])));
    }
    return largest;
  };
  const double by_node = error_of(ball.positions, away);
  const double by_vertex = error_of(moved, {0, 0, 0});
  char text[160];
  std::snprintf(text, sizeof text,
                "largest error of a vertex %.2g m by the node's translation, %.2g m as float32 vertices", by_node,
                by_vertex);
  tests::note("georeferenced, 1e7 m", text);
  CHECK(by_node < 3.1e-5);  // half a step of 2^-14 m
  CHECK(by_vertex > 0.1);   // the source has already lost the detail
  CHECK(by_vertex < 1.01);
}

namespace {

/// Makes a grid with a picture whose texture coordinates begin at `offset`. Returns the coordinates.
std::vector<float> make_far_textured(const std::string& path, double offset) {
  const std::string png = tests::read_whole(std::string(tests::kDataFolder) + "/checker.png");
  tests::ModelMaker maker(path);
  const tests::GridSpec spec{.columns = 20, .rows = 20};
  tools::GltfPrimitive grid =
      maker.grid(spec, maker.textured("checker", format::ImageCodec::kPng, std::as_bytes(std::span(png))));
  std::vector<float> uvs;
  for (uint32_t y = 0; y <= 20; ++y)
    for (uint32_t x = 0; x <= 20; ++x)
      uvs.insert(uvs.end(), {static_cast<float>(offset + x * 0.37), static_cast<float>(y * 0.21 - offset)});
  grid.attributes.emplace_back("TEXCOORD_0", maker.floats(uvs, tools::GltfType::kVec2));
  maker.node("node", maker.mesh("mesh", {grid}));
  maker.finish();
  return uvs;
}

}  // namespace

TEST_CASE("hard: texture coordinates in the thousands keep the precision of float32", "[hard]") {
  const TempFolder folder;
  for (const double offset : {0.0, 1000.0, 5000.0, -70000.0}) {
    const std::vector<float> uvs = make_far_textured(folder.file("in.glb"), offset);
    const convert::ConvertOptions options = options_of(folder);
    must_match(options);
    const double stated = static_cast<double>(must_open(options.output).file.meshes()[0].max_uv_error);
    double largest = 0;
    for (const float value : uvs) largest = std::max(largest, std::abs(static_cast<double>(value)));
    const double ulp = std::ldexp(1.0, std::ilogb(largest) - 23);
    char text[120];
    std::snprintf(text, sizeof text, "stated error %.2g, float32 there is %.2g apart", stated, ulp);
    tests::note("texture coordinates at " + std::to_string(static_cast<int>(offset)), text);
    CHECK(stated <= 0x1p-16 + ulp);
  }
}

TEST_CASE("hard: a GPU shades texture coordinates in the thousands as the CPU does", "[cuda][hard]") {
  if (!tests::has_gpu()) return;
  const TempFolder folder;
  for (const double offset : {1000.0, 5000.0, -70000.0}) {
    CAPTURE(offset);
    make_far_textured(folder.file("in.glb"), offset);
    const convert::ConvertOptions options = options_of(folder);
    must_convert(options);
    const auto scene = must(runtime::Scene::open(options.output, {true, 2}));
    runtime::DeviceScene device = must(runtime::DeviceScene::upload(scene, 0, 2));
    const kernels::View view = tests::look_at({0.5, 1.2, 1.5}, {0.5, 0, 0.5}, 320, 240, 0.01, 1.2);
    const auto expected = tests::must_picture(scene, view);
    const size_t wrong = tests::differing(expected, tests::must_picture(scene, view, 1, &device));
    tests::note("texture coordinates at " + std::to_string(static_cast<int>(offset)) + " on the GPU",
                std::to_string(wrong) + " of " + std::to_string(expected.size()) +
                    " bytes differ from the CPU's by more than one level");
    CHECK(wrong <= expected.size() / 10000);
  }
}
