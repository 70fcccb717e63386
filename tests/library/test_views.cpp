// Long-lived views: many frames of several sizes, with several cameras and shading options.
#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "tests/gpu.h"
#include "tests/library/shots.h"
#include "tests/runtime/paged_scene.h"
#include "tests/runtime/soup.h"

using namespace scree::tests;

namespace {

std::string frame_of(scree_view* view, const Shot& shot) {
  draw(view, shot.options, &shot.camera);
  return scree::tests::frame_of(view);
}

/// A layer of the frames that `view` draws one by one.
std::string single_frames(scree_view* view, std::span<const scree_camera> cameras, const scree_draw_options& options,
                          scree_layer layer) {
  std::string bytes;
  for (const scree_camera& camera : cameras) {
    draw(view, options, &camera);
    bytes += layer_of(view, layer);
  }
  return bytes;
}

/// Checks that a batch has the bits of the frames that `single` draws one by one.
void check_batch(scree_view* batch, scree_view* single, const std::vector<scree_camera>& cameras,
                 const scree_draw_options& options, uint32_t layers) {
  must(scree_draw_batch(batch, cameras.data(), static_cast<uint32_t>(cameras.size()), &options, layers));
  for (const scree_layer layer : kAllLayers) {
    if ((layers >> layer & 1) == 0) continue;
    INFO("layer " << layer);
    CHECK(layer_of(batch, layer) == single_frames(single, cameras, options, layer));
  }
}

}  // namespace

TEST_CASE("a view draws the same as a new view, regardless of earlier frames", "[library]") {
  const TempFolder folder;
  const Opened opened(packed(folder, "two_instances.gltf"));
  for (const Shot& shot : random_shots(20, 1)) {
    const NewView fresh(opened.scene);
    CHECK(frame_of(opened.view, shot) == frame_of(fresh, shot));
  }
}

TEST_CASE("statistics give the number of layers of the colours", "[library]") {
  const TempFolder folder;
  const Opened opened(packed(folder, "glass.glb"));
  const auto stats = [&] { return frame_stats_of(opened.view); };
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
  std::vector<scree_camera> cameras = random_cameras(9, 4);
  cameras.push_back(sized<scree_camera>());
  for (const uint32_t samples : {1u, 2u}) {
    check_batch(opened.view, NewView(opened.scene), cameras, draw_options(31, 17, samples), kPixelLayers);
    for (const scree_layer layer : kAllLayers) {
      if (layer == SCREE_SAMPLES || layer == SCREE_LINEAR) continue;
      const scree_array array = host_layer(opened.view, layer);
      CHECK(array.shape[0] == static_cast<int64_t>(cameras.size()));
      CHECK(array.shape[1] == 17);
      CHECK(array.shape[2] == 31);
    }
  }
  // The next frame succeeds.
  draw(opened.view, draw_options(5, 5));
  CHECK(layer_of(opened.view, SCREE_SAMPLES).size() == 25 * 8);
}

TEST_CASE("a batch in the caller's memory equals the same batch in the view's", "[library]") {
  const TempFolder folder;
  const Opened opened(packed(folder, "two_instances.gltf"));
  const std::vector<scree_camera> cameras = random_cameras(5, 6);
  const scree_draw_options options = draw_options(31, 17, 2);
  must(scree_draw_batch(opened.view, cameras.data(), 5, &options, kPixelLayers));
  std::vector<std::vector<uint64_t>> blocks;  // one word longer than the layer
  std::vector<scree_target> targets;
  std::vector<std::string> expected;
  for (const scree_layer layer : kAllLayers) {
    if (layer == SCREE_SAMPLES || layer == SCREE_LINEAR) continue;
    expected.push_back(layer_of(opened.view, layer));
    blocks.emplace_back(expected.back().size() / 8 + 2, 0x5555555555555555u);
    targets.push_back(target_of(layer, blocks.back().data(), expected.back().size()));
  }
  const NewView other(opened.scene);
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
}

