#include "tests/runtime/frame.h"

#include <array>
#include <cmath>
#include <fstream>
#include <string>
#include <vector>

#include "kernels/visbuffer.h"
#include "runtime/scene/camera.h"
#include "tests/models.h"
#include "tests/runtime/load_scene.h"
#include "tools/convert/convert.h"

using namespace scree;
using namespace scree::runtime;
using namespace scree::tests;
using scree::kernels::ShadeOptions;
using scree::kernels::View;

namespace {

Result<Scene> load_file(const std::string& path, uint32_t threads = 2) {
  return Scene::open(path, {true, threads});
}

/// The quad from the front. It fills half of the picture's height and, with square pixels, a quarter to half of its
/// width.
View front_view(const Scene& scene, uint32_t width, uint32_t height) {
  return must_view(
      scene, {.eye = Vec3{0, 0, 2}, .target = Vec3{0, 0, 0}, .fov_degrees = 90, .width = width, .height = height});
}

Frame draw(const Scene& scene, const View& view, uint32_t samples = 1, uint32_t threads = 2) {
  return must(Frame::draw(scene, view, samples, threads));
}

std::vector<uint8_t> shade(const Frame& frame, const ShadeOptions& options = {}, uint32_t threads = 2) {
  return must(frame.shade(options, threads));
}

std::array<uint8_t, 4> pixel(const std::vector<uint8_t>& picture, uint32_t width, uint32_t x, uint32_t y) {
  std::array<uint8_t, 4> out;
  std::copy_n(picture.begin() + 4 * (ptrdiff_t{y} * width + x), 4, out.begin());
  return out;
}

using Rgba = std::array<uint8_t, 4>;

}  // namespace

TEST_CASE("a textured quad is upright and not mirrored", "[renderer]") {
  const Scene scene = must_load(SmallScene{});
  CHECK(scene.stats().images == 1);
  CHECK(scene.stats().pages == 1);
  const Frame frame = draw(scene, front_view(scene, 80, 40));
  const std::vector<uint8_t> picture = shade(frame);
  CHECK(pixel(picture, 80, 35, 15) == Rgba{255, 0, 0, 255});
  CHECK(pixel(picture, 80, 45, 15) == Rgba{0, 255, 0, 255});
  CHECK(pixel(picture, 80, 35, 25) == Rgba{0, 0, 255, 255});
  CHECK(pixel(picture, 80, 45, 25) == Rgba{255, 255, 255, 255});
  CHECK(pixel(picture, 80, 5, 5) == Rgba{0, 0, 0, 0});
  // Exactly 20 x 20 pixels: the edges lie on borders of pixels, and the top-left rule includes one side of each pair.
  CHECK(pixel(picture, 80, 30, 10)[3] == 255);
  CHECK(pixel(picture, 80, 49, 29)[3] == 255);
  CHECK(pixel(picture, 80, 29, 10)[3] == 0);
  CHECK(pixel(picture, 80, 50, 29)[3] == 0);
}

TEST_CASE("an opaque background makes an opaque picture", "[renderer]") {
  const Scene scene = must_load(SmallScene{});
  ShadeOptions options;
  options.background[0] = 1;
  options.background[3] = 1;
  const std::vector<uint8_t> picture = shade(draw(scene, front_view(scene, 80, 40)), options);
  CHECK(pixel(picture, 80, 5, 5) == Rgba{255, 0, 0, 255});
}

TEST_CASE("picking returns node, mesh, triangle, source triangle and depth", "[renderer]") {
  const Scene scene = must_load(SmallScene{});
  for (const uint32_t samples : {1u, 2u, 4u}) {
    const Frame frame = draw(scene, front_view(scene, 80, 40), samples);
    const std::optional<Pick> low = *frame.pick(47, 27);  // below the diagonal: the first triangle
    REQUIRE(low);
    CHECK(low->node == 1);
    CHECK(low->mesh == 0);
    CHECK(low->mesh_triangle == 0);
    CHECK(low->source_triangle == 70u);
    CHECK(low->depth == Approx(2).epsilon(1e-5));
    const Pick high = must(*frame.pick(33, 12));
    CHECK(high.mesh_triangle == 1);
    CHECK(high.source_triangle == 71u);
    CHECK_FALSE(*frame.pick(2, 2));

    const std::vector<float> depth = *frame.layer<float>(scree::runtime::Layer::kDepth, 2);
    REQUIRE(depth.size() == 3200);
    CHECK(depth[20 * 80 + 40] == Approx(2).epsilon(1e-5));
    CHECK(std::isinf(depth[0]));
    CHECK(frame.samples().size() == size_t{3200} * samples * samples);
  }
}

