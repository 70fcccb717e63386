// Cameras and options with numbers at the limits of their ranges either work or are refused.
#include <algorithm>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "tests/gpu.h"
#include "tests/library/misuse.h"
#include "tests/library/shots.h"

using namespace scree::tests;

namespace {

/// Checks that cameras with extreme numbers draw or are refused.
void check_far_cameras(scree_backend backend) {
  const TempFolder folder;
  const Opened opened(packed(folder), backend);
  const double numbers[] = {1e-320, 1e-300, 1e-30, 1e15, 1e150, 1e300, kHuge};
  std::vector<scree_camera> cameras;
  for (const double number : numbers) {
    for (const double sign : {1.0, -1.0}) {
      scree_camera camera = look_at(3, 2, 4);
      camera.eye[0] = sign * number;
      cameras.push_back(camera);
      camera.look_at_box = 0;
      camera.target[0] = camera.target[1] = -sign * number;
      cameras.push_back(camera);
      camera = look_at(3, 2, 4);
      camera.up[0] = sign * number;
      camera.up[1] = number;
      cameras.push_back(camera);
      camera = sized<scree_camera>();
      camera.kind = SCREE_CAMERA_AROUND;
      camera.turn_degrees = sign * number;
      camera.rise_degrees = sign * std::min(number, 90.0);
      camera.fov_degrees = std::min(number, 179.99999999);
      cameras.push_back(camera);
      camera = sized<scree_camera>();
      camera.kind = SCREE_CAMERA_MATRICES;
      for (int i = 0; i < 4; ++i) camera.view[5 * i] = 1;
      camera.view[3] = sign * number;
      camera.view[11] = -4;
      camera.projection[0] = camera.projection[5] = 1;
      camera.projection[10] = -1;
      camera.projection[11] = -0.2;
      camera.projection[14] = -1;
      cameras.push_back(camera);
      camera.view[3] = 0;
      camera.projection[0] = camera.projection[5] = number;
      cameras.push_back(camera);
      camera.projection[0] = camera.projection[5] = 1;
      camera.z_near = number;
      cameras.push_back(camera);
      camera = look_at(3, 2, 4);
      camera.clips = 1;
      for (int i = 0; i < 3; ++i) {
        camera.clip_min[i] = sign < 0 ? -number : 0;
        camera.clip_max[i] = number;
      }
      cameras.push_back(camera);
    }
  }
  const scree_draw_options options = draw_options(9, 6, 2);
  size_t drawn = 0;
  for (const scree_camera& camera : cameras) {
    INFO("camera " << (&camera - cameras.data()));
    const scree_status status = scree_draw(opened.view, &camera, &options);
    INFO(scree_error());
    CHECK((status == SCREE_OK || status == SCREE_ERROR_ARGUMENT));
    if (status != SCREE_OK) continue;
    frame_of(opened.view);
    ++drawn;
    must(scree_draw_batch(opened.view, std::vector<scree_camera>(4, camera).data(), 4, &options, 1u << SCREE_DEPTH));
  }
  CHECK(drawn > cameras.size() / 2);
}

/// Whether the call succeeded. Otherwise checks that it has an error text.
bool works(scree_status status) {
  if (status == SCREE_OK) return true;
  INFO(scree_status_name(status) << ": " << scree_error());
  CHECK((status == SCREE_ERROR_ARGUMENT || status == SCREE_ERROR_DEVICE || status == SCREE_ERROR_MEMORY));
  CHECK_FALSE(std::string(scree_error()).empty());
  return false;
}

void check_extreme_loads(scree_backend backend) {
  const TempFolder folder;
  const std::string path = packed(folder);
  using Load = scree_load_options;
  const scree_draw_options options = draw_options(9, 6, 2);
  const Opened expected(path, backend);
  must(scree_draw(expected.view, nullptr, &options));
  size_t loaded = 0;
  for (const auto field : {&Load::device_memory, &Load::host_memory, &Load::texture_cache, &Load::texture_memory}) {
    for (const uint64_t bytes : {uint64_t{1}, uint64_t{4096}, uint64_t{1} << 40, uint64_t{1} << 63, UINT64_MAX}) {
      INFO("bytes " << bytes);
      Load load = load_options(backend);
      load.*field = bytes;
      load.max_width = load.max_height = 4096;
      load.max_samples = 4;
      scree_scene* scene = nullptr;
      if (!works(scree_load(expected.file, &load, &scene))) continue;
      {
        const NewView view(scene);
        if (works(scree_draw(view, nullptr, &options))) {
          ++loaded;
          CHECK((layer_of(view, SCREE_SAMPLES) == layer_of(expected.view, SCREE_SAMPLES)));
          CHECK((layer_of(view, SCREE_COLOR) == layer_of(expected.view, SCREE_COLOR)));
        }
      }
      must(scree_unload(scene));
    }
  }
  CHECK(loaded >= 10);
}

}  // namespace

