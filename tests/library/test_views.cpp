// Long-lived views: many frames of several sizes, with several cameras, shading options and threads.
#include <unistd.h>

#include <array>
#include <atomic>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <random>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "tests/gpu.h"
#include "tests/library/handles.h"
#include "tests/runtime/paged_scene.h"
#include "tests/sanitized.h"

using namespace scree::tests;

namespace {

scree_camera look_at(double x, double y, double z) {
  auto camera = sized<scree_camera>();
  camera.kind = SCREE_CAMERA_LOOK_AT;
  camera.eye[0] = x;
  camera.eye[1] = y;
  camera.eye[2] = z;
  camera.look_at_box = 1;
  return camera;
}

struct Shot {
  scree_camera camera;
  scree_draw_options options;
};

/// The same shots for the same seed.
std::vector<Shot> random_shots(size_t count, uint32_t seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> angle(0, 6.28), distance(1.5, 5);
  std::vector<Shot> shots;
  for (size_t i = 0; i < count; ++i) {
    const double a = angle(random), d = distance(random);
    const auto below = [&](uint32_t end) { return static_cast<uint32_t>(random() % end); };
    Shot shot{look_at(d * std::cos(a), 0.4 * d, d * std::sin(a)), draw_options(8 + below(60), 8)};
    shot.options.height += below(60);
    shot.options.samples = 1u << below(2);
    shot.options.show = static_cast<scree_show>(below(9));
    shot.options.flags = below(8);
    shot.options.background[3] = i % 2 == 0 ? 1.0f : 0.0f;
    shots.push_back(shot);
  }
  return shots;
}

uint64_t resident_bytes() {
  std::ifstream file("/proc/self/statm");
  uint64_t all = 0, resident = 0;
  file >> all >> resident;
  return resident * static_cast<uint64_t>(sysconf(_SC_PAGESIZE));
}

std::string draw(scree_view* view, const Shot& shot) {
  must(scree_draw(view, &shot.camera, &shot.options));
  return frame_of(view);
}

}  // namespace

TEST_CASE("a view draws what a fresh one draws, whatever it drew before", "[library]") {
  const TempFolder folder;
  const Opened opened(packed(folder, "two_instances.gltf"));
  for (const Shot& shot : random_shots(20, 1)) {
    scree_view* fresh = nullptr;
    must(scree_view_create(opened.scene, &fresh));
    CHECK(draw(opened.view, shot) == draw(fresh, shot));
    must(scree_view_destroy(fresh));
  }
}

TEST_CASE("statistics say how many layers the colours have", "[library]") {
  const TempFolder folder;
  const Opened opened(packed(folder, "glass.glb"));
  const auto stats = [&] {
    auto out = sized<scree_frame_stats>();
    must(scree_get_frame_stats(opened.view, &out));
    return out;
  };
  scree_draw_options options = draw_options(40, 30);
  const scree_camera camera = look_at(0, 0, 4);
  must(scree_draw(opened.view, &camera, &options));
  CHECK(stats().blended_layers == 0);  // nothing was shaded yet
  layer_of(opened.view, SCREE_COLOR);
  const scree_frame_stats single = stats();
  CHECK(single.blended_layers == 16);
  CHECK(single.samples_with_more_layers > 100);
  options.show = SCREE_SHOW_NORMAL;
  must(scree_shade(opened.view, &options));
  layer_of(opened.view, SCREE_COLOR);
  CHECK(stats().blended_layers == 0);
  CHECK(stats().samples_with_more_layers == 0);
  options.show = SCREE_SHOW_TEXTURE;
  const scree_camera cameras[] = {camera, look_at(9, 0, -0.25), camera};
  must(scree_draw_batch(opened.view, cameras, 3, &options, 1u << SCREE_COLOR));
  CHECK(stats().blended_layers == 16);
  CHECK(stats().samples_with_more_layers >= 2 * single.samples_with_more_layers);
  must(scree_draw_batch(opened.view, cameras, 3, &options, 1u << SCREE_DEPTH));
  CHECK(stats().blended_layers == 0);
}

