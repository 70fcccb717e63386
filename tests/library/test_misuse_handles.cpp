// Invalid handles and structures, and the state after a failed call.
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <functional>
#include <set>
#include <string>
#include <type_traits>
#include <vector>

#include "tests/library/misuse.h"

using namespace scree::tests;

namespace {

/// The functions that take a `Handle`. Each is called with a handle and valid other arguments.
struct HandleUse {
  const char* function;
  char kind;  // 'f'ile, 's'cene, 'v'iew, 'm'emory
  bool ends;
  std::function<scree_status(void*)> call;
};

std::vector<HandleUse> handle_uses(Subjects& s) {
  Outputs& out = s.out;
  const auto file = [](void* handle) { return static_cast<scree_file*>(handle); };
  const auto scene = [](void* handle) { return static_cast<scree_scene*>(handle); };
  const auto view = [](void* handle) { return static_cast<scree_view*>(handle); };
  static const scree_draw_options options = draw_options(8, 8);
  return {
      {"scree_close", 'f', true, [=](void* h) { return scree_close(file(h)); }},
      {"scree_get_file_info", 'f', false, [=, &out](void* h) { return scree_get_file_info(file(h), &out.file_info); }},
      {"scree_get_scene_info", 'f', false,
       [=, &out](void* h) { return scree_get_scene_info(file(h), 0, &out.scene_info); }},
      {"scree_get_mesh_info", 'f', false,
       [=, &out](void* h) { return scree_get_mesh_info(file(h), 0, &out.mesh_info); }},
      {"scree_get_material_info", 'f', false,
       [=, &out](void* h) { return scree_get_material_info(file(h), 0, &out.material_info); }},
      {"scree_get_camera_info", 'f', false,
       [=, &out](void* h) { return scree_get_camera_info(file(h), 0, 0, &out.camera_info); }},
      {"scree_load", 'f', false, [=, &out](void* h) { return scree_load(file(h), nullptr, &out.scene); }},
      {"scree_unload", 's', true, [=](void* h) { return scree_unload(scene(h)); }},
      {"scree_get_scene_stats", 's', false,
       [=, &out](void* h) { return scree_get_scene_stats(scene(h), &out.scene_stats); }},
      {"scree_get_instance_info", 's', false,
       [=, &out](void* h) { return scree_get_instance_info(scene(h), 0, &out.instance_info); }},
      {"scree_view_create", 's', false, [=, &out](void* h) { return scree_view_create(scene(h), &out.view); }},
      {"scree_view_destroy", 'v', true, [=](void* h) { return scree_view_destroy(view(h)); }},
      {"scree_draw", 'v', false, [=](void* h) { return scree_draw(view(h), &default_camera, &options); }},
      {"scree_draw_batch", 'v', false,
       [=](void* h) { return scree_draw_batch(view(h), &default_camera, 1, &options, 1); }},
      {"scree_draw_batch_to", 'v', false,
       [=, &out](void* h) {
         auto target = sized<scree_target>();
         target.data = out.buffer.data();
         target.bytes = 256;
         return scree_draw_batch_to(view(h), &default_camera, 1, &options, &target, 1, nullptr);
       }},
      {"scree_shade", 'v', false, [=](void* h) { return scree_shade(view(h), &options); }},
      {"scree_host_layer", 'v', false,
       [=, &out](void* h) { return scree_host_layer(view(h), SCREE_COLOR, &out.array); }},
      {"scree_device_layer", 'v', false,
       [=, &out](void* h) { return scree_device_layer(view(h), SCREE_COLOR, nullptr, &out.array); }},
      {"scree_hold", 'v', false, [=, &out](void* h) { return scree_hold(view(h), &out.array, &out.memory); }},
      {"scree_release", 'm', true, [=](void* h) { return scree_release(static_cast<scree_memory*>(h)); }},
      {"scree_read", 'v', false,
       [=, &out](void* h) { return scree_read(view(h), SCREE_COLOR, out.buffer.data(), 280); }},
      {"scree_pick", 'v', false, [=, &out](void* h) { return scree_pick(view(h), 0, 0, &out.pick_info); }},
      {"scree_get_frame_stats", 'v', false,
       [=, &out](void* h) { return scree_get_frame_stats(view(h), &out.frame_stats); }},
  };
}

/// A structure argument of a function. `bytes` begins with the structure's size.
struct StructUse {
  const char* type;
  size_t bytes;
  bool is_input;  // false: it is filled in
  std::function<scree_status(void*)> call;
};

std::vector<StructUse> struct_uses(Subjects& s) {
  const Opened& o = s.opened;
  Outputs& out = s.out;
  static const scree_draw_options options = draw_options(8, 8);
  std::vector<StructUse> uses;
  const auto add_use = [&]<class T>(const char* type, bool is_input,
                                    std::function<scree_status(std::type_identity_t<T>*)> call, T*) {
    uses.push_back({type, sizeof(T), is_input, [call](void* bytes) { return call(static_cast<T*>(bytes)); }});
  };
#define INPUT(type, ...) \
  add_use(               \
      #type, true, [&](type* value) -> scree_status { return __VA_ARGS__; }, static_cast<type*>(nullptr))
#define OUTPUT(type, ...) \
  add_use(                \
      #type, false, [&](type* value) -> scree_status { return __VA_ARGS__; }, static_cast<type*>(nullptr))
  OUTPUT(scree_file_info, scree_get_file_info(o.file, value));
  OUTPUT(scree_scene_info, scree_get_scene_info(o.file, 0, value));
  OUTPUT(scree_mesh_info, scree_get_mesh_info(o.file, 0, value));
  OUTPUT(scree_material_info, scree_get_material_info(o.file, 0, value));
  OUTPUT(scree_camera_info, scree_get_camera_info(o.file, 0, 0, value));
  INPUT(scree_load_options, scree_load(o.file, value, &out.scene));
  OUTPUT(scree_scene_stats, scree_get_scene_stats(o.scene, value));
  OUTPUT(scree_instance_info, scree_get_instance_info(o.scene, 0, value));
  INPUT(scree_camera, scree_draw(o.view, value, &options));
  INPUT(scree_camera, scree_draw_batch(o.view, value, 1, &options, 1));
  INPUT(scree_draw_options, scree_draw(o.view, nullptr, value));
  INPUT(scree_draw_options, scree_draw_batch(o.view, &default_camera, 1, value, 1));
  INPUT(scree_draw_options, scree_shade(o.view, value));
  OUTPUT(scree_array, scree_host_layer(o.view, SCREE_COLOR, value));
  OUTPUT(scree_array, scree_device_layer(o.view, SCREE_DEPTH, nullptr, value));
  INPUT(scree_array, scree_hold(o.view, value, &out.memory));
  INPUT(scree_target, scree_draw_batch_to(o.view, &default_camera, 1, &options, value, 1, nullptr));
  OUTPUT(scree_pick_info, scree_pick(o.view, 0, 0, value));
  OUTPUT(scree_frame_stats, scree_get_frame_stats(o.view, value));
  INPUT(scree_convert_options, scree_convert(s.source.c_str(), s.made.c_str(), value, nullptr));
  OUTPUT(scree_convert_report, scree_convert(s.source.c_str(), s.made.c_str(), nullptr, value));
  OUTPUT(scree_camera, scree_cameras_of_path(s.film.c_str(), 0, 0, 1, value, nullptr));
  OUTPUT(scree_path_info, scree_cameras_of_path(s.film.c_str(), 0, 0, 0, nullptr, value));
#undef INPUT
#undef OUTPUT
  return uses;
}

}  // namespace

TEST_CASE("ended handles, handles of another kind and other numbers are refused", "[library][misuse]") {
  Subjects s(SCREE_BACKEND_CPU);
  scree_memory* memory = nullptr;
  const scree_array array = host_layer(s.opened.view, SCREE_COLOR);
  must(scree_hold(s.opened.view, &array, &memory));
  struct Kind {
    char kind;
    void* ended;
    void* lives;
    const char* type;
  };
  std::vector<Kind> kinds;
  {
    const Opened ended(s.path);
    scree_memory* released = nullptr;
    must(scree_hold(s.opened.view, &array, &released));
    must(scree_release(released));
    kinds = {{'f', ended.file, s.opened.file, "scree_file"},
             {'s', ended.scene, s.opened.scene, "scree_scene"},
             {'v', ended.view, s.opened.view, "scree_view"},
             {'m', released, memory, "scree_memory"}};
  }
  const std::string before = s.out.bytes();
  std::set<char> tried;
  std::set<std::string> functions;
  int local = 0;
  for (const HandleUse& use : handle_uses(s)) {
    INFO(use.function);
    tried.insert(use.kind);
    functions.insert(use.function);
    for (const Kind& kind : kinds) {
      if (use.kind == kind.kind) {
        const std::string text = std::string("the handle is not a ") + kind.type + ", or was ended";
        failed(use.call(kind.ended), SCREE_ERROR_HANDLE, text);
        failed(use.call(&local), SCREE_ERROR_HANDLE, text);
        failed(use.call(reinterpret_cast<void*>(UINTPTR_MAX)), SCREE_ERROR_HANDLE, text);
        if (use.ends)
          CHECK(use.call(nullptr) == SCREE_OK);
        else
          failed(use.call(nullptr), SCREE_ERROR_ARGUMENT, std::string("the ") + kind.type + " is null");
      } else {
        failed(use.call(kind.lives), SCREE_ERROR_HANDLE, "the handle is not a ");
      }
    }
    CHECK((s.out.bytes() == before));
  }
  CHECK(tried.size() == kinds.size());
  for (const char* const name : {"scree_version", "scree_api_version", "scree_error", "scree_status_name", "scree_open",
                                 "scree_convert", "scree_cameras_of_path"})
    functions.insert(name);  // functions that take no handle
  CHECK(functions == listed("function"));
  must(scree_release(memory));

  // Data exist as long as a handle needs them. Handles are never reused.
  scree_file* file = nullptr;
  scree_scene* scene = nullptr;
  scree_view* view = nullptr;
  must(scree_open(s.path.c_str(), &file));
  auto load = sized<scree_load_options>();
  load.backend = SCREE_BACKEND_CPU;
  must(scree_load(file, &load, &scene));
  must(scree_view_create(scene, &view));
  must(scree_close(file));
  must(scree_unload(scene));
  draw(view, draw_options(8, 8));
  must(scree_view_destroy(view));
  scree_file* again = nullptr;
  must(scree_open(s.path.c_str(), &again));
  CHECK(again != file);
  must(scree_close(again));
}

TEST_CASE("structures of unknown sizes are refused, and sizes of other versions are accepted", "[library][misuse]") {
  Subjects s(SCREE_BACKEND_CPU);
  const std::string before = s.out.bytes();
  std::set<std::string> types;
  for (const StructUse& use : struct_uses(s)) {
    INFO(use.type);
    types.insert(use.type);
    alignas(16) std::array<unsigned char, 4096> bytes{};
    const auto give_size = [&](size_t size, unsigned char fill) {
      bytes.fill(fill);
      std::memcpy(bytes.data(), &size, sizeof size);
    };
    for (const size_t size : {size_t{0}, size_t{8}, size_t{15}, use.bytes - 1, use.bytes + 4, size_t{4104}, SIZE_MAX}) {
      give_size(size, 0);
      const auto given = bytes;
      INFO("size " << size);
      failed(use.call(bytes.data()), SCREE_ERROR_ARGUMENT,
             std::string(use.type) + "::size is " + std::to_string(size) + ", expected sizeof(" + use.type + "), " +
                 std::to_string(use.bytes));
      CHECK((bytes == given));
    }
    if (!use.is_input) continue;
    // The structure of a newer version, whose new field is set.
    give_size(use.bytes + 8, 0);
    bytes[use.bytes] = 1;
    failed(use.call(bytes.data()), SCREE_ERROR_ARGUMENT, "version of scree lacks");
  }
  CHECK((s.out.bytes() == before));
  CHECK_FALSE(std::filesystem::exists(s.made));
  CHECK(types == listed("struct"));

  struct {
    scree_draw_options known;
    uint64_t more;
  } newer{draw_options(8, 8), 0};
  newer.known.size = sizeof newer;
  must(scree_draw(s.opened.view, nullptr, &newer.known));

  // The structure of an older program is filled in up to its own size.
  struct {
    scree_file_info known;
  } older{};
  older.known.size = offsetof(scree_file_info, triangles);
  older.known.triangles = 77;
  must(scree_get_file_info(s.opened.file, &older.known));
  CHECK(older.known.bytes > 0);
  CHECK(older.known.triangles == 77);
}

TEST_CASE("a failed draw leaves no frame, and a refused call keeps the frame", "[library][misuse]") {
  Subjects s(SCREE_BACKEND_CPU);
  scree_view* const view = s.opened.view;
  scree_draw_options options = draw_options(10, 7);
  std::vector<unsigned char> buffer(280, 9);
  must(scree_read(view, SCREE_COLOR, buffer.data(), 280));
  options.samples = 3;
  failed(scree_draw(view, nullptr, &options), SCREE_ERROR_ARGUMENT, "samples");
  must(scree_read(view, SCREE_COLOR, buffer.data(), 280));
  options.samples = 1;

  const auto cameras = std::vector<scree_camera>(2, sized<scree_camera>());
  must(scree_draw_batch(view, cameras.data(), 2, &options, 1u << SCREE_DEPTH));
  failed(scree_host_layer(view, SCREE_COLOR, &s.out.array), SCREE_ERROR_ARGUMENT, "without this layer");
  failed(scree_pick(view, 0, 0, &s.out.pick_info), SCREE_ERROR_ARGUMENT, "batch");
  failed(scree_shade(view, &options), SCREE_ERROR_ARGUMENT, "batch");

  auto flat = sized<scree_camera>();
  flat.kind = SCREE_CAMERA_MATRICES;
  for (int i = 0; i < 4; ++i) flat.view[5 * i] = 1;
  flat.projection[0] = flat.projection[5] = kInfinity;
  flat.projection[14] = -1;
  flat.z_near = 0.1;
  failed(scree_draw(view, &flat, &options), SCREE_ERROR_ARGUMENT, "empty or infinite field of view");
  failed(scree_read(view, SCREE_COLOR, buffer.data(), 280), SCREE_ERROR_NO_FRAME, "the last draw failed");
  must(scree_draw(view, nullptr, &options));

  CHECK(std::string(scree_status_name(SCREE_ERROR_BUFFER)) == "SCREE_ERROR_BUFFER");
  for (const int number : {11, 99, INT32_MAX})
    CHECK(std::string(scree_status_name(static_cast<scree_status>(number))) == "SCREE_ERROR_INTERNAL");
}