TEST_CASE("more samples give a better estimate of a shape's area", "[renderer]") {
  SmallScene small;
  small.change = [](format::TableSet& tables) {  // rotated by 20 degrees about z
    const double turn = 20 * 3.14159265358979 / 180;
    tables.matrices[0].rows[0][0] = tables.matrices[0].rows[1][1] = std::cos(turn);
    tables.matrices[0].rows[0][1] = -std::sin(turn);
    tables.matrices[0].rows[1][0] = std::sin(turn);
    tables.materials[0].texture = format::kNone;  // white
  };
  const Scene scene = must_load(small);
  const double exact = 37.0 * 37.0 / 4;  // a quad of 2 units at a distance of 2 takes half of the height of 37 pixels
  std::array<double, 3> worst_error{};
  for (const size_t i : {0u, 1u, 2u}) {
    const std::vector<uint8_t> picture = shade(draw(scene, front_view(scene, 61, 37), 1u << i));
    double area = 0;
    int partial = 0;
    for (uint32_t y = 0; y < 37; ++y) {
      for (uint32_t x = 0; x < 61; ++x) {
        const Rgba rgba = pixel(picture, 61, x, y);
        area += rgba[3] / 255.0;
        partial += rgba[3] != 0 && rgba[3] != 255;
        // The black of a transparent background must not darken an edge.
        if (rgba[3] != 0) CHECK(rgba[1] == 255);
      }
    }
    CHECK((partial == 0) == (i == 0));
    worst_error[i] = std::abs(area - exact);
  }
  CHECK(worst_error[0] < 6);
  CHECK(worst_error[2] < 1.5);
}

TEST_CASE("a picture above the largest side is refused", "[renderer]") {
  const Scene scene = must_load(SmallScene{});
  View view = front_view(scene, 80, 40);
  view.width = 8193;
  check_refusal(Frame::draw(scene, view, 2, 1), ErrorCode::kRange, "16386 x 80 samples");
}

TEST_CASE("compressed pages draw the same picture as raw pages", "[renderer]") {
  const SmallScene packed{.zstd_level = 19};
  const Scene raw = must_load(SmallScene{});
  const Scene decoded = must_load(packed);
  const View view = front_view(raw, 80, 40);
  const Frame a = draw(raw, view);
  CHECK(std::equal(a.samples().begin(), a.samples().end(), draw(decoded, view).samples().begin()));
  CHECK(raw.stats().decoded_bytes == 0);
}

TEST_CASE("loading finds a flipped bit in any page", "[renderer]") {
  const ScratchPath path("flipped.scree");
  SmallScene{}.write(path.string());
  const std::vector<std::byte> whole = scree::tests::read_bytes(path.path());
  size_t refused = 0;
  for (size_t at = 0; at < whole.size(); at += 61) {
    std::vector<std::byte> file = whole;
    file[at] ^= std::byte{4};
    {
      std::ofstream out(path.path(), std::ios::binary);
      out.write(reinterpret_cast<const char*>(file.data()), static_cast<std::streamsize>(file.size()));
    }
    const Result<Scene> scene = load_file(path.string());
    if (scene) continue;  // the flipped bit lies in padding that belongs to no page of the scene
    ++refused;
    CHECK(scene.error().message.find(path.string() + ": ") == 0);
    CHECK(scree::exit_code(scene.error().code) == 3);
  }
  CHECK(refused > 20);
}

TEST_CASE("an image that differs from its record is named", "[renderer]") {
  const SmallScene small{.change = [](format::TableSet& tables) {
    tables.images[0].width = 4;
    tables.images[0].name = tables.strings.add("wall");
  }};
  const ScratchPath path("image.scree");
  small.write(path.string());
  check_refusal(
      load_file(path.string()),
      {ErrorCode::kFormat, path.string() + ": image 0 (wall): the image is 2 x 2, but its record gives 4 x 2"});
}

