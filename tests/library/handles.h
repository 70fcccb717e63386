// Helpers for the library's tests: models as .scree files, and handles that are freed when a test ends.
#pragma once

#include <scree/scree.h>

#include <cstring>
#include <string>
#include <vector>

#include "tests/catch.h"
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

/// A file, its default scene and a view of it.
struct Opened {
  scree_file* file = nullptr;
  scree_scene* scene = nullptr;
  scree_view* view = nullptr;

  explicit Opened(const std::string& path, scree_backend backend = SCREE_BACKEND_CPU, uint64_t device_memory = 0)
      : Opened(path, options(backend, device_memory)) {}
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

 private:
  static scree_load_options options(scree_backend backend, uint64_t device_memory) {
    auto options = sized<scree_load_options>();
    options.backend = backend;
    options.threads = 2;
    options.device_memory = device_memory;
    return options;
  }
};

inline scree_draw_options draw_options(uint32_t width, uint32_t height, uint32_t samples = 1) {
  auto options = sized<scree_draw_options>();
  options.width = width;
  options.height = height;
  options.samples = samples;
  return options;
}

/// A copy of a layer's bytes.
inline std::string layer_of(scree_view* view, scree_layer layer) {
  auto array = sized<scree_array>();
  must(scree_host_layer(view, layer, &array));
  return {static_cast<const char*>(array.data), array.bytes};
}

inline constexpr scree_layer kAllLayers[] = {SCREE_COLOR,   SCREE_DEPTH,  SCREE_TRIANGLE, SCREE_INSTANCE,
                                             SCREE_SAMPLES, SCREE_NORMAL, SCREE_UV,       SCREE_LINEAR};

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