namespace {

/// Cameras around the two instances. Each except the last has a box of its own.
std::vector<scree_camera> clipped_cameras() {
  std::vector<scree_camera> cameras = random_cameras(7, 8);
  for (size_t c = 0; c + 1 < cameras.size(); ++c) {
    cameras[c].clips = 1;
    for (int i = 0; i < 3; ++i) {
      cameras[c].clip_min[i] = -1 + 0.1 * static_cast<double>(c);
      cameras[c].clip_max[i] = 0.2 + 0.3 * static_cast<double>(c);
    }
  }
  return cameras;
}

}  // namespace

TEST_CASE("a clipping box cuts the scene, for each camera of a batch", "[library]") {
  const TempFolder folder;
  const Opened opened(packed(folder, "two_instances.gltf"));
  const scree_scene_stats stats = stats_of(opened.scene);
  const scree_draw_options options = draw_options(60, 40);
  scree_camera camera = look_at(4, 3, 5);
  const auto drawn = [&] {
    draw(opened.view, options, &camera);
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
      const scree_pick_info pick = pick_at(opened.view, x, y);
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
  check_batch(opened.view, NewView(opened.scene), clipped_cameras(), draw_options(31, 17, 2), kPixelLayers);
}

TEST_CASE("a clipping box cuts the scene on a GPU as on the CPU, in frames and in batches", "[library][cuda]") {
  if (!has_gpu()) return;
  const TempFolder folder;
  for (const uint32_t flags : {0u, uint32_t{SCREE_CONVERT_INDEXED}}) {
    const std::string path = packed(folder, "two_instances.gltf", flags);
    const Opened cpu(path), gpu(path, SCREE_BACKEND_CUDA);
    for (const scree_camera& camera : clipped_cameras()) {
      for (scree_view* const view : {cpu.view, gpu.view}) draw(view, draw_options(40, 30, 2), &camera);
      for (const scree_layer layer : {SCREE_SAMPLES, SCREE_DEPTH, SCREE_TRIANGLE, SCREE_INSTANCE, SCREE_NORMAL})
        CHECK(layer_of(gpu.view, layer) == layer_of(cpu.view, layer));
    }
    check_batch(gpu.view, cpu.view, clipped_cameras(), draw_options(31, 17, 2), kIdLayers);
  }
}

TEST_CASE("a view's buffers keep their addresses for frames that are no larger", "[library]") {
  const TempFolder folder;
  const Opened opened(packed(folder));
  std::array<const void*, std::size(kAllLayers)> first{};
  for (const uint32_t size : {64u, 10u, 33u, 64u, 1u}) {
    draw(opened.view, draw_options(size, size));
    for (size_t i = 0; i < first.size(); ++i) {
      const scree_array array = host_layer(opened.view, kAllLayers[i]);
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
    const NewView fresh(opened.scene);
    draw(fresh, options);
    CHECK(shaded == layer_of(fresh, SCREE_COLOR));
  }
  CHECK(depth == layer_of(opened.view, SCREE_DEPTH));
}

TEST_CASE("a layer that is held stays valid when the view draws larger frames", "[library]") {
  const TempFolder folder;
  const Opened opened(packed(folder));
  scree_view* view = nullptr;
  must(scree_view_create(opened.scene, &view));
  const scree_draw_options options = draw_options(16, 9);
  draw(view, options);
  const std::vector<scree_layer> layers(std::begin(kAllLayers), std::end(kAllLayers));
  std::vector<scree_array> arrays;
  std::vector<scree_memory*> held(layers.size(), nullptr);
  std::vector<std::string> expected;
  for (size_t i = 0; i < layers.size(); ++i) {
    arrays.push_back(host_layer(view, layers[i]));
    must(scree_hold(view, &arrays[i], &held[i]));
    expected.push_back(bytes_of(arrays[i]));
  }
  draw(view, options);  // fits into the memory that the view has left
  CHECK(host_layer(view, SCREE_DEPTH).data == arrays[1].data);
  draw(view, draw_options(640, 480));
  for (size_t i = 0; i < layers.size(); ++i) {
    CHECK(host_layer(view, layers[i]).data != arrays[i].data);
    CHECK(bytes_of(arrays[i]) == expected[i]);
    scree_memory* none = nullptr;
    CHECK(scree_hold(view, &arrays[i], &none) == SCREE_ERROR_ARGUMENT);
    CHECK(none == nullptr);
  }
  must(scree_view_destroy(view));
  for (size_t i = 0; i < layers.size(); ++i) {
    CHECK(bytes_of(arrays[i]) == expected[i]);
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
  scree_pick_info pick = pick_at(opened.view, 40, 20);
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
  pick = pick_at(opened.view, 40, 20);
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
  scree_scene_stats stats = stats_of(opened.scene);
  CHECK(stats.triangles == scene.triangles);
  CHECK(stats.instances == scene.instances);
  CHECK(stats.on_gpu == 0);
  CHECK(std::string(stats.gpu_name) == "");
  CHECK(std::string(stats.why_cpu) == "");
  scree_scene* anywhere = nullptr;
  must(scree_load(opened.file, nullptr, &anywhere));
  stats = stats_of(anywhere);
  CHECK((stats.on_gpu == 1) == std::string(stats.why_cpu).empty());
  must(scree_unload(anywhere));
  for (uint32_t i = 0; i < scene.cameras; ++i) {
    auto camera = sized<scree_camera_info>();
    must(scree_get_camera_info(opened.file, file.default_scene, i, &camera));
    const std::string number = std::to_string(camera.camera);
    auto named = sized<scree_camera>();
    named.kind = SCREE_CAMERA_NAMED;
    named.name = number.c_str();
    draw(opened.view, draw_options(20, 20), &named);
  }
}

TEST_CASE("a GPU's layers equal the CPU's, on the host and on the device", "[library][cuda]") {
  if (!has_gpu()) return;
  const TempFolder folder;
  for (const char* const model : {"textured_cube.glb", "two_instances.gltf"}) {
    const std::string path = packed(folder, model, SCREE_CONVERT_NORMALS);
    const Opened cpu(path), gpu(path, SCREE_BACKEND_CUDA);
    const NewView second(gpu.scene);
    const scree_scene_stats stats = stats_of(gpu.scene);
    CHECK(stats.on_gpu == 1);
    CHECK(stats.device_bytes > 0);
    for (Shot shot : random_shots(kEmulatesGpu ? 4 : 40, 3)) {
      draw(cpu.view, shot.options, &shot.camera);
      for (scree_view* const view : std::array<scree_view*, 2>{gpu.view, second}) {
        draw(view, shot.options, &shot.camera);
        for (const scree_layer layer : kAllLayers) {
          if (layer == SCREE_COLOR || layer == SCREE_LINEAR) continue;
          INFO("layer " << layer);
          const std::string expected = layer_of(cpu.view, layer);
          const scree_array array = device_layer(view, layer);
          CHECK(array.gpu == 0);
          CHECK(array.bytes == expected.size());
          CHECK(layer_of(view, layer) == expected);
        }
        const std::string colors = layer_of(cpu.view, SCREE_COLOR);
        CHECK(differing(colors, layer_of(view, SCREE_COLOR)) <= colors.size() / 1000);
        const auto linear = values_of<float>(layer_of(cpu.view, SCREE_LINEAR));
        const auto linear_on_gpu = values_of<float>(layer_of(view, SCREE_LINEAR));
        REQUIRE(linear.size() == linear_on_gpu.size());
        size_t far = 0;
        for (size_t i = 0; i < linear.size(); ++i) far += std::abs(linear[i] - linear_on_gpu[i]) > 0.01f ? 1 : 0;
        CHECK(far <= linear.size() / 1000);
        auto none = sized<scree_array>();
        CHECK(scree_device_layer(view, SCREE_LINEAR, nullptr, &none) == SCREE_ERROR_ARGUMENT);
        const scree_pick_info on_cpu = pick_at(cpu.view, shot.options.width / 2, shot.options.height / 2);
        const scree_pick_info on_gpu = pick_at(view, shot.options.width / 2, shot.options.height / 2);
        CHECK(on_cpu.hit == on_gpu.hit);
        CHECK(on_cpu.triangle == on_gpu.triangle);
        CHECK(on_cpu.depth == on_gpu.depth);
      }
    }
    // A batch's pictures alternate between two draw lists. It must equal the single frames: layers of the CPU, colours
    // of the GPU.
    const std::vector<scree_camera> cameras = random_cameras(5, 5);
    const scree_draw_options options = draw_options(20, 10, 2);
    must(scree_draw_batch(cpu.view, cameras.data(), 5, &options, kPixelLayers));
    // Batches of four or more pictures of ids are drawn together.
    using Batch = std::pair<uint32_t, uint32_t>;
    for (const auto& [count, made] : {Batch{5, kPixelLayers},
                                      {2, kPixelLayers},
                                      {1, kPixelLayers},
                                      {5, kIdLayers},
                                      {3, kIdLayers},
                                      {1, kIdLayers},
                                      {5, kPixelLayers}}) {
      must(scree_draw_batch(second, cameras.data(), count, &options, made));
      auto refused = sized<scree_array>();
      if (made == kIdLayers) CHECK(scree_host_layer(second, SCREE_NORMAL, &refused) == SCREE_ERROR_ARGUMENT);
      CHECK(scree_draw_batch(second, cameras.data(), 0, &options, made) == SCREE_ERROR_ARGUMENT);
      must(scree_draw_batch(second, cameras.data(), count, &options, made));
      for (const scree_layer layer : kAllLayers) {
        if ((made >> layer & 1) == 0) continue;
        INFO("layer " << layer << ", " << count << " cameras");
        const scree_array array = device_layer(second, layer);
        CHECK(array.gpu == 0);
        CHECK(array.shape[0] == count);
        const std::string expected = single_frames(gpu.view, std::span(cameras).first(count), options, layer);
        CHECK(array.bytes == expected.size());
        CHECK(layer_of(second, layer) == expected);
        if (layer != SCREE_COLOR && count == 5) CHECK(layer_of(cpu.view, layer) == expected);
        // The memory of another view's layer serves as the caller's memory.
        must(scree_draw_batch(gpu.view, cameras.data(), count, &options, made));
        const scree_array place = device_layer(gpu.view, layer);
        scree_target target = target_of(layer, const_cast<void*>(place.data), place.bytes);
        std::vector<scree_camera> turned(cameras.rbegin(), cameras.rend());
        turned.resize(count);
        must(scree_draw_batch(second, turned.data(), count, &options, 1u << layer));
        const std::string wanted = layer_of(second, layer);
        const NewView third(gpu.scene);
        must(scree_draw_batch_to(third, turned.data(), count, &options, &target, 1, nullptr));
        CHECK(layer_of(gpu.view, layer) == wanted);
        target.bytes -= 1;
        CHECK(scree_draw_batch_to(third, turned.data(), count, &options, &target, 1, nullptr) == SCREE_ERROR_BUFFER);
        must(scree_draw_batch(second, cameras.data(), count, &options, made));
      }
    }
    draw(second, options, &cameras[1]);  // with the list of the second picture
    draw(gpu.view, options, &cameras[1]);
    CHECK(frame_of(second) == frame_of(gpu.view));
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
    for (int i = 0; i < 1500; ++i) add_triangle(cloud, middle, 0.3, random);
    meshes.emplace_back(cloud, float32());
  }
  const PagedScene paged{.chunk_triangles = 1500};  // few parts per frame
  paged.write(path, meshes);
  scree_file* file = nullptr;
  must(scree_open(path.c_str(), &file));
  scree_load_options load = load_options(SCREE_BACKEND_CUDA, 1);
  load.max_width = load.max_height = 64;
  load.max_samples = 1;
  scree_scene* scene = nullptr;
  REQUIRE(scree_load(file, &load, &scene) == SCREE_ERROR_DEVICE);
  load.device_memory = least_device_memory(scree_error());
  must(scree_load(file, &load, &scene));
  CHECK(stats_of(scene).streamed == 1);
  const Opened cpu(path);
  scree_view* views[2] = {};
  for (scree_view*& view : views) must(scree_view_create(scene, &view));
  for (const Shot& shot : random_shots(kEmulatesGpu ? 1 : 30, 6)) {
    draw(cpu.view, shot.options, &shot.camera);
    for (scree_view* const view : views) draw(view, shot.options, &shot.camera);
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