TEST_CASE("scenes are found by name and by number", "[renderer]") {
  const ScratchPath path("scenes.scree");
  const SmallScene small{.change = [](format::TableSet& tables) {
    tables.scenes[0].flags = 0;
    tables.scenes.push_back({tables.strings.add("Empty"), 1, 1, 0, 1, 0, 0});
  }};
  small.write(path.string());
  const SceneFile file = must(SceneFile::open(path.string()));
  CHECK(*file.find_scene("") == 1);  // the default
  CHECK(*file.find_scene("Main") == 0);
  CHECK(*file.find_scene("0") == 0);
  check_refusal(file.find_scene("2"),
                {ErrorCode::kUsage, path.string() + ": no scene '2', expected one of 0 (Main), 1 (Empty)"});
  const Scene empty = must(load_file(path.string()));
  const Frame frame = draw(empty, front_view(empty, 8, 8));
  CHECK(frame.samples()[0] == kernels::kBackground);
  CHECK_FALSE(*frame.pick(4, 4));
}

TEST_CASE("a scene with more triangles than there are ids is refused", "[renderer]") {
  SmallScene small;
  small.change = [](format::TableSet& tables) {
    // The triangles of one point take no bits: 1024 chunks of 65536 triangles, drawn 1025 times.
    format::MeshRecord& mesh = tables.meshes[0];
    mesh.attributes = 0;
    mesh.chunk_count = mesh.vertex_count = 1024;
    mesh.triangle_count = uint64_t{1024} << 16;
    tables.chunks.assign(1024, {.triangle_count = 1u << 16, .vertex_count = 1});
    for (uint64_t i = 0; i < 1024; ++i) tables.chunks[i].first_triangle = i << 16;
    for (uint32_t i = 0; i < 1024; ++i) {
      tables.nodes.push_back(SmallScene::node(tables, "Again", 0, 0, format::kNone));
      tables.instances.push_back({0, 2 + i, 0, 0});
    }
    tables.scenes[0].instance_count = 1025;
    tables.scenes[0].triangle_count = uint64_t{1025} * mesh.triangle_count;
  };
  const ScratchPath path("many.scree");
  small.write(path.string());
  check_refusal(load_file(path.string()), ErrorCode::kRange, "2^36 - 1");
}

TEST_CASE("real models are equal with one thread and many, and fill their part of the picture", "[renderer][models]") {
  const std::filesystem::path models = scree::tests::real_models("scenes");
  if (models.empty()) return;
  struct Model {
    const char* path;
    double least, most;  // share of the picture that the model covers in the default view
  };
  for (const Model& model :
       {Model{"scenes/Duck/Duck.glb", 0.2, 0.6}, Model{"scenes/DamagedHelmet/DamagedHelmet.glb", 0.15, 0.7},
        Model{"scenes/VertexColorTest/VertexColorTest.gltf", 0.2, 0.8},
        Model{"scenes/scans/nefertiti.glb", 0.1, 0.7}}) {
    INFO(model.path);
    if (!std::filesystem::exists(models / model.path)) continue;
    const ScratchPath path("model.scree");
    scree::convert::ConvertOptions convert;
    convert.input = (models / model.path).string();
    convert.output = path.string();
    convert.threads = 2;
    must(scree::convert::convert(convert));
    const Scene scene = must(load_file(path.string()));
    const View view = must_view(scene, {.width = 160, .height = 120});
    const Frame one = draw(scene, view, 2, 1), many = draw(scene, view, 2, 7);
    CHECK(std::equal(one.samples().begin(), one.samples().end(), many.samples().begin()));
    const std::vector<uint8_t> picture = shade(one, {}, 1);
    CHECK(picture == shade(many, {}, 5));
    double covered = 0;
    for (uint32_t y = 0; y < 120; ++y)
      for (uint32_t x = 0; x < 160; ++x) covered += pixel(picture, 160, x, y)[3] / 255.0;
    covered /= 160 * 120;
    CHECK(covered > model.least);
    CHECK(covered < model.most);
    const Pick pick = must(*one.pick(80, 60));
    CHECK(pick.mesh_triangle < scene.view().meshes[pick.mesh].triangle_count);
    CHECK(pick.depth > view.z_near);
  }
}
