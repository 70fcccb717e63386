// Every misuse of the library gives an error code and one line of text, and leaves the caller's memory as it was.
#include <algorithm>
#include <array>
#include <filesystem>
#include <functional>
#include <set>
#include <string>
#include <tuple>
#include <vector>

#include "tests/gpu.h"
#include "tests/library/misuse.h"

using namespace scree::tests;

namespace {

struct Misuse {
  const char* function;
  const char* what;
  std::function<scree_status()> call;
  scree_status status;
  const char* part;  // a part of the error's text
};

/// Makes a table row for each change of a structure of options: its name, the change, and a part of the error's text.
template <class T>
struct Change {
  const char* what;
  std::function<void(T&)> change;
  const char* part;
};

template <class T>
void add(std::vector<Misuse>& rows, const char* function, const std::vector<Change<T>>& changes,
         const std::function<scree_status(const T&)>& call) {
  for (const Change<T>& change : changes)
    rows.push_back({function, change.what,
                    [change, call] {
                      T value = sized<T>();
                      change.change(value);
                      return call(value);
                    },
                    SCREE_ERROR_ARGUMENT, change.part});
}

/// Sets all bits of a field, as a caller may, whatever its enum holds.
template <class Enum>
void set_bits(Enum& field) {
  std::memset(&field, 0xff, sizeof field);
}

void add_nulls(std::vector<Misuse>& rows, Subjects& s) {
  const auto null = [&](const char* function, const char* what, std::function<scree_status()> call) {
    rows.push_back({function, what, std::move(call), SCREE_ERROR_ARGUMENT, "null"});
  };
  const Opened& o = s.opened;
  Outputs& out = s.out;
  null("scree_open", "no path", [&] { return scree_open(nullptr, &out.file); });
  null("scree_open", "no output", [&] { return scree_open(s.path.c_str(), nullptr); });
  null("scree_get_file_info", "no output", [&] { return scree_get_file_info(o.file, nullptr); });
  null("scree_get_scene_info", "no output", [&] { return scree_get_scene_info(o.file, 0, nullptr); });
  null("scree_get_mesh_info", "no output", [&] { return scree_get_mesh_info(o.file, 0, nullptr); });
  null("scree_get_material_info", "no output", [&] { return scree_get_material_info(o.file, 0, nullptr); });
  null("scree_get_camera_info", "no output", [&] { return scree_get_camera_info(o.file, 0, 0, nullptr); });
  null("scree_load", "no output", [&] { return scree_load(o.file, nullptr, nullptr); });
  null("scree_get_scene_stats", "no output", [&] { return scree_get_scene_stats(o.scene, nullptr); });
  null("scree_get_instance_info", "no output", [&] { return scree_get_instance_info(o.scene, 0, nullptr); });
  null("scree_view_create", "no output", [&] { return scree_view_create(o.scene, nullptr); });
  null("scree_draw_batch", "no cameras", [&] { return scree_draw_batch(o.view, nullptr, 1, nullptr, 1); });
  null("scree_draw_batch_to", "no cameras",
       [&] { return scree_draw_batch_to(o.view, nullptr, 1, nullptr, nullptr, 1, nullptr); });
  null("scree_draw_batch_to", "no targets",
       [&] { return scree_draw_batch_to(o.view, &default_camera, 1, nullptr, nullptr, 1, nullptr); });
  null("scree_host_layer", "no output", [&] { return scree_host_layer(o.view, SCREE_COLOR, nullptr); });
  null("scree_device_layer", "no output", [&] { return scree_device_layer(o.view, SCREE_COLOR, nullptr, nullptr); });
  null("scree_hold", "no array", [&] { return scree_hold(o.view, nullptr, &out.memory); });
  null("scree_hold", "no output", [&] { return scree_hold(o.view, &out.array, nullptr); });
  null("scree_read", "no buffer", [&] { return scree_read(o.view, SCREE_COLOR, nullptr, 280); });
  null("scree_pick", "no output", [&] { return scree_pick(o.view, 0, 0, nullptr); });
  null("scree_get_frame_stats", "no output", [&] { return scree_get_frame_stats(o.view, nullptr); });
  null("scree_convert", "no input", [&] { return scree_convert(nullptr, s.made.c_str(), nullptr, nullptr); });
  null("scree_cameras_of_path", "no file",
       [&] { return scree_cameras_of_path(nullptr, 0, 0, 1, out.cameras.data(), &out.path_info); });
  null("scree_cameras_of_path", "no output",
       [&] { return scree_cameras_of_path(s.film.c_str(), 0, 0, 1, nullptr, &out.path_info); });
}

void add_files(std::vector<Misuse>& rows, Subjects& s) {
  Outputs& out = s.out;
  const TempFolder& folder = s.folder;
  const auto opens = [&](const char* what, std::string path, scree_status status, const char* part) {
    rows.push_back({"scree_open", what, [&out, path] { return scree_open(path.c_str(), &out.file); }, status, part});
  };
  const std::string whole = read_whole(s.path);
  opens("an empty path", "", SCREE_ERROR_ARGUMENT, "scree_open: path is empty");
  opens("missing", folder.file("missing.scree"), SCREE_ERROR_FILE, "missing.scree");
  opens("a name of two lines", folder.file("two\nlines\x1b.scree"), SCREE_ERROR_FILE, "two lines .scree");
  opens("a folder", folder.file(""), SCREE_ERROR_FILE, "is a folder");
  opens("a device", "/dev/null", SCREE_ERROR_FILE, "not a regular file");
  opens("empty", folder.write("empty.scree", ""), SCREE_ERROR_DATA, "empty.scree");
  opens("text", folder.write("text.scree", std::string(1000, 'x')), SCREE_ERROR_DATA, "text.scree");
  opens("a half", folder.write("cut.scree", whole.substr(0, whole.size() / 2)), SCREE_ERROR_DATA, "cut.scree");

  const auto reads = [&](const char* what, std::string path, scree_status status, const char* part) {
    rows.push_back(
        {"scree_cameras_of_path", what,
         [&out, path] { return scree_cameras_of_path(path.c_str(), 0, 0, 1, out.cameras.data(), &out.path_info); },
         status, part});
  };
  const auto keys = [&](const char* name, const char* text) {
    return folder.write(name, R"({"format": "scree camera path", "version": 1, "keys": [)" + std::string(text) + "]}");
  };
  reads("an empty path", "", SCREE_ERROR_ARGUMENT, "scree_cameras_of_path: file is empty");
  reads("missing", folder.file("missing.json"), SCREE_ERROR_FILE, "missing.json");
  reads("a folder", folder.file(""), SCREE_ERROR_FILE, "cannot be");
  reads("of another kind", s.path, SCREE_ERROR_DATA, "not JSON");
  reads("no key", keys("none.json", ""), SCREE_ERROR_DATA, "at least one key");
  reads("no camera", keys("no_camera.json", R"({"eye": [1, 2, 3]})"), SCREE_ERROR_DATA, "\"target\"");
  reads("no up", keys("no_up.json", R"({"eye": [1, 2, 3], "target": [0, 0, 0], "up": [0, 0, 0]})"), SCREE_ERROR_DATA,
        "frame 0: up has no direction");
  const auto frames = [&](const char* what, double fps, uint64_t first, uint64_t count, const char* part) {
    rows.push_back({"scree_cameras_of_path", what,
                    [&s, fps, first, count] {
                      return scree_cameras_of_path(s.film.c_str(), fps, first, count, s.out.cameras.data(),
                                                   &s.out.path_info);
                    },
                    SCREE_ERROR_ARGUMENT, part});
  };
  frames("frames behind the end", 0, 3, 2, "has 4 frames, but 2 from frame 3 on");
  frames("a first frame behind the end", 0, 5, 0, "has 4 frames");
  frames("a sum that overflows", 0, 1, UINT64_MAX, "has 4 frames");
  frames("NaN frames per second", kNan, 0, 1, "frames_per_second");
  frames("a negative rate", -30, 0, 1, "frames_per_second");
  frames("a rate too large", 1e6, 0, 1, "frames_per_second");

  const auto converts = [&](const char* what, std::string input, std::string output, scree_status status,
                            const char* part) {
    rows.push_back({"scree_convert", what,
                    [&out, input, output] {
                      return scree_convert(input.c_str(), output.empty() ? nullptr : output.c_str(), nullptr,
                                           &out.report);
                    },
                    status, part});
  };
  converts("an empty path", "", "", SCREE_ERROR_ARGUMENT, "scree_convert: input is empty");
  rows.push_back({"scree_convert", "an empty output",
                  [&] { return scree_convert(s.source.c_str(), "", nullptr, &out.report); }, SCREE_ERROR_ARGUMENT,
                  "scree_convert: output is empty"});
  converts("missing", folder.file("none.glb"), "", SCREE_ERROR_FILE, "none.glb");
  converts("a folder", folder.file(""), s.made, SCREE_ERROR_FILE, "not a regular file");
  converts("no model", s.path, s.made, SCREE_ERROR_DATA, "is packed already");
  converts("an output that exists", s.source, s.path, SCREE_ERROR_FILE, ".scree");
  converts("an output in no folder", s.source, folder.file("nowhere/a.scree"), SCREE_ERROR_FILE, "nowhere");
}

void add_numbers(std::vector<Misuse>& rows, Subjects& s) {
  const Opened& o = s.opened;
  Outputs& out = s.out;
  const auto add_number = [&](const char* function, const char* what, std::function<scree_status()> call,
                              const char* part) {
    rows.push_back({function, what, std::move(call), SCREE_ERROR_ARGUMENT, part});
  };
  for (const uint32_t index : {1u, 99u, UINT32_MAX}) {
    add_number(
        "scree_get_scene_info", "no such scene",
        [&, index] { return scree_get_scene_info(o.file, index, &out.scene_info); }, "no scene");
    add_number(
        "scree_get_mesh_info", "no such mesh",
        [&, index] { return scree_get_mesh_info(o.file, index, &out.mesh_info); }, "no mesh");
    add_number(
        "scree_get_material_info", "no such material",
        [&, index] { return scree_get_material_info(o.file, index, &out.material_info); }, "no material");
    add_number(
        "scree_get_camera_info", "no such scene",
        [&, index] { return scree_get_camera_info(o.file, index, 0, &out.camera_info); }, "no scene");
    add_number(
        "scree_get_camera_info", "no such camera",
        [&, index] { return scree_get_camera_info(o.file, 0, index, &out.camera_info); }, "no camera");
    add_number(
        "scree_get_instance_info", "no such instance",
        [&, index] { return scree_get_instance_info(o.scene, uint64_t{index} << 32, &out.instance_info); },
        "no instance");
    add_number(
        "scree_pick", "outside", [&, index] { return scree_pick(o.view, std::max(index, 10u), 0, &out.pick_info); },
        "picture of 10 x 7");
  }
  add_number(
      "scree_pick", "below", [&] { return scree_pick(o.view, 0, 7, &out.pick_info); }, "0,7");
  for (const int32_t number : {8, 77, INT32_MAX}) {
    const auto layer = static_cast<scree_layer>(number);
    add_number(
        "scree_host_layer", "no such layer", [&, layer] { return scree_host_layer(o.view, layer, &out.array); },
        "no layer");
    add_number(
        "scree_device_layer", "no such layer",
        [&, layer] { return scree_device_layer(o.view, layer, nullptr, &out.array); }, "no layer");
    add_number(
        "scree_read", "no such layer", [&, layer] { return scree_read(o.view, layer, out.buffer.data(), 280); },
        "no layer");
  }
  const auto reads = [&](scree_layer layer, uint64_t bytes, const char* part) {
    rows.push_back({"scree_read", "a buffer of another size",
                    [&, layer, bytes] { return scree_read(o.view, layer, out.buffer.data(), bytes); },
                    SCREE_ERROR_BUFFER, part});
  };
  reads(SCREE_COLOR, 0, "0 bytes, but the layer has 280");
  reads(SCREE_COLOR, 279, "279 bytes");
  reads(SCREE_COLOR, 281, "281 bytes");
  reads(SCREE_COLOR, UINT64_MAX, "18446744073709551615 bytes");
  reads(SCREE_TRIANGLE, 280, "560");
  add_number(
      "scree_hold", "memory of no layer",
      [&] {
        auto array = sized<scree_array>();
        array.data = out.buffer.data();
        return scree_hold(o.view, &array, &out.memory);
      },
      "other memory");
  add_number(
      "scree_hold", "an array of nothing",
      [&] {
        const auto array = sized<scree_array>();
        return scree_hold(o.view, &array, &out.memory);
      },
      "other memory");
  add_number(
      "scree_hold", "a layer of another view",
      [&] {
        const scree_array array = host_layer(o.view, SCREE_COLOR);
        return scree_hold(s.empty, &array, &out.memory);
      },
      "other memory");
  const auto no_frame = [&](const char* function, std::function<scree_status()> call) {
    rows.push_back({function, "before any draw", std::move(call), SCREE_ERROR_NO_FRAME, "drawn nothing"});
  };
  no_frame("scree_host_layer", [&] { return scree_host_layer(s.empty, SCREE_COLOR, &out.array); });
  no_frame("scree_device_layer", [&] { return scree_device_layer(s.empty, SCREE_COLOR, nullptr, &out.array); });
  no_frame("scree_read", [&] { return scree_read(s.empty, SCREE_COLOR, out.buffer.data(), 280); });
  no_frame("scree_pick", [&] { return scree_pick(s.empty, 0, 0, &out.pick_info); });
  no_frame("scree_get_frame_stats", [&] { return scree_get_frame_stats(s.empty, &out.frame_stats); });
  no_frame("scree_shade", [&] { return scree_shade(s.empty, nullptr); });
}

void add_options(std::vector<Misuse>& rows, Subjects& s, bool on_gpu) {
  using Load = scree_load_options;
  add<Load>(rows, "scree_load",
            {{"backend", [](Load& l) { l.backend = static_cast<scree_backend>(7); }, "backend is 7"},
             {"backend", [](Load& l) { l.backend = SCREE_BACKEND_32_BITS; }, "backend is"},
             {"scene", [](Load& l) { l.scene = "nowhere"; }, "nowhere"},
             {"scene", [](Load& l) { l.scene = "1"; }, "1"},
             {"gpu of the CPU", [](Load& l) { l.backend = SCREE_BACKEND_CPU, l.gpu = "0"; }, "CPU"},
             {"gpu", [](Load& l) { l.gpu = "somewhere"; }, "somewhere"},
             {"threads", [](Load& l) { l.threads = 5000; }, "5000"},
             {"threads", [](Load& l) { l.threads = UINT32_MAX; }, "4294967295"},
             {"max_samples", [](Load& l) { l.max_samples = 3; }, "max_samples is 3"},
             {"max_width", [](Load& l) { l.max_width = UINT32_MAX; }, "4294967295 samples per side, at most 16384"},
             {"max_height", [](Load& l) { l.max_height = 4097, l.max_samples = 4; }, "16388 samples per side"},
             {"gpus", [](Load& l) { l.gpus = 17; }, "gpus is 17, at most 16 or SCREE_ALL_GPUS"},
             {"gpus", [](Load& l) { l.gpus = UINT64_MAX; }, "at most 16"},
             {"gpus of the CPU", [](Load& l) { l.backend = SCREE_BACKEND_CPU, l.gpus = 2; }, "names GPUs"},
             {"light", [](Load& l) { l.light = static_cast<scree_light>(4); }, "light is 4, expected 0 to 3"},
             {"light", [](Load& l) { l.backend = SCREE_BACKEND_CPU, l.light = SCREE_LIGHT_SCENE; }, "no lights"},
             {"two lights", [](Load& l) { l.environment = "a.hdr", l.light = SCREE_LIGHT_CAMERA; }, "environment"},
             {"max_shadow_size", [](Load& l) { l.max_shadow_size = 16385; }, "max_shadow_size is 16385, at most 16384"},
             {"reading", [](Load& l) { l.reading = static_cast<scree_reading>(4); }, "reading is 4"},
             {"negative reading", [](Load& l) { set_bits(l.reading); }, "reading is -1, expected 0 to 3"},
             {"negative light", [](Load& l) { set_bits(l.light); }, "light is -1"},
             {"negative backend", [](Load& l) { set_bits(l.backend); }, "backend is -1"}},
            [&](const Load& options) { return scree_load(s.opened.file, &options, &s.out.scene); });
  rows.push_back({"scree_load", "a GPU that is not there",
                  [&] {
                    auto options = sized<Load>();
                    options.gpu = "63";
                    return scree_load(s.opened.file, &options, &s.out.scene);
                  },
                  SCREE_ERROR_DEVICE, "scree"});
  const auto surroundings = [&](const char* what, std::string name, scree_status status, const char* part) {
    rows.push_back({"scree_load", what,
                    [&s, name] {
                      auto options = sized<Load>();
                      options.backend = SCREE_BACKEND_CPU;
                      options.environment = name.c_str();
                      return scree_load(s.opened.file, &options, &s.out.scene);
                    },
                    status, part});
  };
  surroundings("missing surroundings", s.folder.file("missing.hdr"), SCREE_ERROR_FILE, "missing.hdr");
  surroundings("surroundings that are a folder", s.folder.file(""), SCREE_ERROR_FILE, "is a folder");
  surroundings("surroundings of another kind", s.path, SCREE_ERROR_DATA, "is no Radiance picture");

  using Draw = scree_draw_options;
  const std::vector<Change<Draw>> sizes{{"samples", [](Draw& d) { d.samples = 3; }, "samples is 3"},
                                        {"samples", [](Draw& d) { d.samples = UINT32_MAX; }, "samples is 4294967295"},
                                        {"width", [](Draw& d) { d.width = 16385; }, "16385"},
                                        {"width", [](Draw& d) { d.width = UINT32_MAX, d.samples = 4; }, "17179869180"},
                                        {"height", [](Draw& d) { d.height = 4097, d.samples = 4; }, "16388"}};
  const std::vector<Change<Draw>> shading{
      {"show", [](Draw& d) { d.show = static_cast<scree_show>(9); }, "show is 9"},
      {"show", [](Draw& d) { d.show = SCREE_SHOW_32_BITS; }, "show is"},
      {"negative show", [](Draw& d) { set_bits(d.show); }, "show is -1, expected 0 to 8"},
      {"negative light", [](Draw& d) { set_bits(d.light); }, "light is -1"},
      {"flags", [](Draw& d) { d.flags = 32; }, "flags"},
      {"flags", [](Draw& d) { d.flags = UINT32_MAX; }, "flags"},
      {"background", [](Draw& d) { d.background[0] = static_cast<float>(kNan); }, "background"},
      {"background", [](Draw& d) { d.background[3] = -static_cast<float>(kInfinity); }, "background"},
      {"edl_radius", [](Draw& d) { d.edl_radius = 65; }, "edl_radius is 65, at most 64"},
      {"edl_strength", [](Draw& d) { d.edl_strength = static_cast<float>(kNan); }, "edl_strength"},
      {"edl_strength", [](Draw& d) { d.edl_strength = -1; }, "edl_strength is -1.000000, expected 0 to 100"},
      {"exposure", [](Draw& d) { d.exposure = kNan; }, "exposure"},
      {"exposure", [](Draw& d) { d.exposure = -21; }, "exposure"},
      {"light", [](Draw& d) { d.light = static_cast<scree_light>(4); }, "light is 4"},
      {"light that is off", [](Draw& d) { d.light = SCREE_LIGHT_CAMERA, d.flags = SCREE_NO_LIGHT; }, "exclude"},
      {"light that was not loaded", [](Draw& d) { d.light = SCREE_LIGHT_ENVIRONMENT; }, "without an environment"},
      {"light that the file lacks", [](Draw& d) { d.light = SCREE_LIGHT_SCENE; }, "no lights"},
      {"blend_layers", [](Draw& d) { d.blend_layers = 65536; }, "blend_layers is 65536"},
      {"shadow_size", [](Draw& d) { d.shadow_size = 63; }, "shadow_size is 63, expected 64 to 16384"},
      {"shadow_size", [](Draw& d) { d.shadow_size = 16385; }, "shadow_size is 16385"},
      {"shadow_size", [](Draw& d) { d.shadow_size = UINT64_MAX; }, "shadow_size is 18446744073709551615"},
      {"shadows of another light", [](Draw& d) { d.flags = SCREE_SHADOWS; }, "SCREE_SHADOWS is for SCREE_LIGHT_SCENE"},
      {"shadows without light", [](Draw& d) { d.flags = SCREE_SHADOWS | SCREE_NO_LIGHT; }, "SCREE_LIGHT_SCENE"}};
  // A batch's target, with memory for two pictures of 8 x 8 floats.
  const auto target = [&] {
    auto block = sized<scree_target>();
    block.data = s.out.buffer.data();
    block.bytes = 256;
    block.layer = SCREE_DEPTH;
    return block;
  };
  for (const std::vector<Change<Draw>>& changes : {sizes, shading}) {
    add<Draw>(rows, "scree_draw", changes, [&](const Draw& d) { return scree_draw(s.opened.view, nullptr, &d); });
    add<Draw>(rows, "scree_draw_batch", changes,
              [&](const Draw& d) { return scree_draw_batch(s.opened.view, &default_camera, 1, &d, 1); });
    add<Draw>(rows, "scree_draw_batch_to", changes, [&, target](const Draw& d) {
      const scree_target block = target();
      return scree_draw_batch_to(s.opened.view, &default_camera, 1, &d, &block, 1, nullptr);
    });
  }
  add<Draw>(rows, "scree_shade", shading, [&](const Draw& d) { return scree_shade(s.opened.view, &d); });

  using Batch = std::function<scree_status(uint32_t count, uint32_t layers)>;
  const Batch batch = [&](uint32_t count, uint32_t layers) {
    const std::vector<scree_camera> cameras(2, sized<scree_camera>());
    const scree_draw_options options = draw_options(8, 8);
    return scree_draw_batch(s.opened.view, cameras.data(), count, &options, layers);
  };
  for (const auto& [what, count, layers] : {std::tuple("no cameras", 0u, 1u),
                                            {"no layers", 2u, 0u},
                                            {"samples", 2u, 1u << SCREE_SAMPLES},
                                            {"linear", 1u, 1u << SCREE_LINEAR},
                                            {"an unknown layer", 1u, 1u << 31 | 1u}})
    rows.push_back(
        {"scree_draw_batch", what, [=] { return batch(count, layers); }, SCREE_ERROR_ARGUMENT, "a batch has"});
  const auto two_cameras = [&](std::function<void(std::array<scree_camera, 2>&)> change, uint32_t count) {
    std::array<scree_camera, 2> cameras{sized<scree_camera>(), sized<scree_camera>()};
    change(cameras);
    const scree_draw_options options = draw_options(8, 8);
    return scree_draw_batch(s.opened.view, cameras.data(), count, &options, 1u << SCREE_DEPTH);
  };
  rows.push_back({"scree_draw_batch", "cameras of two sizes",
                  [=] { return two_cameras([](auto& cameras) { cameras[1].size -= 8; }, 2); }, SCREE_ERROR_ARGUMENT,
                  "camera 1 of the batch has another size"});
  rows.push_back({"scree_draw_batch", "a camera that is none",
                  [=] { return two_cameras([](auto& cameras) { cameras[1].fov_degrees = 200; }, 2); },
                  SCREE_ERROR_ARGUMENT, "camera 1: scree_camera::fov_degrees is 200"});

  const auto targets = [&](const char* what, scree_status status, const char* part,
                           std::function<uint32_t(std::array<scree_target, 2>&)> change) {
    rows.push_back({"scree_draw_batch_to", what,
                    [&s, change] {
                      const std::vector<scree_camera> cameras(2, sized<scree_camera>());
                      std::array<scree_target, 2> all{sized<scree_target>(), sized<scree_target>()};
                      all[0].data = s.out.buffer.data();
                      all[0].bytes = 512;
                      all[0].layer = SCREE_DEPTH;
                      const uint32_t count = change(all);
                      const scree_draw_options options = draw_options(8, 8);
                      return scree_draw_batch_to(s.opened.view, cameras.data(), 2, &options, all.data(), count,
                                                 nullptr);
                    },
                    status, part});
  };
  targets("no targets", SCREE_ERROR_ARGUMENT, "none", [](auto&) { return 0u; });
  for (const int32_t layer : {int32_t{SCREE_SAMPLES}, int32_t{SCREE_LINEAR}, 8, INT32_MAX})
    targets("no layer of a batch", SCREE_ERROR_ARGUMENT, "a batch has no layer", [layer](auto& all) {
      all[0].layer = static_cast<scree_layer>(layer);
      return 1u;
    });
  targets("no memory", SCREE_ERROR_ARGUMENT, "null", [](auto& all) { return all[0].data = nullptr, 1u; });
  targets("memory that begins anywhere", SCREE_ERROR_ARGUMENT, "16", [](auto& all) {
    all[0].data = static_cast<char*>(all[0].data) + 4;
    return 1u;
  });
  for (const uint64_t bytes : {uint64_t{0}, uint64_t{511}, uint64_t{513}, UINT64_MAX})
    targets("a buffer of another size", SCREE_ERROR_BUFFER, "bytes, but the layer has 512",
            [bytes](auto& all) { return all[0].bytes = bytes, 1u; });
  targets("one layer twice", SCREE_ERROR_ARGUMENT, "of another", [](auto& all) { return all[1] = all[0], 2u; });
  targets("targets of two sizes", SCREE_ERROR_ARGUMENT, "another size", [](auto& all) { return all[1].size -= 8, 2u; });
  if (on_gpu)
    targets("memory of another device", SCREE_ERROR_ARGUMENT, "not in the memory of GPU 0", [](auto&) { return 1u; });
  else
    rows.push_back({"scree_device_layer", "where the CPU draws",
                    [&] { return scree_device_layer(s.opened.view, SCREE_COLOR, nullptr, &s.out.array); },
                    SCREE_ERROR_DEVICE, "CPU"});
  if (on_gpu)
    rows.push_back({"scree_device_layer", "a layer of the host",
                    [&] { return scree_device_layer(s.opened.view, SCREE_LINEAR, nullptr, &s.out.array); },
                    SCREE_ERROR_ARGUMENT, "linear"});

  using Convert = scree_convert_options;
  add<Convert>(
      rows, "scree_convert",
      {{"flags", [](Convert& c) { c.flags = 1u << 31; }, "flags"},
       {"flags", [](Convert& c) { c.flags = 4096; }, "flags"},
       {"position_bits", [](Convert& c) { c.position_bits = 7; }, "7"},
       {"position_bits", [](Convert& c) { c.position_bits = 25; }, "25"},
       {"max_error", [](Convert& c) { c.max_error = kNan; }, "max-error"},
       {"max_error", [](Convert& c) { c.max_error = -1; }, "max-error"},
       {"max_error", [](Convert& c) { c.max_error = kInfinity; }, "max-error"},
       {"two steps", [](Convert& c) { c.max_error = 1, c.flags = SCREE_CONVERT_FLOAT32; }, "exclude"},
       {"two grids", [](Convert& c) { c.flags = SCREE_CONVERT_GRID_SCENE | SCREE_CONVERT_FLOAT32; }, "exclude"},
       {"zstd_level", [](Convert& c) { c.zstd_level = 23; }, "23"},
       {"zstd_level", [](Convert& c) { c.zstd_level = -2; }, "zstd_level is -2, expected -1 to 22"},
       {"zstd_level", [](Convert& c) { c.zstd_level = INT32_MIN; }, "-2147483648"},
       {"jpeg_quality", [](Convert& c) { c.jpeg_quality = 101; }, "101"},
       {"jpeg_quality", [](Convert& c) { c.jpeg_quality = -1; }, "-1"},
       {"textures", [](Convert& c) { c.textures = static_cast<scree_textures>(3); }, "textures is 3"},
       {"negative textures", [](Convert& c) { set_bits(c.textures); }, "textures is -1"},
       {"threads", [](Convert& c) { c.threads = 4097; }, "4096"},
       {"memory", [](Convert& c) { c.memory = 1000; }, "memory"},
       {"exclude", [](Convert& c) { c.exclude = "(["; }, "(["}},
      [&](const Convert& c) { return scree_convert(s.source.c_str(), s.made.c_str(), &c, &s.out.report); });
}

void add_cameras(std::vector<Misuse>& rows, Subjects& s) {
  using Camera = scree_camera;
  const auto looks = [](double x, double y, double z) {
    return [=](Camera& c) {
      c.kind = SCREE_CAMERA_LOOK_AT;
      c.eye[0] = x;
      c.eye[1] = y;
      c.eye[2] = z;
    };
  };
  /// A valid camera of matrices with one change.
  const auto matrices = [](std::function<void(Camera&)> change) {
    return [change](Camera& c) {
      c.kind = SCREE_CAMERA_MATRICES;
      for (int i = 0; i < 4; ++i) c.view[5 * i] = 1;
      c.view[11] = -4;
      c.projection[0] = c.projection[5] = 1;
      c.projection[10] = -1;
      c.projection[11] = -0.2;
      c.projection[14] = -1;
      change(c);
    };
  };
  const auto clipped = [](std::array<double, 3> low, std::array<double, 3> high) {
    return [=](Camera& c) {
      c.clips = 1;
      std::copy(low.begin(), low.end(), c.clip_min);
      std::copy(high.begin(), high.end(), c.clip_max);
    };
  };
  std::vector<Change<Camera>> changes{
      {"kind", [](Camera& c) { c.kind = static_cast<scree_camera_kind>(5); }, "kind is 5"},
      {"kind", [](Camera& c) { c.kind = SCREE_CAMERA_32_BITS; }, "kind is"},
      {"negative kind", [](Camera& c) { set_bits(c.kind); }, "kind is -1"},
      {"no name", [](Camera& c) { c.kind = SCREE_CAMERA_NAMED; }, "name"},
      {"an empty name", [](Camera& c) { c.kind = SCREE_CAMERA_NAMED, c.name = ""; }, "name"},
      {"an unknown name", [](Camera& c) { c.kind = SCREE_CAMERA_NAMED, c.name = "nobody"; }, "nobody"},
      {"eye in the target", looks(0, 0, 0), "same point"},
      {"a NaN eye", looks(kNan, 0, 0), "not finite"},
      {"an infinite eye", looks(0, kInfinity, 0), "not finite"},
      {"a NaN target", [](Camera& c) { c.kind = SCREE_CAMERA_LOOK_AT, c.target[1] = kNan; }, "not finite"},
      {"a NaN up", [](Camera& c) { c.up[2] = kNan; }, "not finite"},
      {"up along the view", [looks](Camera& c) { looks(3, 0, 0)(c), c.up[0] = 1; }, "up"},
      {"fov_degrees", [](Camera& c) { c.fov_degrees = 180; }, "fov_degrees"},
      {"fov_degrees", [](Camera& c) { c.fov_degrees = -1; }, "fov_degrees"},
      {"fov_degrees", [](Camera& c) { c.fov_degrees = kNan; }, "fov_degrees"},
      {"turn_degrees", [](Camera& c) { c.kind = SCREE_CAMERA_AROUND, c.turn_degrees = kNan; }, "turn_degrees"},
      {"rise_degrees", [](Camera& c) { c.kind = SCREE_CAMERA_AROUND, c.rise_degrees = 91; }, "rise_degrees"},
      {"rise_degrees", [](Camera& c) { c.kind = SCREE_CAMERA_AROUND, c.rise_degrees = kNan; }, "rise_degrees"},
      {"no matrices", [](Camera& c) { c.kind = SCREE_CAMERA_MATRICES; }, "rotation"},
      {"a mirror", matrices([](Camera& c) { c.view[0] = -1; }), "rotation"},
      {"a NaN view", matrices([](Camera& c) { c.view[3] = kNan; }), "rotation"},
      {"no projection", matrices([](Camera& c) { std::fill_n(c.projection, 16, 0.0); }), "projection"},
      {"no middle", matrices([](Camera& c) { c.projection[2] = 0.1; }), "middle of the picture"},
      {"no near plane", matrices([](Camera& c) { c.projection[11] = 0; }), "near plane"},
      {"a NaN projection", matrices([](Camera& c) { c.projection[0] = kNan; }), "projection"},
      {"a NaN near plane", matrices([](Camera& c) { c.z_near = kNan; }), "z_near"},
      {"an infinite near plane", matrices([](Camera& c) { c.z_near = kInfinity; }), "z_near"},
      {"a box of NaN", clipped({0, kNan, 0}, {1, 1, 1}), "clip_min and clip_max"},
      {"a box without end", clipped({0, 0, 0}, {1, 1, kInfinity}), "clip_min and clip_max"},
      {"a box turned inside out", clipped({0, 2, 0}, {1, 1, 1}), "clip_min and clip_max"}};
  add<Camera>(rows, "scree_draw", changes, [&](const Camera& camera) {
    const scree_draw_options options = draw_options(8, 8);
    return scree_draw(s.opened.view, &camera, &options);
  });
  add<Camera>(rows, "scree_draw_batch", changes, [&](const Camera& camera) {
    const scree_draw_options options = draw_options(8, 8);
    return scree_draw_batch(s.opened.view, &camera, 1, &options, 1);
  });
}

void check_table(scree_backend backend) {
  Subjects s(backend);
  std::vector<Misuse> rows;
  add_nulls(rows, s);
  add_files(rows, s);
  add_numbers(rows, s);
  add_options(rows, s, backend == SCREE_BACKEND_CUDA);
  add_cameras(rows, s);
  // These calls fail only because of their handle, or never.
  std::set<std::string> functions{"scree_version", "scree_api_version", "scree_error",        "scree_status_name",
                                  "scree_close",   "scree_unload",      "scree_view_destroy", "scree_release"};
  for (const Misuse& row : rows) {
    INFO(row.function << ": " << row.what);
    const std::string before = s.out.bytes();
    (void)scree_close(reinterpret_cast<scree_file*>(&s));  // sets a text that no row expects
    const std::string old_text = scree_error();
    failed(row.call(), row.status, row.part);
    CHECK(scree_error() != old_text);
    CHECK((s.out.bytes() == before));
    CHECK_FALSE(std::filesystem::exists(s.made));
    functions.insert(row.function);
  }
  // The earlier frame is kept.
  must(scree_read(s.opened.view, SCREE_COLOR, s.out.buffer.data(), 280));
  CHECK(functions == listed("function"));
}

}  // namespace

TEST_CASE("every misuse returns an error with a line of text", "[library][misuse]") {
  check_table(SCREE_BACKEND_CPU);
}

TEST_CASE("every misuse returns an error with a line of text when a GPU draws", "[library][misuse][cuda]") {
  if (!has_gpu()) return;
  check_table(SCREE_BACKEND_CUDA);
}
