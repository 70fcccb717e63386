// Shadows of the library are kept from frame to frame, and are the same in batches and after scree_shade(), on the CPU
// and on a GPU. test_render_equal.cpp compares them with scree render's.
#include <cstdlib>
#include <string>
#include <vector>

#include "tests/gpu.h"
#include "tests/library/shots.h"

using namespace scree::tests;

namespace {

scree_draw_options sunny(uint32_t flags = SCREE_SHADOWS) {
  scree_draw_options options = draw_options(64, 48, 2);
  options.background[3] = 1;
  options.light = SCREE_LIGHT_SCENE;
  options.flags = flags;
  options.shadow_size = 200;
  return options;
}

struct Drawn {
  std::string color;
  double shadow_ms = 0;
};

Drawn color_of(scree_view* view) {
  std::string color = layer_of(view, SCREE_COLOR);
  return {std::move(color), frame_stats_of(view).shadow_ms};
}

Drawn draw(scree_view* view, const scree_camera& camera, const scree_draw_options& options) {
  must(scree_draw(view, &camera, &options));
  return color_of(view);
}

Drawn shade(scree_view* view, const scree_draw_options& options) {
  must(scree_shade(view, &options));
  return color_of(view);
}

/// The colours of a view that has drawn nothing else.
std::string fresh(const Opened& opened, const scree_camera& camera, const scree_draw_options& options) {
  const Drawn drawn = draw(NewView(opened.scene), camera, options);
  CHECK((drawn.shadow_ms > 0) == ((options.flags & SCREE_SHADOWS) != 0));
  return drawn.color;
}

void check_shadows(const Opened& opened) {
  const scree_scene_stats stats = stats_of(opened.scene);
  const scree_camera near = look_at(-4, 6, 9), far = look_at(8, 7, 3);
  scree_camera cut = near;
  cut.clips = 1;
  for (size_t i = 0; i < 3; ++i) {
    cut.clip_min[i] = stats.box_min[i];
    cut.clip_max[i] = i == 1 ? 0.5 * (stats.box_min[1] + stats.box_max[1]) : stats.box_max[i];
  }
  scree_draw_options coarse = sunny();
  coarse.shadow_size = 64;
  scree_draw_options depths = sunny();
  depths.show = SCREE_SHOW_DEPTH;
  const std::string expected = fresh(opened, near, sunny()), plain = fresh(opened, near, sunny(0));
  const std::string expected_far = fresh(opened, far, sunny()), expected_cut = fresh(opened, cut, sunny());
  const std::string expected_coarse = fresh(opened, near, coarse);
  REQUIRE(expected != plain);
  REQUIRE(expected != expected_coarse);

  scree_view* const view = opened.view;
  CHECK(draw(view, near, sunny(0)).shadow_ms == 0);
  const Drawn first = draw(view, near, sunny());
  CHECK(first.color == expected);
  CHECK(first.shadow_ms > 0);
  const Drawn again = draw(view, near, sunny());
  CHECK(again.color == expected);
  CHECK(again.shadow_ms == 0);
  scree_draw_options larger = sunny();
  larger.width *= 2;
  larger.height *= 2;
  larger.samples = 1;
  CHECK(draw(view, near, larger).shadow_ms == 0);  // the map does not depend on the number of pixels
  if (stats.streamed == 0) {
    CHECK(draw(view, near, sunny()).color == expected);
    CHECK(shade(view, sunny(0)).color == plain);
    const Drawn back = shade(view, sunny());
    CHECK(back.color == expected);
    CHECK(back.shadow_ms == 0);
    CHECK(shade(view, coarse).color == expected_coarse);
    CHECK(shade(view, depths).shadow_ms == 0);
    CHECK(shade(view, sunny()).color == expected);
  }
  for (const bool is_cut : {false, true}) {
    const Drawn drawn = draw(view, is_cut ? cut : far, sunny());
    CHECK(drawn.color == (is_cut ? expected_cut : expected_far));
    CHECK(drawn.shadow_ms > 0);
  }

  const std::vector<scree_camera> cameras{near, far, cut, near};
  const auto count = static_cast<uint32_t>(cameras.size());
  const scree_draw_options options = sunny();
  must(scree_draw_batch(view, cameras.data(), count, &options, 1u << SCREE_COLOR | 1u << SCREE_DEPTH));
  const Drawn batch = color_of(view);
  CHECK(batch.color == expected + expected_far + expected_cut + expected);
  CHECK(batch.shadow_ms > 0);
  must(scree_draw_batch(view, cameras.data(), count, &options, 1u << SCREE_DEPTH));
  CHECK(frame_stats_of(view).shadow_ms == 0);  // no colours are made
  if (stats.on_gpu != 0) return;
  std::vector<unsigned char> place(batch.color.size() + 16);
  unsigned char* const aligned = place.data() + (16 - reinterpret_cast<uintptr_t>(place.data()) % 16) % 16;
  const scree_target target = target_of(SCREE_COLOR, aligned, batch.color.size());
  must(scree_draw_batch_to(view, cameras.data(), count, &options, &target, 1, nullptr));
  CHECK(std::string(static_cast<const char*>(target.data), target.bytes) == batch.color);
}

}  // namespace