TEST_CASE("a batch of cameras is their frames, one by one", "[library]") {
  const TempFolder folder;
  const Opened opened(packed(folder, "two_instances.gltf"));
  std::vector<scree_camera> cameras;
  for (const Shot& shot : random_shots(9, 4)) cameras.push_back(shot.camera);
  cameras.push_back(sized<scree_camera>());
  for (const uint32_t samples : {1u, 2u}) {
    const scree_draw_options options = draw_options(31, 17, samples);
    const auto count = static_cast<uint32_t>(cameras.size());
    must(scree_draw_batch(opened.view, cameras.data(), count, &options,
                          1u << SCREE_COLOR | 1u << SCREE_DEPTH | 1u << SCREE_TRIANGLE | 1u << SCREE_INSTANCE |
                              1u << SCREE_NORMAL | 1u << SCREE_UV));
    scree_view* single = nullptr;
    must(scree_view_create(opened.scene, &single));
    for (const scree_layer layer : kAllLayers) {
      if (layer == SCREE_SAMPLES) continue;
      std::string expected;
      for (const scree_camera& camera : cameras) {
        must(scree_draw(single, &camera, &options));
        expected += layer_of(single, layer);
      }
      CHECK(layer_of(opened.view, layer) == expected);
      auto array = sized<scree_array>();
      must(scree_host_layer(opened.view, layer, &array));
      CHECK(array.shape[0] == count);
      CHECK(array.shape[1] == 17);
      CHECK(array.shape[2] == 31);
    }
    must(scree_view_destroy(single));
  }
  // The next frame succeeds again.
  const scree_draw_options options = draw_options(5, 5);
  must(scree_draw(opened.view, nullptr, &options));
  CHECK(layer_of(opened.view, SCREE_SAMPLES).size() == 25 * 8);
}

TEST_CASE("buffers of a view stay where they are for frames that are no larger", "[library]") {
  const TempFolder folder;
  const Opened opened(packed(folder));
  std::array<const void*, std::size(kAllLayers)> first{};
  for (const uint32_t size : {64u, 10u, 33u, 64u, 1u}) {
    const scree_draw_options options = draw_options(size, size);
    must(scree_draw(opened.view, nullptr, &options));
    for (size_t i = 0; i < first.size(); ++i) {
      auto array = sized<scree_array>();
      must(scree_host_layer(opened.view, kAllLayers[i], &array));
      if (first[i] == nullptr) first[i] = array.data;
      CHECK(first[i] == array.data);
      CHECK(array.gpu == -1);
      CHECK(array.shape[0] == size);
      CHECK(array.shape[1] == size);
    }
  }
}

TEST_CASE("shading a frame again is drawing it so", "[library]") {
  const TempFolder folder;
  const Opened opened(packed(folder));
  scree_draw_options options = draw_options(40, 30, 2);
  must(scree_draw(opened.view, nullptr, &options));
  const std::string depth = layer_of(opened.view, SCREE_DEPTH);
  for (const scree_show show : {SCREE_SHOW_NORMAL, SCREE_SHOW_TRIANGLE, SCREE_SHOW_TEXTURE}) {
    options.show = show;
    options.flags = SCREE_EDL;
    must(scree_shade(opened.view, &options));
    const std::string shaded = layer_of(opened.view, SCREE_COLOR);
    scree_view* fresh = nullptr;
    must(scree_view_create(opened.scene, &fresh));
    must(scree_draw(fresh, nullptr, &options));
    CHECK(shaded == layer_of(fresh, SCREE_COLOR));
    must(scree_view_destroy(fresh));
  }
  CHECK(depth == layer_of(opened.view, SCREE_DEPTH));
}

TEST_CASE("threads draw views of scenes that others open and close", "[library]") {
  const TempFolder folder;
  const std::array<std::string, 2> files{packed(folder), packed(folder, "two_instances.gltf")};
  const size_t count = kIsSanitized ? 20 : 60;
  const std::vector<Shot> shots = random_shots(count, 2);
  std::array<std::vector<std::string>, 2> expected;
  for (size_t f = 0; f < 2; ++f) {
    const Opened opened(files[f]);
    for (const Shot& shot : shots) expected[f].push_back(draw(opened.view, shot));
  }
  std::atomic<size_t> wrong{0};
  const Opened shared(files[0]);
  std::vector<std::thread> threads;
  for (size_t t = 0; t < 8; ++t)
    threads.emplace_back([&, t] {
      // Without Catch's macros, which must be used by one thread.
      for (size_t i = t; i < count; i += 4) {
        const size_t f = i % 2;
        scree_file* file = nullptr;
        scree_scene* scene = nullptr;
        scree_view* view = nullptr;
        auto load = sized<scree_load_options>();
        load.backend = SCREE_BACKEND_CPU;
        load.threads = 1;
        bool good = scree_open(files[f].c_str(), &file) == SCREE_OK && scree_load(file, &load, &scene) == SCREE_OK;
        good = good && scree_view_create(f == 0 && i % 3 == 0 ? shared.scene : scene, &view) == SCREE_OK;
        // The view keeps the objects that it needs.
        good = good && scree_close(file) == SCREE_OK && scree_unload(scene) == SCREE_OK;
        good = good && scree_draw(view, &shots[i].camera, &shots[i].options) == SCREE_OK;
        std::string bytes;
        for (const scree_layer layer : kAllLayers) {
          auto array = sized<scree_array>();
          good = good && scree_host_layer(view, layer, &array) == SCREE_OK;
          if (good) bytes.append(static_cast<const char*>(array.data), array.bytes);
        }
        good = good && bytes == expected[f][i] && scree_view_destroy(view) == SCREE_OK;
        if (!good) ++wrong;
      }
    });
  for (std::thread& thread : threads) thread.join();
  CHECK(wrong == 0);
}

