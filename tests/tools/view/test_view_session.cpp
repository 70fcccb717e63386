// Sessions: hidden nodes, including blended ones, are left out on the CPU and on a GPU, and can be shown again. The
// sun's shadows equal those of scree render, and their map is kept.
#include "tools/view/session.h"

#include <cstdlib>
#include <string>
#include <vector>

#include "runtime/images/image.h"
#include "tests/gpu.h"
#include "tests/models.h"
#include "tests/tools/convert/convert_fixture.h"
#include "tests/tools/run_program.h"

using namespace scree;
using namespace scree::tools::view;
using scree::tests::TempFolder;

namespace {

ViewSession open(const std::string& path, tools::BackendChoice choice, const tools::LightOptions& light = {}) {
  SessionOptions options;
  options.light = light;
  options.file = path;
  options.threads = 2;
  options.backend.choice = choice;
  options.quiet = true;
  return must(ViewSession::open(options));
}

using Rgb = std::vector<uint8_t>;

Rgb rgb(const PixelView& pixels) {
  Rgb out;
  for (size_t i = 0; i < pixels.bytes.size(); ++i)
    if (i % pixels.channels < 3) out.push_back(pixels.bytes[i]);
  return out;
}

/// Draws eight quads in two rows, of which node 5 is blended.
Rgb draw(ViewSession& session, const Visibility& visibility, uint32_t viewer = 0) {
  PictureRequest request;
  request.camera.eye = {3.75, 1.25, 9};
  request.camera.target = {3.75, 1.25, 0};
  request.shade.background[3] = 1;
  return rgb(must(session.draw(viewer, request, 120, 60, 1, visibility)).pixels);
}

/// The picture of sun.glb from a camera at `x`, at rest or while it moves.
Drawn draw_sun(ViewSession& session, double x, bool shadows, bool moves = false, const Visibility& visibility = {},
               std::optional<runtime::WorldBox> clip_box = {}, kernels::Show show = kernels::Show::kTexture) {
  PictureRequest request;
  request.camera.eye = {x, 6, 9};
  request.camera.fov_degrees = 14;
  request.shade.background[3] = 1;
  request.shade.show = show;
  request.shadows = shadows;
  request.clip_box = clip_box;
  const JpegKind jpeg{90, true};
  Drawn drawn = must(session.draw(0, request, 120, 80, 1, visibility, moves ? &jpeg : nullptr));
  CHECK(drawn.left_bytes == 0);
  return drawn;
}

/// The number of channels that differ by more than one level, the tolerance of shading with floats.
size_t differing(const Rgb& a, const Rgb& b) {
  REQUIRE(a.size() == b.size());
  size_t count = 0;
  for (size_t i = 0; i < a.size(); ++i) count += std::abs(a[i] - b[i]) > 1 ? 1 : 0;
  return count;
}

}  // namespace

TEST_CASE("hidden nodes, opaque and blended, are left out on the CPU and on a GPU", "[view][cuda][omitted]") {
  const TempFolder folder;
  convert::ConvertOptions options = tests::options_of(folder, tests::data_path("materials.gltf"));
  options.encoding = GENERATE(convert::Encoding::kIndexed, convert::Encoding::kClustered);
  tests::must_convert(options);
  ViewSession cpu = open(options.output, tools::BackendChoice::kCpu);
  const std::vector<Visibility> all_kinds{{}, {{5}, {}}, {{1, 6}, {}}, {{}, {5}}, {{5}, {5}}, {}};
  std::vector<Rgb> expected;
  for (const Visibility& visibility : all_kinds) expected.push_back(draw(cpu, visibility));
  CHECK(expected.back() == expected.front());
  for (size_t i = 1; i + 1 < expected.size(); ++i) CHECK(differing(expected[i], expected[i - 1]) > 100);
  // The node's name and its instance's number are those in the whole scene.
  draw(cpu, {{0, 1}, {}});
  const auto picked = must(cpu.pick({75, 20}));
  REQUIRE(picked.has_value());
  CHECK(picked->node == 6);
  CHECK(picked->instance == 6);
  if (!tests::has_gpu()) return;
  ViewSession gpu = open(options.output, tools::BackendChoice::kCuda);
  std::vector<Rgb> found;
  for (size_t i = 0; i < all_kinds.size(); ++i) {
    INFO("visibility " << i);
    if (i == 3) {  // from now on the scene is resident
      CHECK(must(gpu.load_rest({})) == 0);
    }
    found.push_back(draw(gpu, all_kinds[i]));
    CHECK(differing(found[i], expected[i]) == 0);
  }
  CHECK(found.back() == found.front());
  // Viewers take turns. Each gets its own picture again, even without drawing, and picks in it.
  for (const uint32_t round : {0, 1, 2}) {
    INFO("round " << round);
    if (round == 2) gpu.forget(1);
    CHECK(draw(gpu, all_kinds[1], 1) == found[1]);
    CHECK(draw(gpu, all_kinds[2], 2) == found[2]);
    CHECK(draw(gpu, {}, 0) == found[0]);
    CHECK(draw(gpu, all_kinds[2], 2) == found[2]);
    const auto at_hidden = gpu.pick({75, 20});
    draw(gpu, {{0, 1}, {}}, 1);
    const auto at_shown = must(gpu.pick({75, 20}));
    REQUIRE(at_hidden);
    CHECK(!at_hidden->has_value());
    REQUIRE(at_shown.has_value());
    CHECK(at_shown->node == 6);
  }
}