TEST_CASE("shadows are the same in every order of frames, and their map is kept", "[library][shadow]") {
  const TempFolder folder;
  check_shadows(Opened(packed(folder, "sun.glb")));
}

TEST_CASE("shadows are the same on a GPU, also if chunks are streamed", "[library][shadow][cuda]") {
  if (!has_gpu()) return;
  const TempFolder folder;
  const std::string path = packed(folder, "sun.glb");
  scree_load_options load = load_options(SCREE_BACKEND_CUDA);
  load.light = SCREE_LIGHT_SCENE;
  load.max_width = 128;
  load.max_height = 96;
  load.max_samples = 1;
  const Opened opened(path, load);
  check_shadows(opened);
  const Opened cpu(path);
  const scree_camera camera = look_at(-4, 6, 9);
  const std::string on_gpu = draw(opened.view, camera, sunny()).color, on_cpu = draw(cpu.view, camera, sunny()).color;
  CHECK(differing(on_gpu, on_cpu) <= on_gpu.size() / 10000);

  // With the least memory, which the error states, the chunks are streamed. A map takes more memory.
  const auto least = [&](uint64_t shadow_size) {
    load.max_shadow_size = shadow_size;
    load.device_memory = 1;
    scree_file* file = nullptr;
    scree_scene* scene = nullptr;
    must(scree_open(path.c_str(), &file));
    CHECK(scree_load(file, &load, &scene) == SCREE_ERROR_DEVICE);
    must(scree_close(file));
    return least_device_memory(scree_error());
  };
  const uint64_t without = least(0);
  load.device_memory = least(200);
  CHECK(load.device_memory >= without + 200 * 200 * 8);
  const Opened streamed(path, load);
  CHECK(stats_of(streamed.scene).streamed == 1);
  check_shadows(streamed);
  CHECK(draw(streamed.view, camera, sunny()).color == on_gpu);
}

TEST_CASE("a file without a sun casts no shadows", "[library][shadow]") {
  const TempFolder folder;
  std::string model = read_whole(data_path("sun.glb"));
  model = replaced(model, "\"directional\"", "\"point\"      ");
  const std::string source = folder.write("lamps.glb", model), path = folder.file("lamps.scree");
  must(scree_convert(source.c_str(), path.c_str(), nullptr, nullptr));
  const Opened opened(path);
  const scree_draw_options plain = sunny(0), options = sunny();
  draw(opened.view, plain);
  const std::string before = color_of(opened.view).color;
  CHECK(scree_draw(opened.view, nullptr, &options) == SCREE_ERROR_ARGUMENT);
  CHECK(std::string(scree_error()).find("SCREE_SHADOWS: the scene has no directional light") != std::string::npos);
  CHECK(scree_shade(opened.view, &options) == SCREE_ERROR_ARGUMENT);
  CHECK(color_of(opened.view).color == before);
}