TEST_CASE("cameras with extreme numbers draw, or are refused", "[library][misuse]") {
  check_far_cameras(SCREE_BACKEND_CPU);
}

TEST_CASE("cameras with extreme numbers draw on a GPU, or are refused", "[library][misuse][cuda]") {
  if (!has_gpu()) return;
  check_far_cameras(SCREE_BACKEND_CUDA);
}

TEST_CASE("loading with extreme limits of memory works, or is refused", "[library][misuse]") {
  check_extreme_loads(SCREE_BACKEND_CPU);
}

TEST_CASE("loading on a GPU with extreme limits of memory works, or is refused", "[library][misuse][cuda]") {
  if (!has_gpu()) return;
  check_extreme_loads(SCREE_BACKEND_CUDA);
}

TEST_CASE("pictures with extreme numbers are drawn", "[library][misuse]") {
  const TempFolder folder;
  const Opened opened(packed(folder, "glass.glb"));
  using Draw = scree_draw_options;
  const float largest = std::numeric_limits<float>::max();
  const std::function<void(Draw&)> changes[] = {
      [](Draw& d) { d.exposure = 20; },
      [](Draw& d) { d.exposure = -20; },
      [](Draw& d) { d.blend_layers = 65535; },
      [](Draw& d) { d.flags = SCREE_EDL, d.edl_strength = 100, d.edl_radius = 64; },
      [](Draw& d) { d.flags = SCREE_SSAO, d.samples = 4; },
      [=](Draw& d) { std::fill_n(d.background, 4, largest); },
      [=](Draw& d) { std::fill_n(d.background, 4, -largest); },
      [](Draw& d) { d.width = 16384, d.height = 1; },
      [](Draw& d) { d.width = 1, d.height = 4096, d.samples = 4; }};
  for (const auto& change : changes) {
    scree_draw_options options = draw_options(9, 6);
    change(options);
    must(scree_draw(opened.view, nullptr, &options));
    const std::string frame = frame_of(opened.view);
    CHECK(frame.size() == uint64_t{options.width} * options.height * (56 + 8 * options.samples * options.samples));
    must(scree_shade(opened.view, &options));
    CHECK((frame_of(opened.view) == frame));
  }
}

TEST_CASE("conversions with extreme numbers work, or are refused", "[library][misuse]") {
  const TempFolder folder;
  using Convert = scree_convert_options;
  const std::string output = folder.file("out.scree");
  const std::function<void(Convert&)> changes[] = {
      [](Convert& c) { c.max_error = 1e-300; },
      [](Convert& c) { c.max_error = kHuge; },
      [](Convert& c) { c.memory = UINT64_MAX; },
      [](Convert& c) { c.memory = 1; },
      [](Convert& c) { c.threads = 4096; },
      [](Convert& c) { c.zstd_level = 22; },
      [](Convert& c) { c.jpeg_quality = 1, c.textures = SCREE_TEXTURES_JPEG; }};
  size_t done = 0;
  for (const auto& change : changes) {
    auto options = sized<Convert>();
    options.threads = 2;
    options.flags = SCREE_CONVERT_REPLACE;
    change(options);
    if (!works(scree_convert(data_path("textured_cube.glb").c_str(), output.c_str(), &options, nullptr))) continue;
    ++done;
    draw(Opened(output).view, draw_options(9, 6));
  }
  CHECK(done >= 4);
}