TEST_CASE("thousands of frames of changing cameras, sizes, samples and shadings take no more memory",
          "[library][soak]") {
  const TempFolder folder;
  const std::array<std::string, 2> files{packed(folder), packed(folder, "two_instances.gltf")};
  // SCREE_SOAK_FRAMES=10000 is the long run.
  const char* const asked = std::getenv("SCREE_SOAK_FRAMES");
  const size_t count = asked != nullptr ? std::stoul(asked) : kIsSanitized ? 200 : 2000;
  std::vector<Shot> shots = random_shots(200, 11);
  for (size_t i = 0; i < shots.size(); i += 25) shots[i].options.width = shots[i].options.height = 200;
  const Opened kept(files[1]);
  scree_view* other = nullptr;
  must(scree_view_create(kept.scene, &other));
  uint64_t settled = 0;
  for (size_t i = 0; i < count; ++i) {
    const Shot& shot = shots[i % shots.size()];
    must(scree_draw(kept.view, &shot.camera, &shot.options));
    (void)layer_of(kept.view, kAllLayers[i % std::size(kAllLayers)]);
    // A second view of the scene in turn with it, by another thread, and batches.
    std::thread thread([&] {
      const scree_draw_options options = draw_options(24, 24);
      std::vector<scree_camera> cameras(1 + i % 4, shot.camera);
      (void)scree_draw_batch(other, cameras.data(), static_cast<uint32_t>(cameras.size()), &options,
                             1u << SCREE_DEPTH | 1u << SCREE_NORMAL);
    });
    (void)frame_of(kept.view);
    thread.join();
    if (i % 20 == 0) const Opened short_lived(files[i % 2]);
    if (i == count / 3) settled = resident_bytes();
  }
  // ASan keeps what was freed, up to 256 MiB.
  const uint64_t allowed = settled + (uint64_t{kIsSanitized ? 288 : 4} << 20);
  const uint64_t last = resident_bytes();
  if (asked != nullptr) WARN(count << " frames: " << settled << " bytes after a third, " << last << " at the end");
  CHECK(last < allowed);
  must(scree_view_destroy(other));
}

TEST_CASE("two views of one scene are drawn by two threads at once", "[library]") {
  const TempFolder folder;
  const Opened opened(packed(folder, "two_instances.gltf"));
  const std::vector<Shot> shots = random_shots(kIsSanitized ? 10 : 100, 12);
  std::vector<std::string> expected;
  for (const Shot& shot : shots) expected.push_back(draw(opened.view, shot));
  scree_view* views[2] = {};
  for (scree_view*& view : views) must(scree_view_create(opened.scene, &view));
  std::atomic<size_t> wrong{0};
  std::vector<std::thread> threads;
  for (size_t t = 0; t < 2; ++t)
    threads.emplace_back([&, t] {
      for (size_t n = 0; n < shots.size(); ++n) {
        const size_t i = t == 0 ? n : shots.size() - 1 - n;
        bool good = scree_draw(views[t], &shots[i].camera, &shots[i].options) == SCREE_OK;
        std::string bytes;
        for (const scree_layer layer : kAllLayers) {
          auto array = sized<scree_array>();
          good = good && scree_host_layer(views[t], layer, &array) == SCREE_OK;
          if (good) bytes.append(static_cast<const char*>(array.data), array.bytes);
        }
        if (!good || bytes != expected[i]) ++wrong;
      }
    });
  for (std::thread& thread : threads) thread.join();
  CHECK(wrong == 0);
  for (scree_view* const view : views) must(scree_view_destroy(view));
}

