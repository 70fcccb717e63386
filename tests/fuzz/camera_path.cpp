// A camera path, as read by scree render --path.
#include "tools/render/camera_path.h"

#include <cmath>
#include <string_view>

#include "tests/fuzz/input.h"

namespace scree::fuzz {

void camera_path(Bytes bytes) {
  const ExactCopy copy(bytes);
  const std::string_view text(reinterpret_cast<const char*>(copy.bytes().data()), copy.bytes().size());
  const Result<tools::CameraPath> path = tools::CameraPath::parse(text);
  if (!path) return must(!path.error().message.empty(), "a refused path is refused with words");
  const uint64_t count = path->frame_count();
  must(count >= 1 && count <= tools::kMaxPathFrames, "a path has a bounded number of frames");
  for (const uint64_t frame : {uint64_t{0}, count / 3, count / 2, count - 1}) {
    const tools::PathKey key = path->at(frame);
    for (const runtime::Vec3* vector : {&key.eye, &key.target, &key.up})
      for (const double value : *vector) must(std::abs(value) <= 1e16, "a camera's coordinates are bounded");
    must(key.fov_degrees > 0 && key.fov_degrees < 180, "a field of view is an angle");
  }
}

}  // namespace scree::fuzz
