// scree_cameras_of_path().
#include <algorithm>
#include <cstring>
#include <optional>
#include <string>

#include "library/status.h"
#include "library/structs.h"
#include "tools/render/camera_path.h"

namespace scree::library {
namespace {

scree_camera camera_of(const tools::PathKey& key) {
  scree_camera camera{};
  camera.kind = SCREE_CAMERA_LOOK_AT;
  std::copy(key.eye.begin(), key.eye.end(), camera.eye);
  std::copy(key.target.begin(), key.target.end(), camera.target);
  std::copy(key.up.begin(), key.up.end(), camera.up);
  camera.fov_degrees = key.fov_degrees;
  return camera;
}

/// Writes the cameras one after the other, cameras->size bytes each. Writes no camera if the up of one is zero.
scree_status give_cameras(const std::string& file, const tools::CameraPath& path, uint64_t first, uint64_t count,
                          scree_camera* cameras) {
  for (uint64_t i = 0; i < count; ++i)
    if (path.at(first + i).up == runtime::Vec3{})  // in a scree_camera, 0 means y
      return fail(SCREE_ERROR_DATA, file + ": frame " + std::to_string(first + i) + ": up has no direction");
  const size_t size = cameras->size;
  auto* next = reinterpret_cast<std::byte*>(cameras);
  for (uint64_t i = 0; i < count; ++i, next += size) {
    auto* const out = reinterpret_cast<scree_camera*>(next);
    std::memset(next, 0, size);
    out->size = size;
    give(out, camera_of(path.at(first + i)));
  }
  return SCREE_OK;
}

}  // namespace
}  // namespace scree::library

using namespace scree::library;

extern "C" scree_status scree_cameras_of_path(const char* file, double frames_per_second, uint64_t first,
                                              uint64_t count, scree_camera* cameras, scree_path_info* info) {
  return guarded([&] {
    SCREE_CHECK(check_path(file, "scree_cameras_of_path: file"));
    if (!(frames_per_second == 0 || (frames_per_second >= 1e-9 && frames_per_second < 1e6)))
      return fail(SCREE_ERROR_ARGUMENT, "scree_cameras_of_path: frames_per_second is " +
                                            std::to_string(frames_per_second) + ", expected above 0 and below 1e6");
    if (count != 0) SCREE_CHECK(check_output(cameras, "scree_camera"));
    if (info != nullptr) SCREE_CHECK(check_output(info, "scree_path_info"));
    const scree::Result<scree::tools::CameraPath> path = scree::tools::CameraPath::read(
        file, frames_per_second > 0 ? std::optional<double>(frames_per_second) : std::nullopt);
    if (!path) return fail(path.error(), Subject::kData);
    const uint64_t frames = path->frame_count();
    const std::string has = std::string(file) + ": has " + std::to_string(frames) + " frames, but ";
    if (first > frames) return fail(SCREE_ERROR_ARGUMENT, has + "frame " + std::to_string(first) + " is wanted");
    if (count > frames - first)
      return fail(SCREE_ERROR_ARGUMENT,
                  has + std::to_string(count) + " from frame " + std::to_string(first) + " on are wanted");
    if (count != 0) SCREE_CHECK(give_cameras(file, *path, first, count, cameras));
    scree_path_info out{};
    out.frames = frames;
    out.frames_per_second = path->frames_per_second();
    if (info != nullptr) give(info, out);
    return SCREE_OK;
  });
}