TEST_CASE("a layer that is held stays when the view draws larger frames", "[library]") {
  const TempFolder folder;
  const Opened opened(packed(folder));
  scree_view* view = nullptr;
  must(scree_view_create(opened.scene, &view));
  scree_draw_options options = draw_options(16, 9);
  must(scree_draw(view, nullptr, &options));
  const std::vector<scree_layer> layers(std::begin(kAllLayers), std::end(kAllLayers));
  std::vector<scree_array> arrays(layers.size(), sized<scree_array>());
  std::vector<scree_memory*> held(layers.size(), nullptr);
  std::vector<std::string> expected;
  const auto bytes_of = [&](size_t i) {
    return std::string(static_cast<const char*>(arrays[i].data), arrays[i].bytes);
  };
  for (size_t i = 0; i < layers.size(); ++i) {
    must(scree_host_layer(view, layers[i], &arrays[i]));
    must(scree_hold(view, &arrays[i], &held[i]));
    expected.push_back(bytes_of(i));
  }
  must(scree_draw(view, nullptr, &options));  // fits: the memory is the view's still
  auto same = sized<scree_array>();
  must(scree_host_layer(view, SCREE_DEPTH, &same));
  CHECK(same.data == arrays[1].data);
  options = draw_options(640, 480);
  must(scree_draw(view, nullptr, &options));
  for (size_t i = 0; i < layers.size(); ++i) {
    auto larger = sized<scree_array>();
    must(scree_host_layer(view, layers[i], &larger));
    CHECK(larger.data != arrays[i].data);
    CHECK(bytes_of(i) == expected[i]);
    scree_memory* none = nullptr;
    CHECK(scree_hold(view, &arrays[i], &none) == SCREE_ERROR_ARGUMENT);
    CHECK(none == nullptr);
  }
  must(scree_view_destroy(view));
  for (size_t i = 0; i < layers.size(); ++i) {
    CHECK(bytes_of(i) == expected[i]);
    must(scree_release(held[i]));
    CHECK(scree_release(held[i]) == SCREE_ERROR_HANDLE);
  }
  must(scree_release(nullptr));
}

TEST_CASE("a file is closed while other threads read what it has", "[library]") {
  const TempFolder folder;
  const std::string path = packed(folder);
  std::atomic<scree_file*> current{nullptr};
  std::atomic<bool> ends{false};
  std::atomic<size_t> wrong{0};
  std::vector<std::thread> threads;
  for (size_t t = 0; t < 2; ++t)
    threads.emplace_back([&] {
      while (!ends) {
        scree_file* const file = current;
        if (file == nullptr) continue;
        auto info = sized<scree_file_info>();
        const scree_status status = scree_get_file_info(file, &info);
        if (status == SCREE_OK ? info.triangles != 12 : status != SCREE_ERROR_HANDLE) ++wrong;
      }
    });
  for (size_t i = 0; i < (kIsSanitized ? 2000 : 20000); ++i) {
    scree_file* file = nullptr;
    must(scree_open(path.c_str(), &file));
    current = file;
    must(scree_close(file));
  }
  ends = true;
  for (std::thread& thread : threads) thread.join();
  CHECK(wrong == 0);
}

