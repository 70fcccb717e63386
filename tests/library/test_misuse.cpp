// Every misuse of the library gives an error code and a text.
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "tests/library/handles.h"
#include "tests/paths.h"

using namespace scree::tests;

namespace {

/// Checks that the call failed with this code and text.
void failed(scree_status status, scree_status expected, const std::string& part) {
  INFO(scree_status_name(status) << ": " << scree_error());
  CHECK(status == expected);
  CHECK(std::string(scree_error()).find(part) != std::string::npos);
  CHECK(std::string(scree_error()).find('\n') == std::string::npos);
}

}  // namespace

TEST_CASE("null where a pointer is wanted", "[library][misuse]") {
  const TempFolder folder;
  const std::string path = packed(folder);
  const Opened opened(path);
  scree_file* file = nullptr;
  failed(scree_open(nullptr, &file), SCREE_ERROR_ARGUMENT, "null");
  failed(scree_open(path.c_str(), nullptr), SCREE_ERROR_ARGUMENT, "null");
  scree_scene* scene = nullptr;
  failed(scree_load(nullptr, nullptr, &scene), SCREE_ERROR_ARGUMENT, "scree_file is null");
  failed(scree_load(opened.file, nullptr, nullptr), SCREE_ERROR_ARGUMENT, "null");
  scree_view* view = nullptr;
  failed(scree_view_create(nullptr, &view), SCREE_ERROR_ARGUMENT, "scree_scene is null");
  failed(scree_view_create(opened.scene, nullptr), SCREE_ERROR_ARGUMENT, "null");
  failed(scree_draw(nullptr, nullptr, nullptr), SCREE_ERROR_ARGUMENT, "scree_view is null");
  failed(scree_get_file_info(opened.file, nullptr), SCREE_ERROR_ARGUMENT, "null");
  failed(scree_get_scene_stats(opened.scene, nullptr), SCREE_ERROR_ARGUMENT, "null");
  failed(scree_convert(nullptr, nullptr, nullptr, nullptr), SCREE_ERROR_ARGUMENT, "null");
  const scree_draw_options options = draw_options(8, 8);
  must(scree_draw(opened.view, nullptr, &options));
  failed(scree_host_layer(opened.view, SCREE_COLOR, nullptr), SCREE_ERROR_ARGUMENT, "null");
  failed(scree_read(opened.view, SCREE_COLOR, nullptr, 256), SCREE_ERROR_ARGUMENT, "null");
  failed(scree_pick(opened.view, 0, 0, nullptr), SCREE_ERROR_ARGUMENT, "null");
  CHECK(scree_close(nullptr) == SCREE_OK);
  CHECK(scree_unload(nullptr) == SCREE_OK);
  CHECK(scree_view_destroy(nullptr) == SCREE_OK);
}

TEST_CASE("handles that were ended, and handles of another kind", "[library][misuse]") {
  const TempFolder folder;
  const std::string path = packed(folder);
  scree_file* file = nullptr;
  must(scree_open(path.c_str(), &file));
  auto load = sized<scree_load_options>();
  load.backend = SCREE_BACKEND_CPU;
  scree_scene* scene = nullptr;
  must(scree_load(file, &load, &scene));
  scree_view* view = nullptr;
  must(scree_view_create(scene, &view));
  failed(scree_view_destroy(reinterpret_cast<scree_view*>(scene)), SCREE_ERROR_HANDLE, "no scree_view");
  must(scree_close(file));
  must(scree_unload(scene));
  const scree_draw_options options = draw_options(8, 8);
  must(scree_draw(view, nullptr, &options));  // it keeps the objects that it needs
  must(scree_view_destroy(view));

  auto info = sized<scree_file_info>();
  failed(scree_get_file_info(file, &info), SCREE_ERROR_HANDLE, "ended");
  failed(scree_close(file), SCREE_ERROR_HANDLE, "ended");
  failed(scree_load(file, &load, &scene), SCREE_ERROR_HANDLE, "ended");
  scree_view* other = nullptr;
  failed(scree_view_create(scene, &other), SCREE_ERROR_HANDLE, "ended");
  failed(scree_unload(scene), SCREE_ERROR_HANDLE, "ended");
  failed(scree_draw(view, nullptr, nullptr), SCREE_ERROR_HANDLE, "ended");
  failed(scree_view_destroy(view), SCREE_ERROR_HANDLE, "ended");
  // Handles are never reused.
  scree_file* again = nullptr;
  must(scree_open(path.c_str(), &again));
  CHECK(again != file);
  must(scree_close(again));
  int local = 0;
  failed(scree_close(reinterpret_cast<scree_file*>(&local)), SCREE_ERROR_HANDLE, "no scree_file");
}

