// The interface of scree.h for C++17, with handles that end themselves, and errors as exceptions. All functions are
// inline. The comments of scree.h apply here too, and its functions may be used beside these.
#pragma once

#include <scree/scree.h>

#include <array>
#include <cstdint>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

namespace scree {
inline namespace api {

/// The error of a call that failed; what() is its line of text.
class Error : public std::runtime_error {
 public:
  explicit Error(scree_status status) : std::runtime_error(scree_error()), status_(status) {}
  scree_status status() const noexcept { return status_; }

 private:
  scree_status status_;
};

inline void check(scree_status status) {
  if (status != SCREE_OK) throw Error(status);
}

/// A structure of scree.h, all zeros except its size: `auto options = scree::make<scree_draw_options>();`
template <class T>
T make() {
  T value{};
  value.size = sizeof value;
  return value;
}

using Vec3 = std::array<double, 3>;
using Mat4 = std::array<double, 16>;

// Cameras. The default camera shows all of the scene.

inline scree_camera look_at(const Vec3& eye, const Vec3& target, const Vec3& up = {}, double fov_degrees = 45) {
  auto camera = make<scree_camera>();
  camera.kind = SCREE_CAMERA_LOOK_AT;
  for (int i = 0; i < 3; ++i) {
    camera.eye[i] = eye[i];
    camera.target[i] = target[i];
    camera.up[i] = up[i];
  }
  camera.fov_degrees = fov_degrees;
  return camera;
}

/// `name` outlives the camera.
inline scree_camera named_camera(const char* name) {
  auto camera = make<scree_camera>();
  camera.kind = SCREE_CAMERA_NAMED;
  camera.name = name;
  return camera;
}

/// A camera that shows all of the scene, from `turn_degrees` to the right of its front and `rise_degrees` above it.
inline scree_camera around(double turn_degrees, double rise_degrees, const Vec3& up = {},
                           double fov_degrees = 45) {
  auto camera = make<scree_camera>();
  camera.kind = SCREE_CAMERA_AROUND;
  camera.turn_degrees = turn_degrees;
  camera.rise_degrees = rise_degrees;
  for (int i = 0; i < 3; ++i) camera.up[i] = up[i];
  camera.fov_degrees = fov_degrees;
  return camera;
}

/// Both matrices are row-major.
inline scree_camera matrix_camera(const Mat4& view, const Mat4& projection, double z_near = 0) {
  auto camera = make<scree_camera>();
  camera.kind = SCREE_CAMERA_MATRICES;
  for (int i = 0; i < 16; ++i) {
    camera.view[i] = view[i];
    camera.projection[i] = projection[i];
  }
  camera.z_near = z_near;
  return camera;
}

/// `camera` with a clipping box: scree_camera::clips.
inline scree_camera clipped(scree_camera camera, const Vec3& box_min, const Vec3& box_max) {
  camera.clips = 1;
  for (int i = 0; i < 3; ++i) {
    camera.clip_min[i] = box_min[i];
    camera.clip_max[i] = box_max[i];
  }
  return camera;
}

/// The info of a camera's path. `frames_per_second`: 0 takes the file's.
inline scree_path_info path_info(const std::string& file, double frames_per_second = 0) {
  auto info = make<scree_path_info>();
  check(scree_cameras_of_path(file.c_str(), frames_per_second, 0, 0, nullptr, &info));
  return info;
}

/// scree_cameras_of_path(): the cameras of `count` frames from `first` on; fewer if the path ends before.
inline std::vector<scree_camera> cameras_of_path(const std::string& file, double frames_per_second = 0,
                                                 std::uint64_t first = 0, std::uint64_t count = UINT64_MAX) {
  const std::uint64_t frames = path_info(file, frames_per_second).frames;
  const std::uint64_t rest = first < frames ? frames - first : 0;
  std::vector<scree_camera> cameras(count < rest ? count : rest, make<scree_camera>());
  check(scree_cameras_of_path(file.c_str(), frames_per_second, first, cameras.size(), cameras.data(), nullptr));
  return cameras;
}

class View {
 public:
  explicit View(scree_scene* scene) {
    scree_view* view = nullptr;
    check(scree_view_create(scene, &view));
    handle_.reset(view);
  }

  void draw(const scree_camera& camera = make<scree_camera>(),
            const scree_draw_options& options = make<scree_draw_options>()) {
    check(scree_draw(handle(), &camera, &options));
  }
  /// scree_draw_batch(): `cameras` follow each other in memory.
  void draw_batch(const scree_camera* cameras, std::uint32_t count, const scree_draw_options& options,
                  std::uint32_t layers) {
    check(scree_draw_batch(handle(), cameras, count, &options, layers));
  }
  /// scree_draw_batch_to(): `targets` follow each other in memory.
  void draw_batch_to(const scree_camera* cameras, std::uint32_t count, const scree_draw_options& options,
                     const scree_target* targets, std::uint32_t target_count, void* stream = nullptr) {
    check(scree_draw_batch_to(handle(), cameras, count, &options, targets, target_count, stream));
  }
  void shade(const scree_draw_options& options) { check(scree_shade(handle(), &options)); }

  scree_array host_layer(scree_layer layer) const {
    auto array = make<scree_array>();
    check(scree_host_layer(handle(), layer, &array));
    return array;
  }
  scree_array device_layer(scree_layer layer, void* stream = nullptr) const {
    auto array = make<scree_array>();
    check(scree_device_layer(handle(), layer, stream, &array));
    return array;
  }
  /// scree_hold(). The memory is released with the last owner of the result.
  std::shared_ptr<scree_memory> hold(const scree_array& array) const {
    scree_memory* memory = nullptr;
    check(scree_hold(handle(), &array, &memory));
    return {memory, [](scree_memory* held) { (void)scree_release(held); }};
  }
  void read(scree_layer layer, void* buffer, std::uint64_t bytes) const {
    check(scree_read(handle(), layer, buffer, bytes));
  }

  scree_pick_info pick(std::uint32_t x, std::uint32_t y) const {
    auto info = make<scree_pick_info>();
    check(scree_pick(handle(), x, y, &info));
    return info;
  }
  scree_frame_stats stats() const {
    auto stats = make<scree_frame_stats>();
    check(scree_get_frame_stats(handle(), &stats));
    return stats;
  }

  scree_view* handle() const { return handle_.get(); }

 private:
  struct End {
    void operator()(scree_view* view) const { (void)scree_view_destroy(view); }
  };
  std::unique_ptr<scree_view, End> handle_;
};

class Scene {
 public:
  Scene(scree_file* file, const scree_load_options& options) {
    scree_scene* scene = nullptr;
    check(scree_load(file, &options, &scene));
    handle_.reset(scene);
  }

  View view() const { return View(handle()); }
  scree_scene_stats stats() const {
    auto stats = make<scree_scene_stats>();
    check(scree_get_scene_stats(handle(), &stats));
    return stats;
  }
  scree_instance_info instance(std::uint64_t index) const {
    auto info = make<scree_instance_info>();
    check(scree_get_instance_info(handle(), index, &info));
    return info;
  }

  scree_scene* handle() const { return handle_.get(); }

 private:
  struct End {
    void operator()(scree_scene* scene) const { (void)scree_unload(scene); }
  };
  std::unique_ptr<scree_scene, End> handle_;
};

class File {
 public:
  explicit File(const std::string& path) {
    scree_file* file = nullptr;
    check(scree_open(path.c_str(), &file));
    handle_.reset(file);
  }

  Scene load(const scree_load_options& options = make<scree_load_options>()) const { return Scene(handle(), options); }

  scree_file_info info() const {
    auto info = make<scree_file_info>();
    check(scree_get_file_info(handle(), &info));
    return info;
  }
  scree_scene_info scene(std::uint32_t index) const {
    auto info = make<scree_scene_info>();
    check(scree_get_scene_info(handle(), index, &info));
    return info;
  }
  scree_mesh_info mesh(std::uint32_t index) const {
    auto info = make<scree_mesh_info>();
    check(scree_get_mesh_info(handle(), index, &info));
    return info;
  }
  scree_material_info material(std::uint32_t index) const {
    auto info = make<scree_material_info>();
    check(scree_get_material_info(handle(), index, &info));
    return info;
  }
  scree_camera_info camera(std::uint32_t scene, std::uint32_t index) const {
    auto info = make<scree_camera_info>();
    check(scree_get_camera_info(handle(), scene, index, &info));
    return info;
  }

  scree_file* handle() const { return handle_.get(); }

 private:
  struct End {
    void operator()(scree_file* file) const { (void)scree_close(file); }
  };
  std::unique_ptr<scree_file, End> handle_;
};

/// As scree_convert(); an empty `output` is `input` with the extension .scree.
inline scree_convert_report convert(const std::string& input, const std::string& output = {},
                                    const scree_convert_options& options = make<scree_convert_options>()) {
  auto report = make<scree_convert_report>();
  check(scree_convert(input.c_str(), output.empty() ? nullptr : output.c_str(), &options, &report));
  return report;
}

}  // namespace api
}  // namespace scree