TEST_CASE("a camera of matrices sees what the same camera by eye and target sees", "[library]") {
  const TempFolder folder;
  const Opened opened(packed(folder));
  auto eye = sized<scree_camera>();
  eye.kind = SCREE_CAMERA_LOOK_AT;
  eye.eye[2] = 4;
  const scree_draw_options options = draw_options(80, 40);
  must(scree_draw(opened.view, &eye, &options));
  const std::string expected = layer_of(opened.view, SCREE_TRIANGLE);
  auto matrices = sized<scree_camera>();
  matrices.kind = SCREE_CAMERA_MATRICES;
  for (int i = 0; i < 4; ++i) matrices.view[5 * i] = 1;
  matrices.view[11] = -4;
  const double half = std::tan(22.5 * 3.14159265358979323846 / 180), near = 0.1, far = 100;
  matrices.projection[0] = 1 / (2 * half);
  matrices.projection[5] = 1 / half;
  matrices.projection[10] = (far + near) / (near - far);
  matrices.projection[11] = 2 * far * near / (near - far);
  matrices.projection[14] = -1;
  must(scree_draw(opened.view, &matrices, &options));
  CHECK(layer_of(opened.view, SCREE_TRIANGLE) == expected);
  auto pick = sized<scree_pick_info>();
  must(scree_pick(opened.view, 40, 20, &pick));
  REQUIRE(pick.hit == 1);
  CHECK(pick.position[2] == Approx(4 - pick.depth));
  CHECK(std::abs(pick.position[0]) < 0.1);

  // Orthographic, 4 units high.
  auto flat = matrices;
  std::fill(std::begin(flat.projection), std::end(flat.projection), 0.0);
  flat.projection[0] = 0.25;
  flat.projection[5] = 0.5;
  flat.projection[10] = -2 / (far - near);
  flat.projection[11] = -(far + near) / (far - near);
  flat.projection[15] = 1;
  must(scree_draw(opened.view, &flat, &options));
  must(scree_pick(opened.view, 40, 20, &pick));
  REQUIRE(pick.hit == 1);
  CHECK(pick.position[2] == Approx(4 - pick.depth).margin(1e-4));
}

TEST_CASE("progress is told, and a call that is stopped leaves nothing", "[library]") {
  struct Heard {
    uint64_t calls = 0;
    uint64_t stop_at = ~uint64_t{0};
    std::string stages;
    static int hear(void* user, const char* stage, uint64_t done, uint64_t total) {
      auto& heard = *static_cast<Heard*>(user);
      if (heard.stages.find(stage) == std::string::npos) heard.stages += std::string(stage) + ";";
      if (done > total) return 1;
      return ++heard.calls > heard.stop_at ? 1 : 0;
    }
  };
  const TempFolder folder;
  Heard heard;
  auto convert = sized<scree_convert_options>();
  convert.progress = Heard::hear;
  convert.user = &heard;
  const std::string output = folder.file("out.scree");
  auto report = sized<scree_convert_report>();
  must(scree_convert(data_path("textured_cube.glb").c_str(), output.c_str(), &convert, &report));
  CHECK(heard.calls > 0);
  CHECK(report.triangles == 12);
  CHECK(report.output_bytes == std::filesystem::file_size(output));

  Heard stopped{0, 0, {}};
  convert.user = &stopped;
  const std::string none = folder.file("none.scree");
  CHECK(scree_convert(data_path("textured_cube.glb").c_str(), none.c_str(), &convert, nullptr) ==
        SCREE_ERROR_CANCELLED);
  CHECK_FALSE(std::filesystem::exists(none));

  scree_file* file = nullptr;
  must(scree_open(output.c_str(), &file));
  auto load = sized<scree_load_options>();
  load.backend = SCREE_BACKEND_CPU;
  load.progress = Heard::hear;
  heard = {};
  load.user = &heard;
  scree_scene* scene = nullptr;
  must(scree_load(file, &load, &scene));
  CHECK(heard.stages == "geometry;textures;");
  must(scree_unload(scene));
  stopped = {0, 0, {}};
  load.user = &stopped;
  scene = nullptr;
  CHECK(scree_load(file, &load, &scene) == SCREE_ERROR_CANCELLED);
  CHECK(scene == nullptr);
  CHECK(std::string(scree_error()).find("interrupted") != std::string::npos);
  must(scree_close(file));
}

TEST_CASE("records of a file", "[library]") {
  const TempFolder folder;
  const Opened opened(packed(folder, "nodes.gltf"));
  auto file = sized<scree_file_info>();
  must(scree_get_file_info(opened.file, &file));
  REQUIRE(file.scenes >= 1);
  REQUIRE(file.meshes >= 1);
  uint64_t triangles = 0;
  for (uint32_t i = 0; i < file.meshes; ++i) {
    auto mesh = sized<scree_mesh_info>();
    must(scree_get_mesh_info(opened.file, i, &mesh));
    triangles += mesh.triangles;
    CHECK(mesh.box_min[0] <= mesh.box_max[0]);
    CHECK(mesh.name != nullptr);
  }
  CHECK(triangles == file.triangles);
  auto scene = sized<scree_scene_info>();
  must(scree_get_scene_info(opened.file, file.default_scene, &scene));
  auto stats = sized<scree_scene_stats>();
  must(scree_get_scene_stats(opened.scene, &stats));
  CHECK(stats.triangles == scene.triangles);
  CHECK(stats.instances == scene.instances);
  CHECK(stats.on_gpu == 0);
  CHECK(std::string(stats.gpu_name) == "");
  CHECK(std::string(stats.why_cpu) == "");
  scree_scene* anywhere = nullptr;
  must(scree_load(opened.file, nullptr, &anywhere));
  must(scree_get_scene_stats(anywhere, &stats));
  CHECK((stats.on_gpu == 1) == std::string(stats.why_cpu).empty());
  must(scree_unload(anywhere));
  for (uint32_t i = 0; i < scene.cameras; ++i) {
    auto camera = sized<scree_camera_info>();
    must(scree_get_camera_info(opened.file, file.default_scene, i, &camera));
    const std::string number = std::to_string(camera.camera);
    auto named = sized<scree_camera>();
    named.kind = SCREE_CAMERA_NAMED;
    named.name = number.c_str();
    const scree_draw_options options = draw_options(20, 20);
    must(scree_draw(opened.view, &named, &options));
  }
}

