// Cameras in Python.
#ifndef SCREE_PYTHON_CAMERAS_H
#define SCREE_PYTHON_CAMERAS_H

#include <pybind11/pybind11.h>

#include <scree/scree.hpp>

#include <cstdint>
#include <string>
#include <vector>

namespace scree_python {

namespace py = pybind11;

/// A camera and the memory of its name.
struct Camera {
  scree_camera camera = scree::make<scree_camera>();
  std::string name;

  const scree_camera& get() {
    camera.name = name.empty() ? nullptr : name.c_str();
    return camera;
  }
};

/// None, a Camera, or the name (as bytes too) or number of a camera of the file.
Camera camera_of(const py::object& given);

/// The cameras of a batch, one after the other in memory.
class Cameras {
 public:
  explicit Cameras(const std::vector<py::object>& given) {
    if (given.empty()) throw py::value_error("a batch needs at least one camera");
    for (const py::object& camera : given) named_.push_back(camera_of(camera));
    for (Camera& camera : named_) cameras_.push_back(camera.get());
  }
  Cameras(const Cameras&) = delete;
  Cameras& operator=(const Cameras&) = delete;

  const scree_camera* data() const { return cameras_.data(); }
  uint32_t count() const { return static_cast<uint32_t>(cameras_.size()); }

 private:
  std::vector<Camera> named_;  // have the names to which `cameras_` points
  std::vector<scree_camera> cameras_;
};

/// Adds Camera and the functions that make cameras to the module.
void add_cameras(py::module_& module);

}  // namespace scree_python

#endif
