// Long-lived views: many frames of several sizes, with several cameras and shading options.
#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "tests/gpu.h"
#include "tests/library/handles.h"
#include "tests/library/shots.h"
#include "tests/runtime/paged_scene.h"

using namespace scree::tests;

namespace {

std::string draw(scree_view* view, const Shot& shot) {
  must(scree_draw(view, &shot.camera, &shot.options));
  return frame_of(view);
}

}  // namespace

TEST_CASE("a view draws the same as a new view, regardless of earlier frames", "[library]") {
  const TempFolder folder;
  const Opened opened(packed(folder, "two_instances.gltf"));
  for (const Shot& shot : random_shots(20, 1)) {
    scree_view* fresh = nullptr;
    must(scree_view_create(opened.scene, &fresh));
    CHECK(draw(opened.view, shot) == draw(fresh, shot));
    must(scree_view_destroy(fresh));
  }
}

TEST_CASE("statistics give the number of layers of the colours", "[library]") {
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

TEST_CASE("a batch of cameras equals their single frames", "[library]") {
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
      if (layer == SCREE_SAMPLES || layer == SCREE_LINEAR) continue;
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
  // The next frame succeeds.
  const scree_draw_options options = draw_options(5, 5);
  must(scree_draw(opened.view, nullptr, &options));
  CHECK(layer_of(opened.view, SCREE_SAMPLES).size() == 25 * 8);
}

TEST_CASE("a batch in the caller's memory equals the same batch in the view's", "[library]") {
  const TempFolder folder;
  const Opened opened(packed(folder, "two_instances.gltf"));
  std::vector<scree_camera> cameras;
  for (const Shot& shot : random_shots(5, 6)) cameras.push_back(shot.camera);
  const scree_draw_options options = draw_options(31, 17, 2);
  must(scree_draw_batch(opened.view, cameras.data(), 5, &options, 0x7f & ~(1u << SCREE_SAMPLES)));
  std::vector<std::vector<uint64_t>> blocks;  // one word longer than the layer
  std::vector<scree_target> targets;
  std::vector<std::string> expected;
  for (const scree_layer layer : kAllLayers) {
    if (layer == SCREE_SAMPLES || layer == SCREE_LINEAR) continue;
    expected.push_back(layer_of(opened.view, layer));
    blocks.emplace_back(expected.back().size() / 8 + 2, 0x5555555555555555u);
    auto target = sized<scree_target>();
    target.data = blocks.back().data();
    target.bytes = expected.back().size();
    target.layer = layer;
    targets.push_back(target);
  }
  scree_view* other = nullptr;
  must(scree_view_create(opened.scene, &other));
  for (const uint32_t count : {static_cast<uint32_t>(targets.size()), 1u}) {
    must(scree_draw_batch_to(other, cameras.data(), 5, &options, targets.data(), count, nullptr));
    for (uint32_t i = 0; i < count; ++i) {
      const auto* const bytes = reinterpret_cast<const char*>(blocks[i].data());
      CHECK(std::string(bytes, expected[i].size()) == expected[i]);
      for (size_t k = expected[i].size(); k < 8 * blocks[i].size(); ++k) CHECK(bytes[k] == 0x55);
      std::fill(blocks[i].begin(), blocks[i].end(), 0x5555555555555555u);
    }
  }
  // Later the view uses none of this memory, and its own layers are unchanged.
  auto array = sized<scree_array>();
  CHECK(scree_host_layer(other, SCREE_DEPTH, &array) == SCREE_ERROR_ARGUMENT);
  must(scree_draw_batch(other, cameras.data(), 5, &options, 1u << SCREE_DEPTH));
  CHECK(layer_of(other, SCREE_DEPTH) == layer_of(opened.view, SCREE_DEPTH));
  must(scree_view_destroy(other));
}

namespace {

/// Cameras around the two instances. Each except the last has a box of its own.
std::vector<scree_camera> clipped_cameras() {
  std::vector<scree_camera> cameras;
  for (const Shot& shot : random_shots(7, 8)) cameras.push_back(shot.camera);
  for (size_t c = 0; c + 1 < cameras.size(); ++c) {
    cameras[c].clips = 1;
    for (int i = 0; i < 3; ++i) {
      cameras[c].clip_min[i] = -1 + 0.1 * static_cast<double>(c);
      cameras[c].clip_max[i] = 0.2 + 0.3 * static_cast<double>(c);
    }
  }
  return cameras;
}

constexpr uint32_t kIdLayers = 1u << SCREE_DEPTH | 1u << SCREE_TRIANGLE | 1u << SCREE_INSTANCE;

/// Checks that a batch of cameras with boxes has the bits of the frames that `single` draws one by one.
void check_clipped_batch(scree_view* batch, scree_view* single, uint32_t layers) {
  const std::vector<scree_camera> cameras = clipped_cameras();
  const scree_draw_options options = draw_options(31, 17, 2);
  must(scree_draw_batch(batch, cameras.data(), static_cast<uint32_t>(cameras.size()), &options, layers));
  for (const scree_layer layer : kAllLayers) {
    if ((layers >> layer & 1) == 0) continue;
    INFO("layer " << layer);
    std::string expected;
    for (const scree_camera& camera : cameras) {
      must(scree_draw(single, &camera, &options));
      expected += layer_of(single, layer);
    }
    CHECK(layer_of(batch, layer) == expected);
  }
}

}  // namespace

TEST_CASE("a clipping box cuts the scene, for each camera of a batch", "[library]") {
  const TempFolder folder;
  const Opened opened(packed(folder, "two_instances.gltf"));
  auto stats = sized<scree_scene_stats>();
  must(scree_get_scene_stats(opened.scene, &stats));
  const scree_draw_options options = draw_options(60, 40);
  scree_camera camera = look_at(4, 3, 5);
  const auto drawn = [&] {
    must(scree_draw(opened.view, &camera, &options));
    return frame_of(opened.view);
  };
  const std::string whole = drawn();
  camera.clips = 1;
  for (int i = 0; i < 3; ++i) {
    camera.clip_min[i] = stats.box_min[i] - 1;
    camera.clip_max[i] = stats.box_max[i] + 1;
  }
  CHECK((drawn() == whole));
  camera.clip_max[0] = (stats.box_min[0] + stats.box_max[0]) / 2;
  const std::string half = drawn();
  CHECK((half != whole));
  // Each remaining pixel lies in the box, to the precision of its depth.
  size_t left = 0;
  for (uint32_t y = 0; y < 40; ++y)
    for (uint32_t x = 0; x < 60; ++x) {
      auto pick = sized<scree_pick_info>();
      must(scree_pick(opened.view, x, y, &pick));
      if (pick.hit == 0) continue;
      ++left;
      for (int i = 0; i < 3; ++i) {
        CHECK(pick.position[i] >= camera.clip_min[i] - 1e-5);
        CHECK(pick.position[i] <= camera.clip_max[i] + 1e-5);
      }
    }
  CHECK(left > 20);
  camera.size = offsetof(scree_camera, clips);  // an older program has no such field
  CHECK((drawn() == whole));
  camera.size = sizeof camera;
  CHECK((drawn() == half));
  camera.clips = 0;
  CHECK((drawn() == whole));
  scree_view* single = nullptr;
  must(scree_view_create(opened.scene, &single));
  check_clipped_batch(opened.view, single, 0x7f & ~(1u << SCREE_SAMPLES));
  must(scree_view_destroy(single));
}

TEST_CASE("a clipping box cuts the scene on a GPU as on the CPU, in frames and in batches", "[library][cuda]") {
  if (!has_gpu()) return;
  const TempFolder folder;
  for (const uint32_t flags : {0u, uint32_t{SCREE_CONVERT_INDEXED}}) {
    const std::string path = packed(folder, "two_instances.gltf", flags);
    const Opened cpu(path), gpu(path, SCREE_BACKEND_CUDA);
    for (const scree_camera& camera : clipped_cameras()) {
      const scree_draw_options options = draw_options(40, 30, 2);
      must(scree_draw(cpu.view, &camera, &options));
      must(scree_draw(gpu.view, &camera, &options));
      for (const scree_layer layer : {SCREE_SAMPLES, SCREE_DEPTH, SCREE_TRIANGLE, SCREE_INSTANCE, SCREE_NORMAL})
        CHECK(layer_of(gpu.view, layer) == layer_of(cpu.view, layer));
    }
    check_clipped_batch(gpu.view, cpu.view, kIdLayers);
  }
}

TEST_CASE("a view's buffers keep their addresses for frames that are no larger", "[library]") {
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

TEST_CASE("shading a frame again gives the picture of drawing it with these options", "[library]") {
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

TEST_CASE("a layer that is held stays valid when the view draws larger frames", "[library]") {
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
  must(scree_draw(view, nullptr, &options));  // fits into the memory that the view has left
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

TEST_CASE("a camera of matrices and the same camera by eye and target draw the same picture", "[library]") {
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

TEST_CASE("progress is reported, and a stopped call leaves nothing behind", "[library]") {
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

TEST_CASE("records of a file are returned", "[library]") {
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

TEST_CASE("a GPU's layers equal the CPU's, on the host and on the device", "[library][cuda]") {
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
          if (layer == SCREE_COLOR || layer == SCREE_LINEAR) continue;
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
        const auto linear = values_of<float>(layer_of(cpu.view, SCREE_LINEAR));
        const auto linear_on_gpu = values_of<float>(layer_of(view, SCREE_LINEAR));
        REQUIRE(linear.size() == linear_on_gpu.size());
        differing = 0;
        for (size_t i = 0; i < linear.size(); ++i) differing += std::abs(linear[i] - linear_on_gpu[i]) > 0.01f ? 1 : 0;
        CHECK(differing <= linear.size() / 1000);
        auto none = sized<scree_array>();
        CHECK(scree_device_layer(view, SCREE_LINEAR, nullptr, &none) == SCREE_ERROR_ARGUMENT);
        auto on_cpu = sized<scree_pick_info>(), on_gpu = on_cpu;
        must(scree_pick(cpu.view, shot.options.width / 2, shot.options.height / 2, &on_cpu));
        must(scree_pick(view, shot.options.width / 2, shot.options.height / 2, &on_gpu));
        CHECK(on_cpu.hit == on_gpu.hit);
        CHECK(on_cpu.triangle == on_gpu.triangle);
        CHECK(on_cpu.depth == on_gpu.depth);
      }
    }
    // A batch's pictures alternate between two draw lists. It must equal the single frames: layers of the CPU, colours
    // of the GPU.
    std::vector<scree_camera> cameras;
    for (const Shot& shot : random_shots(5, 5)) cameras.push_back(shot.camera);
    const scree_draw_options options = draw_options(20, 10, 2);
    constexpr uint32_t kMade = 0x7f & ~(1u << SCREE_SAMPLES);
    // Batches of four or more of these pictures are drawn together.
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
        // The memory of another view's layer serves as the caller's memory.
        must(scree_draw_batch(gpu.view, cameras.data(), count, &options, made));
        auto place = sized<scree_array>();
        must(scree_device_layer(gpu.view, layer, nullptr, &place));
        auto target = sized<scree_target>();
        target.data = const_cast<void*>(place.data);
        target.bytes = place.bytes;
        target.layer = layer;
        std::vector<scree_camera> turned(cameras.rbegin(), cameras.rend());
        turned.resize(count);
        must(scree_draw_batch(second, turned.data(), count, &options, 1u << layer));
        const std::string wanted = layer_of(second, layer);
        scree_view* third = nullptr;
        must(scree_view_create(gpu.scene, &third));
        must(scree_draw_batch_to(third, turned.data(), count, &options, &target, 1, nullptr));
        CHECK(layer_of(gpu.view, layer) == wanted);
        target.bytes -= 1;
        CHECK(scree_draw_batch_to(third, turned.data(), count, &options, &target, 1, nullptr) == SCREE_ERROR_BUFFER);
        must(scree_view_destroy(third));
        must(scree_draw_batch(second, cameras.data(), count, &options, made));
      }
    }
    must(scree_draw(second, &cameras[1], &options));  // with the list of the second picture
    must(scree_draw(gpu.view, &cameras[1], &options));
    CHECK(frame_of(second) == frame_of(gpu.view));
    must(scree_view_destroy(second));
  }
}

TEST_CASE("views of a scene larger than the GPU's memory draw the same as on the CPU", "[library][cuda]") {
  if (!has_gpu()) return;
  const TempFolder folder;
  const std::string path = folder.file("clouds.scree");
  std::mt19937 random(7);
  std::uniform_real_distribution<double> unit(-1, 1);
  std::vector<std::pair<Soup, Encoding>> meshes;
  for (int m = 0; m < 24; ++m) {  // more than streaming takes
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
  const PagedScene paged{.chunk_triangles = 1500};  // few parts per frame
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
      CHECK(scree_host_layer(view, SCREE_LINEAR, &array) == SCREE_ERROR_ARGUMENT);
      CHECK(scree_shade(view, &shot.options) == SCREE_ERROR_ARGUMENT);
    }
  }
  for (scree_view* const view : views) must(scree_view_destroy(view));
  must(scree_unload(scene));
  must(scree_close(file));
}