TEST_CASE("a GPU's layers are the CPU's, on the host and on the device", "[library][cuda]") {
  if (!has_gpu()) return;
  const TempFolder folder;
  for (const char* const model : {"textured_cube.glb", "two_instances.gltf"}) {
    const std::string path = packed(folder, model, SCREE_CONVERT_NORMALS);
    const Opened cpu(path), gpu(path, SCREE_BACKEND_CUDA);
    scree_view* second = nullptr;
    must(scree_view_create(gpu.scene, &second));
    auto stats = sized<scree_scene_stats>();
    must(scree_get_scene_stats(gpu.scene, &stats));
    CHECK(stats.on_gpu == 1);
    CHECK(stats.device_bytes > 0);
    for (Shot shot : random_shots(kEmulatesGpu ? 4 : 40, 3)) {
      must(scree_draw(cpu.view, &shot.camera, &shot.options));
      for (scree_view* const view : {gpu.view, second}) {
        must(scree_draw(view, &shot.camera, &shot.options));
        for (const scree_layer layer : kAllLayers) {
          if (layer == SCREE_COLOR) continue;
          INFO("layer " << layer);
          const std::string expected = layer_of(cpu.view, layer);
          auto array = sized<scree_array>();
          must(scree_device_layer(view, layer, nullptr, &array));
          CHECK(array.gpu == 0);
          CHECK(array.bytes == expected.size());
          CHECK(layer_of(view, layer) == expected);
        }
        const std::string a = layer_of(cpu.view, SCREE_COLOR), b = layer_of(view, SCREE_COLOR);
        REQUIRE(a.size() == b.size());
        size_t differing = 0;
        for (size_t i = 0; i < a.size(); ++i)
          differing += std::abs(static_cast<uint8_t>(a[i]) - static_cast<uint8_t>(b[i])) > 1 ? 1 : 0;
        CHECK(differing <= a.size() / 1000);
        auto on_cpu = sized<scree_pick_info>(), on_gpu = on_cpu;
        must(scree_pick(cpu.view, shot.options.width / 2, shot.options.height / 2, &on_cpu));
        must(scree_pick(view, shot.options.width / 2, shot.options.height / 2, &on_gpu));
        CHECK(on_cpu.hit == on_gpu.hit);
        CHECK(on_cpu.triangle == on_gpu.triangle);
        CHECK(on_cpu.depth == on_gpu.depth);
      }
    }
    // A batch, whose pictures take turns with two draw lists, is the frames one by one: layers as the CPU has them,
    // colours as the GPU.
    std::vector<scree_camera> cameras;
    for (const Shot& shot : random_shots(5, 5)) cameras.push_back(shot.camera);
    const scree_draw_options options = draw_options(20, 10, 2);
    constexpr uint32_t kMade = 0x7f & ~(1u << SCREE_SAMPLES);
    // Of these four pictures or more are drawn at once.
    constexpr uint32_t kIds = 1u << SCREE_DEPTH | 1u << SCREE_TRIANGLE | 1u << SCREE_INSTANCE;
    must(scree_draw_batch(cpu.view, cameras.data(), 5, &options, kMade));
    for (const auto& [count, made] :
         {std::pair{5u, kMade}, {2u, kMade}, {1u, kMade}, {5u, kIds}, {3u, kIds}, {1u, kIds}, {5u, kMade}}) {
      must(scree_draw_batch(second, cameras.data(), count, &options, made));
      auto refused = sized<scree_array>();
      if (made == kIds) CHECK(scree_host_layer(second, SCREE_NORMAL, &refused) == SCREE_ERROR_ARGUMENT);
      CHECK(scree_draw_batch(second, cameras.data(), 0, &options, made) == SCREE_ERROR_ARGUMENT);
      must(scree_draw_batch(second, cameras.data(), count, &options, made));
      for (const scree_layer layer : kAllLayers) {
        if ((made >> layer & 1) == 0) continue;
        INFO("layer " << layer << ", " << count << " cameras");
        auto array = sized<scree_array>();
        must(scree_device_layer(second, layer, nullptr, &array));
        CHECK(array.gpu == 0);
        CHECK(array.shape[0] == count);
        std::string expected;
        for (uint32_t i = 0; i < count; ++i) {
          must(scree_draw(gpu.view, &cameras[i], &options));
          expected += layer_of(gpu.view, layer);
        }
        CHECK(array.bytes == expected.size());
        CHECK(layer_of(second, layer) == expected);
        if (layer != SCREE_COLOR && count == 5) CHECK(layer_of(cpu.view, layer) == expected);
      }
    }
    must(scree_draw(second, &cameras[1], &options));  // with the list of the second picture
    must(scree_draw(gpu.view, &cameras[1], &options));
    CHECK(frame_of(second) == frame_of(gpu.view));
    must(scree_view_destroy(second));
  }
}