TEST_CASE("files that are none", "[library][misuse]") {
  const TempFolder folder;
  scree_file* file = nullptr;
  failed(scree_open(folder.file("missing.scree").c_str(), &file), SCREE_ERROR_FILE, "missing.scree");
  const std::string text = folder.write("text.scree", std::string(1000, 'x'));
  failed(scree_open(text.c_str(), &file), SCREE_ERROR_DATA, "text.scree");
  const std::string path = packed(folder);
  const std::string whole = read_whole(path);
  const std::string cut = folder.write("cut.scree", whole.substr(0, whole.size() / 2));
  failed(scree_open(cut.c_str(), &file), SCREE_ERROR_DATA, "cut.scree");
  CHECK(file == nullptr);
  failed(scree_convert(folder.file("none.glb").c_str(), nullptr, nullptr, nullptr), SCREE_ERROR_FILE, "none.glb");
  failed(scree_convert(data_path("textured_cube.glb").c_str(), path.c_str(), nullptr, nullptr), SCREE_ERROR_FILE,
         ".scree");  // the file exists
}

TEST_CASE("numbers and options out of range", "[library][misuse]") {
  const TempFolder folder;
  const Opened opened(packed(folder));
  auto mesh = sized<scree_mesh_info>();
  failed(scree_get_mesh_info(opened.file, 99, &mesh), SCREE_ERROR_ARGUMENT, "no mesh 99");
  auto camera_info = sized<scree_camera_info>();
  failed(scree_get_camera_info(opened.file, 0, 7, &camera_info), SCREE_ERROR_ARGUMENT, "no camera 7");
  auto instance = sized<scree_instance_info>();
  failed(scree_get_instance_info(opened.scene, 5, &instance), SCREE_ERROR_ARGUMENT, "no instance 5");

  auto load = sized<scree_load_options>();
  scree_scene* scene = nullptr;
  load.backend = static_cast<scree_backend>(7);
  failed(scree_load(opened.file, &load, &scene), SCREE_ERROR_ARGUMENT, "backend is 7");
  load.backend = SCREE_BACKEND_CPU;
  load.scene = "nowhere";
  failed(scree_load(opened.file, &load, &scene), SCREE_ERROR_ARGUMENT, "nowhere");
  load.scene = nullptr;
  load.gpu = "0";
  failed(scree_load(opened.file, &load, &scene), SCREE_ERROR_ARGUMENT, "CPU");
  load = sized<scree_load_options>();
  load.threads = 5000;
  failed(scree_load(opened.file, &load, &scene), SCREE_ERROR_ARGUMENT, "5000");
  load.threads = 1;
  load.max_samples = 3;
  failed(scree_load(opened.file, &load, &scene), SCREE_ERROR_ARGUMENT, "max_samples is 3");
  load.max_samples = 1;
  load.gpus = 17;
  failed(scree_load(opened.file, &load, &scene), SCREE_ERROR_ARGUMENT, "gpus is 17, at most 16 or SCREE_ALL_GPUS");
  load.gpus = 2;
  load.backend = SCREE_BACKEND_CPU;
  failed(scree_load(opened.file, &load, &scene), SCREE_ERROR_ARGUMENT, "names GPUs, but the backend is the CPU");

  const auto draws = [&](const scree_draw_options& options, const std::string& part) {
    failed(scree_draw(opened.view, nullptr, &options), SCREE_ERROR_ARGUMENT, part);
  };
  draws(draw_options(8, 8, 3), "samples is 3");
  draws(draw_options(20000, 8), "20000");
  draws(draw_options(5000, 8, 4), "20000");
  scree_draw_options options = draw_options(8, 8);
  options.show = static_cast<scree_show>(12);
  draws(options, "show is 12");
  options = draw_options(8, 8);
  options.flags = 64;
  draws(options, "flags");
  options = draw_options(8, 8);
  options.background[0] = std::numeric_limits<float>::quiet_NaN();
  draws(options, "background");
  options = draw_options(8, 8);
  options.edl_radius = 100;
  draws(options, "edl_radius");

  options = draw_options(8, 8);
  const auto sees = [&](const scree_camera& camera, const std::string& part) {
    failed(scree_draw(opened.view, &camera, &options), SCREE_ERROR_ARGUMENT, part);
  };
  auto camera = sized<scree_camera>();
  camera.kind = static_cast<scree_camera_kind>(9);
  sees(camera, "kind is 9");
  camera.kind = SCREE_CAMERA_NAMED;
  sees(camera, "name");
  camera.name = "nobody";
  sees(camera, "nobody");
  camera = sized<scree_camera>();
  camera.kind = SCREE_CAMERA_LOOK_AT;
  sees(camera, "same point");
  camera.eye[0] = std::numeric_limits<double>::infinity();
  sees(camera, "not finite");
  camera.eye[0] = 3;
  camera.up[0] = 1;
  sees(camera, "up");
  camera.up[0] = 0;
  camera.fov_degrees = 180;
  sees(camera, "fov_degrees");
  camera = sized<scree_camera>();
  camera.kind = SCREE_CAMERA_MATRICES;
  sees(camera, "rotation");
  for (int i = 0; i < 4; ++i) camera.view[5 * i] = 1;
  sees(camera, "projection");
  camera.projection[0] = camera.projection[5] = 1;
  camera.projection[14] = -1;
  camera.projection[10] = -1;
  sees(camera, "near plane");
  camera.z_near = 0.1;
  must(scree_draw(opened.view, &camera, &options));
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    camera.z_near = bad;
    sees(camera, "z_near");
  }
  camera.z_near = 0.1;
  camera.projection[2] = 0.1;
  sees(camera, "middle of the picture");
  camera.projection[2] = 0;
  camera.view[0] = -1;  // mirrored
  sees(camera, "rotation");

  auto convert = sized<scree_convert_options>();
  const std::string source = data_path("textured_cube.glb").string(), output = folder.file("out.scree");
  const auto converts = [&](const std::string& part) {
    failed(scree_convert(source.c_str(), output.c_str(), &convert, nullptr), SCREE_ERROR_ARGUMENT, part);
    convert = sized<scree_convert_options>();
  };
  convert.flags = 1u << 31;
  converts("flags");
  convert.position_bits = 40;
  converts("40");
  convert.zstd_level = 99;
  converts("99");
  convert.zstd_level = -2;
  converts("-2");
  convert.jpeg_quality = 200;
  converts("200");
  convert.textures = static_cast<scree_textures>(5);
  converts("textures is 5");
  convert.memory = 1000;
  converts("memory");
}

