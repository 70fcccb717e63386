// Helpers for the library's tests: models as .scree files, and handles that are freed when a test ends.
#pragma once

#include <scree/scree.h>

#include <cstring>
#include <string>
#include <vector>

#include "tests/models.h"
#include "tests/tools/temp_folder.h"

namespace scree::tests {

/// A structure of scree.h, all zeros except for its size.
template <class T>
T sized() {
  T value{};
  value.size = sizeof value;
  return value;
}

/// If the call failed, the test fails with the library's error text.
inline void must(scree_status status) {
  INFO(scree_status_name(status) << ": " << scree_error());
  REQUIRE(status == SCREE_OK);
}

/// A model of tests/data, packed into `folder`.
inline std::string packed(const TempFolder& folder, const char* model = "textured_cube.glb", uint32_t flags = 0) {
  const std::string path = folder.file(std::string(model) + ".scree");
  auto options = sized<scree_convert_options>();
  options.flags = flags | SCREE_CONVERT_REPLACE;
  options.threads = 2;
  must(scree_convert(data_path(model).c_str(), path.c_str(), &options, nullptr));
  return path;
}

inline scree_load_options load_options(scree_backend backend, uint64_t device_memory = 0) {
  auto options = sized<scree_load_options>();
  options.backend = backend;
  options.threads = 2;
  options.device_memory = device_memory;
  return options;
}

/// A file, its default scene and a view of it.
struct Opened {
  scree_file* file = nullptr;
  scree_scene* scene = nullptr;
  scree_view* view = nullptr;

  explicit Opened(const std::string& path, scree_backend backend = SCREE_BACKEND_CPU, uint64_t device_memory = 0)
      : Opened(path, load_options(backend, device_memory)) {}
  Opened(const std::string& path, const scree_load_options& options) {
    must(scree_open(path.c_str(), &file));
    must(scree_load(file, &options, &scene));
    must(scree_view_create(scene, &view));
  }
  Opened(const Opened&) = delete;
  Opened& operator=(const Opened&) = delete;
  ~Opened() {
    (void)scree_view_destroy(view);
    (void)scree_unload(scene);
    (void)scree_close(file);
  }
};

inline scree_draw_options draw_options(uint32_t width, uint32_t height, uint32_t samples = 1) {
  auto options = sized<scree_draw_options>();
  options.width = width;
  options.height = height;
  options.samples = samples;
  return options;
}

/// Another view of a scene, for the lifetime of this object.
class NewView {
 public:
  explicit NewView(scree_scene* scene) { must(scree_view_create(scene, &view_)); }
  NewView(const NewView&) = delete;
  NewView& operator=(const NewView&) = delete;
  ~NewView() { CHECK(scree_view_destroy(view_) == SCREE_OK); }
  operator scree_view*() const { return view_; }

 private:
  scree_view* view_ = nullptr;
};

/// Draws a frame. `camera` null: the default one.
inline void draw(scree_view* view, const scree_draw_options& options, const scree_camera* camera = nullptr) {
  must(scree_draw(view, camera, &options));
}

inline scree_scene_stats stats_of(scree_scene* scene) {
  auto stats = sized<scree_scene_stats>();
  must(scree_get_scene_stats(scene, &stats));
  return stats;
}

inline scree_frame_stats frame_stats_of(scree_view* view) {
  auto stats = sized<scree_frame_stats>();
  must(scree_get_frame_stats(view, &stats));
  return stats;
}

inline scree_pick_info pick_at(scree_view* view, uint32_t x, uint32_t y) {
  auto pick = sized<scree_pick_info>();
  must(scree_pick(view, x, y, &pick));
  return pick;
}

inline scree_array host_layer(scree_view* view, scree_layer layer) {
  auto array = sized<scree_array>();
  must(scree_host_layer(view, layer, &array));
  return array;
}

inline scree_array device_layer(scree_view* view, scree_layer layer) {
  auto array = sized<scree_array>();
  must(scree_device_layer(view, layer, nullptr, &array));
  return array;
}

inline scree_target target_of(scree_layer layer, void* data, uint64_t bytes) {
  auto target = sized<scree_target>();
  target.data = data;
  target.bytes = bytes;
  target.layer = layer;
  return target;
}

inline std::string bytes_of(const scree_array& array) {
  return {static_cast<const char*>(array.data), array.bytes};
}

/// A copy of a layer's bytes.
inline std::string layer_of(scree_view* view, scree_layer layer) {
  return bytes_of(host_layer(view, layer));
}

inline constexpr scree_layer kAllLayers[] = {SCREE_COLOR,   SCREE_DEPTH,  SCREE_TRIANGLE, SCREE_INSTANCE,
                                             SCREE_SAMPLES, SCREE_NORMAL, SCREE_UV,       SCREE_LINEAR};

/// The layers of batches.
inline constexpr uint32_t kPixelLayers = 0x7f & ~(1u << SCREE_SAMPLES);
inline constexpr uint32_t kIdLayers = 1u << SCREE_DEPTH | 1u << SCREE_TRIANGLE | 1u << SCREE_INSTANCE;

/// All layers, concatenated.
inline std::string frame_of(scree_view* view) {
  std::string bytes;
  for (const scree_layer layer : kAllLayers) bytes += layer_of(view, layer);
  return bytes;
}

template <class T>
std::vector<T> values_of(const std::string& bytes) {
  std::vector<T> values(bytes.size() / sizeof(T));
  std::memcpy(values.data(), bytes.data(), values.size() * sizeof(T));
  return values;
}

}  // namespace scree::tests