TEST_CASE("views of a scene that the GPU's memory does not hold", "[library][cuda]") {
  if (!has_gpu()) return;
  const TempFolder folder;
  const std::string path = folder.file("clouds.scree");
  std::mt19937 random(7);
  std::uniform_real_distribution<double> unit(-1, 1);
  std::vector<std::pair<Soup, Encoding>> meshes;
  for (int m = 0; m < 24; ++m) {  // more than streaming itself takes
    Soup cloud;
    const double middle[3] = {unit(random), unit(random), unit(random)};
    for (int i = 0; i < 1500; ++i) {
      uint32_t corner[3];
      for (uint32_t& c : corner)
        c = cloud.add(middle[0] + 0.3 * unit(random), middle[1] + 0.3 * unit(random), middle[2] + 0.3 * unit(random));
      cloud.triangle(corner[0], corner[1], corner[2]);
    }
    meshes.emplace_back(cloud, float32());
  }
  PagedScene paged;
  paged.chunk_triangles = 1500;  // few parts per frame
  paged.write(path, meshes);
  scree_file* file = nullptr;
  must(scree_open(path.c_str(), &file));
  auto load = sized<scree_load_options>();
  load.backend = SCREE_BACKEND_CUDA;
  load.threads = 2;
  load.device_memory = 1;
  load.max_width = load.max_height = 64;
  load.max_samples = 1;
  scree_scene* scene = nullptr;
  REQUIRE(scree_load(file, &load, &scene) == SCREE_ERROR_DEVICE);
  load.device_memory = least_device_memory(scree_error());
  must(scree_load(file, &load, &scene));
  auto stats = sized<scree_scene_stats>();
  must(scree_get_scene_stats(scene, &stats));
  CHECK(stats.streamed == 1);
  const Opened cpu(path);
  scree_view* views[2] = {};
  for (scree_view*& view : views) must(scree_view_create(scene, &view));
  for (const Shot& shot : random_shots(kEmulatesGpu ? 1 : 30, 6)) {
    must(scree_draw(cpu.view, &shot.camera, &shot.options));
    for (scree_view* const view : views) must(scree_draw(view, &shot.camera, &shot.options));
    for (scree_view* const view : views) {
      for (const scree_layer layer : {SCREE_DEPTH, SCREE_TRIANGLE, SCREE_INSTANCE, SCREE_SAMPLES})
        CHECK(layer_of(view, layer) == layer_of(cpu.view, layer));
      CHECK(layer_of(view, SCREE_COLOR) == layer_of(views[0], SCREE_COLOR));
      auto array = sized<scree_array>();
      CHECK(scree_host_layer(view, SCREE_NORMAL, &array) == SCREE_ERROR_ARGUMENT);
      CHECK(scree_shade(view, &shot.options) == SCREE_ERROR_ARGUMENT);
    }
  }
  for (scree_view* const view : views) must(scree_view_destroy(view));
  must(scree_unload(scene));
  must(scree_close(file));
}