TEST_CASE("structures without their size, and newer ones", "[library][misuse]") {
  const TempFolder folder;
  const Opened opened(packed(folder));
  scree_draw_options options{};
  failed(scree_draw(opened.view, nullptr, &options), SCREE_ERROR_ARGUMENT, "scree_draw_options::size is 0");
  scree_file_info info{};
  failed(scree_get_file_info(opened.file, &info), SCREE_ERROR_ARGUMENT, "scree_file_info::size is 0");

  struct {
    scree_draw_options known;
    uint64_t more;
  } newer{draw_options(8, 8), 0};
  newer.known.size = sizeof newer;
  must(scree_draw(opened.view, nullptr, &newer.known));
  newer.more = 1;
  failed(scree_draw(opened.view, nullptr, &newer.known), SCREE_ERROR_ARGUMENT, "does not know");

  // The structure of an older program is filled in up to its size.
  struct {
    scree_file_info known;
  } older{};
  older.known.size = offsetof(scree_file_info, triangles);
  older.known.triangles = 77;
  must(scree_get_file_info(opened.file, &older.known));
  CHECK(older.known.bytes > 0);
  CHECK(older.known.triangles == 77);
}

TEST_CASE("frames that are not there, buffers of another size, pixels outside", "[library][misuse]") {
  const TempFolder folder;
  const Opened opened(packed(folder));
  auto array = sized<scree_array>();
  auto pick = sized<scree_pick_info>();
  auto stats = sized<scree_frame_stats>();
  failed(scree_host_layer(opened.view, SCREE_COLOR, &array), SCREE_ERROR_NO_FRAME, "drawn nothing");
  failed(scree_pick(opened.view, 0, 0, &pick), SCREE_ERROR_NO_FRAME, "drawn nothing");
  failed(scree_get_frame_stats(opened.view, &stats), SCREE_ERROR_NO_FRAME, "drawn nothing");
  failed(scree_shade(opened.view, nullptr), SCREE_ERROR_NO_FRAME, "drawn nothing");

  scree_draw_options options = draw_options(10, 7);
  must(scree_draw(opened.view, nullptr, &options));
  std::vector<unsigned char> buffer(280, 9);
  failed(scree_read(opened.view, SCREE_COLOR, buffer.data(), 279), SCREE_ERROR_BUFFER, "279 bytes");
  CHECK(buffer == std::vector<unsigned char>(280, 9));
  must(scree_read(opened.view, SCREE_COLOR, buffer.data(), 280));
  failed(scree_read(opened.view, SCREE_TRIANGLE, buffer.data(), 280), SCREE_ERROR_BUFFER, "560");
  failed(scree_host_layer(opened.view, static_cast<scree_layer>(8), &array), SCREE_ERROR_ARGUMENT, "no layer 8");
  failed(scree_pick(opened.view, 10, 0, &pick), SCREE_ERROR_ARGUMENT, "10,0");
  failed(scree_device_layer(opened.view, SCREE_COLOR, nullptr, &array), SCREE_ERROR_DEVICE, "CPU");

  const auto cameras = std::vector<scree_camera>(2, sized<scree_camera>());
  failed(scree_draw_batch(opened.view, nullptr, 1, &options, 1), SCREE_ERROR_ARGUMENT, "null");
  failed(scree_draw_batch(opened.view, cameras.data(), 0, &options, 1), SCREE_ERROR_ARGUMENT, "cameras");
  failed(scree_draw_batch(opened.view, cameras.data(), 2, &options, 0), SCREE_ERROR_ARGUMENT, "layer");
  failed(scree_draw_batch(opened.view, cameras.data(), 2, &options, 1u << SCREE_SAMPLES), SCREE_ERROR_ARGUMENT,
         "layer");
  const auto refused = [&](scree_status status, const char* text, const auto& change) {
    alignas(16) std::array<float, 140> depths;
    depths.fill(-9);
    std::array<scree_target, 2> targets{sized<scree_target>(), sized<scree_target>()};
    targets[0].layer = targets[1].layer = SCREE_DEPTH;
    targets[0].data = depths.data();
    targets[0].bytes = sizeof depths;
    const uint32_t count = change(targets);
    failed(scree_draw_batch_to(opened.view, cameras.data(), 2, &options, targets.data(), count, nullptr), status, text);
    CHECK(std::all_of(depths.begin(), depths.end(), [](float depth) { return depth == -9; }));
  };
  failed(scree_draw_batch_to(opened.view, cameras.data(), 2, &options, nullptr, 1, nullptr), SCREE_ERROR_ARGUMENT,
         "null");
  refused(SCREE_ERROR_ARGUMENT, "none", [](auto&) { return 0; });
  refused(SCREE_ERROR_ARGUMENT, "layer", [](auto& targets) { return targets[0].layer = SCREE_SAMPLES, 1; });
  refused(SCREE_ERROR_ARGUMENT, "layer", [](auto& targets) { return targets[0].layer = SCREE_LINEAR, 1; });
  refused(SCREE_ERROR_ARGUMENT, "layer",
          [](auto& targets) { return targets[0].layer = static_cast<scree_layer>(8), 1; });
  refused(SCREE_ERROR_ARGUMENT, "null", [](auto& targets) { return targets[0].data = nullptr, 1; });
  refused(SCREE_ERROR_ARGUMENT, "16", [](auto& targets) {
    targets[0].data = static_cast<char*>(targets[0].data) + 4;
    return 1;
  });
  refused(SCREE_ERROR_BUFFER, "559 bytes", [](auto& targets) { return targets[0].bytes = 559, 1; });
  refused(SCREE_ERROR_ARGUMENT, "of another", [](auto& targets) { return targets[1] = targets[0], 2; });
  refused(SCREE_ERROR_ARGUMENT, "another size", [](auto& targets) { return targets[1].size -= 8, 2; });
  refused(SCREE_ERROR_ARGUMENT, "scree_target", [](auto& targets) { return targets[0].size = 0, 1; });
  must(scree_draw_batch(opened.view, cameras.data(), 2, &options, 1u << SCREE_DEPTH));
  failed(scree_host_layer(opened.view, SCREE_COLOR, &array), SCREE_ERROR_ARGUMENT, "without this layer");
  failed(scree_pick(opened.view, 0, 0, &pick), SCREE_ERROR_ARGUMENT, "batch");
  failed(scree_shade(opened.view, &options), SCREE_ERROR_ARGUMENT, "batch");
  must(scree_draw(opened.view, nullptr, &options));

  // The call's error must not affect the frame; a thread only gets its own error.
  options.samples = 3;
  failed(scree_draw(opened.view, nullptr, &options), SCREE_ERROR_ARGUMENT, "samples");
  must(scree_read(opened.view, SCREE_COLOR, buffer.data(), 280));
  CHECK(std::string(scree_status_name(SCREE_ERROR_BUFFER)) == "SCREE_ERROR_BUFFER");
  CHECK(std::string(scree_status_name(static_cast<scree_status>(99))) == "SCREE_ERROR_INTERNAL");
}

TEST_CASE("a GPU that is not there", "[library][misuse]") {
  const TempFolder folder;
  const Opened opened(packed(folder));
  auto load = sized<scree_load_options>();
  scree_scene* scene = nullptr;
  load.gpu = "somewhere";
  failed(scree_load(opened.file, &load, &scene), SCREE_ERROR_ARGUMENT, "somewhere");
  load.gpu = "63";
  failed(scree_load(opened.file, &load, &scene), SCREE_ERROR_DEVICE, "scree");
}