TEST_CASE("shadows at rest are those of scree render, and their map is kept", "[view][shadow][cuda]") {
  const TempFolder folder;
  convert::ConvertOptions options = tests::options_of(folder, tests::data_path("sun.glb"));
  options.normals = convert::Normals::kAuto;
  tests::must_convert(options);
  const tools::LightOptions light{.lighting = kernels::Lighting::kScene, .shadow_side = 300};
  const bool on_gpu = GENERATE(false, true);
  if (on_gpu && !tests::has_gpu()) return;
  CAPTURE(on_gpu);
  ViewSession session = open(options.output, on_gpu ? tools::BackendChoice::kCuda : tools::BackendChoice::kCpu, light);
  CHECK(session.can_cast_shadows());
  const std::string png = folder.file("render.png");
  const auto rendered = [&](const std::string& more) {
    tests::must_run(tests::words_of("render " + options.output + " -o " + png +
                                    " --size 120x80 --eye=-4,6,9 --fov 14 --target 0,0,0 --light scene" +
                                    " --background #000 --threads 2 --force --quiet --backend " +
                                    (on_gpu ? "cuda " : "cpu ") + more),
                    folder.file("log"));
    const std::string bytes = tests::read_whole(png);
    const auto image = must(runtime::decode_image(std::as_bytes(std::span(bytes))));
    Rgb out;
    for (size_t i = 0; i < image.rgba.size(); ++i)
      if (i % 4 < 3) out.push_back(image.rgba[i]);
    return out;
  };
  const Rgb expected = rendered("--shadows --shadow-size 300"), plain = rendered("");
  REQUIRE(differing(expected, plain) > 300);

  size_t maps = 0;
  const auto draw_at = [&](double x, bool shadows, bool moves, const Visibility& visibility = {},
                           std::optional<runtime::WorldBox> clip_box = {},
                           kernels::Show show = kernels::Show::kTexture) {
    const Drawn drawn = draw_sun(session, x, shadows, moves, visibility, clip_box, show);
    maps += drawn.shadow_ms > 0 ? 1 : 0;
    return moves ? Rgb() : rgb(drawn.pixels);
  };
  CHECK(draw_at(-4, false, false) == plain);
  CHECK(maps == 0);
  CHECK(draw_at(-4, true, false) == expected);
  CHECK(maps == 1);
  CHECK(draw_at(-4, false, false) == plain);  // shadows are switched off, and on again
  CHECK(draw_at(-4, true, false) == expected);
  draw_at(-4, true, false, {}, {}, kernels::Show::kDepth);
  CHECK(maps == 1);
  if (on_gpu) {  // from now on the scene is resident
    CHECK(must(session.load_rest({})) == 0);
  }
  CHECK(draw_at(-4, true, false) == expected);

  // While the camera moves, one map serves many pictures.
  maps = 0;
  for (int i = 0; i < 60; ++i) draw_at(-4 + 0.2 * i, true, true);
  CAPTURE(maps);
  CHECK((maps >= 1 && maps <= 3));
  maps = 0;
  CHECK(draw_at(-4, true, false) == expected);
  CHECK(maps == 1);
  draw_at(-4, true, true);
  CHECK(maps == 1);

  // Hidden nodes and parts outside a box cast no shadows, because they are not drawn.
  const Visibility hidden{{1}, {}};
  const Rgb without = draw_at(-4, true, false, hidden);
  CHECK(maps == 2);
  CHECK(draw_at(-4, true, false, hidden) == without);
  CHECK(maps == 2);
  const Rgb without_another = draw_at(-4, true, false, {{2}, {}});
  CHECK(maps == 3);
  CHECK(differing(without, without_another) > 100);
  CHECK(draw_at(-4, true, false) == expected);
  CHECK(maps == 4);
  const runtime::WorldBox low{{-9, -9, -9}, {9, 0.75, 9}};
  CHECK(draw_at(-4, true, false, {}, low) == rendered("--shadows --shadow-size 300 --clip-box=-9,-9,-9,9,0.75,9"));
  CHECK(maps == 5);
}

TEST_CASE("a session without a sun gives the reason why it has no shadows", "[view][shadow]") {
  const TempFolder folder;
  convert::ConvertOptions options = tests::options_of(folder, tests::data_path(GENERATE("sun.glb", "materials.gltf")));
  tests::must_convert(options);
  ViewSession session = open(options.output, tools::BackendChoice::kCpu);
  std::string why;
  CHECK_FALSE(session.can_cast_shadows(&why));
  CHECK(why ==
        (options.input.ends_with("sun.glb") ? "Needs scree view --light scene" : "The scene has no directional light"));
  const Drawn drawn = draw_sun(session, -4, true);
  CHECK(drawn.shadow_ms == 0);
  const Rgb pixels = rgb(drawn.pixels);
  CHECK(pixels == rgb(draw_sun(session, -4, false).pixels));
}
