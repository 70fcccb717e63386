#include "cameras.h"

#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <optional>
#include <utility>

#include "gil.h"

namespace scree_python {

using namespace py::literals;

Camera camera_of(const py::object& given) {
  Camera camera;
  if (given.is_none()) return camera;
  if (py::isinstance<Camera>(given)) return given.cast<Camera>();
  camera.name = py::isinstance<py::bytes>(given) ? given.cast<std::string>() : py::str(given).cast<std::string>();
  camera.camera.kind = SCREE_CAMERA_NAMED;
  return camera;
}

namespace {

Camera look_at(const scree::Vec3& eye, const std::optional<scree::Vec3>& target, const scree::Vec3& up, double fov) {
  Camera out;
  out.camera = scree::look_at(eye, target.value_or(scree::Vec3{}), up, fov);
  out.camera.look_at_box = target ? 0 : 1;
  return out;
}

Camera around(double turn, double rise, const scree::Vec3& up, double fov) {
  Camera out;
  out.camera = scree::around(turn, rise, up, fov);
  return out;
}

using Matrix = py::array_t<double, py::array::c_style | py::array::forcecast>;

Camera matrices(const Matrix& view, const Matrix& projection, double z_near) {
  Camera out;
  out.camera.kind = SCREE_CAMERA_MATRICES;
  for (const auto& [from, to] : {std::pair(&view, out.camera.view), std::pair(&projection, out.camera.projection)}) {
    if (from->ndim() != 2 || from->shape(0) != 4 || from->shape(1) != 4)
      throw py::value_error("a camera's matrices are 4 x 4");
    std::copy(from->data(), from->data() + 16, to);
  }
  out.camera.z_near = z_near;
  return out;
}

Camera clipped(const py::object& camera, const scree::Vec3& box_min, const scree::Vec3& box_max) {
  Camera out = camera_of(camera);
  out.camera = scree::clipped(out.camera, box_min, box_max);
  return out;
}

std::vector<Camera> cameras_of_path(const std::string& file, double fps, uint64_t first,
                                    std::optional<uint64_t> count) {
  const std::vector<scree_camera> cameras =
      without_gil([&] { return scree::cameras_of_path(file, fps, first, count.value_or(UINT64_MAX)); });
  std::vector<Camera> out(cameras.size());
  for (size_t i = 0; i < cameras.size(); ++i) out[i].camera = cameras[i];
  return out;
}

py::dict path_info(const std::string& file, double fps) {
  const scree_path_info info = without_gil([&] { return scree::path_info(file, fps); });
  return py::dict("frames"_a = info.frames, "fps"_a = info.frames_per_second);
}

}  // namespace

void add_cameras(py::module_& module) {
  py::class_<Camera>(module, "Camera", "A camera of look_at(), around(), matrices(), clipped() or cameras_of_path().");
  module.def("look_at", &look_at, "eye"_a, "target"_a = py::none(), "up"_a = scree::Vec3{0, 1, 0}, "fov"_a = 45.0);
  module.def("around", &around, "turn"_a, "rise"_a, "up"_a, "fov"_a);
  module.def("matrices", &matrices, "view"_a, "projection"_a, "z_near"_a = 0.0);
  module.def("clipped", &clipped, "camera"_a, "box_min"_a, "box_max"_a);
  module.def("cameras_of_path", &cameras_of_path, "path"_a, "fps"_a, "first"_a, "count"_a);
  module.def("path_info", &path_info, "path"_a, "fps"_a);
}

}  // namespace scree_python
