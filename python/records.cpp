#include "records.h"

#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <array>
#include <string>

#include "gil.h"
#include "words.h"

namespace scree_python {

using namespace py::literals;

namespace {

template <class T, size_t kSize>
std::array<T, kSize> array_of(const T (&values)[kSize]) {
  std::array<T, kSize> out{};
  std::copy(values, values + kSize, out.begin());
  return out;
}

/// A list of `count` records.
template <class Record>
std::vector<py::dict> listed(uint32_t count, const Record& record) {
  std::vector<py::dict> out;
  for (uint32_t i = 0; i < count; ++i) out.push_back(record(i));
  return out;
}

}  // namespace

py::dict stats_of(const scree::Scene& scene) {
  const scree_scene_stats stats = scene.stats();
  return py::dict("triangles"_a = stats.triangles, "instances"_a = stats.instances,
                  "box_min"_a = array_of(stats.box_min), "box_max"_a = array_of(stats.box_max),
                  "on_gpu"_a = stats.on_gpu != 0, "gpu"_a = stats.gpu, "gpu_name"_a = text_of(stats.gpu_name),
                  "why_cpu"_a = text_of(stats.why_cpu), "streamed"_a = stats.streamed != 0, "scene"_a = stats.scene,
                  "device_bytes"_a = stats.device_bytes, "load_ms"_a = stats.load_ms, "lights"_a = stats.lights,
                  "light"_a = kLights[stats.light]);
}

/// All instances, an array per column.
py::dict instances_of(const scree::Scene& scene) {
  const auto count = static_cast<py::ssize_t>(scene.stats().instances);
  py::array_t<int32_t> mesh(count), node(count), material(count);
  py::array_t<int64_t> first(count);
  py::array_t<double> world(std::vector<py::ssize_t>{count, 3, 4});
  for (py::ssize_t i = 0; i < count; ++i) {
    const scree_instance_info info = scene.instance(static_cast<uint64_t>(i));
    mesh.mutable_at(i) = static_cast<int32_t>(info.mesh);
    node.mutable_at(i) = static_cast<int32_t>(info.node);
    material.mutable_at(i) = info.material;
    first.mutable_at(i) = static_cast<int64_t>(info.first_triangle);
    std::copy(info.world, info.world + 12, world.mutable_data(i, 0, 0));
  }
  return py::dict("mesh"_a = mesh, "node"_a = node, "material"_a = material, "first_triangle"_a = first,
                  "world"_a = world);
}

py::object pick_of(const scree::View& view, uint32_t x, uint32_t y) {
  const scree_pick_info info = without_gil([&] { return view.pick(x, y); });
  if (info.hit == 0) return py::none();
  return py::dict("mesh"_a = info.mesh, "node"_a = info.node, "node_instance"_a = info.node_instance,
                  "instance"_a = info.instance, "triangle"_a = info.triangle, "mesh_triangle"_a = info.mesh_triangle,
                  "source_triangle"_a = info.source_triangle, "depth"_a = info.depth,
                  "position"_a = array_of(info.position));
}

py::dict stats_of(const scree::View& view) {
  const scree_frame_stats stats = without_gil([&] { return view.stats(); });
  return py::dict("width"_a = stats.width, "height"_a = stats.height, "samples"_a = stats.samples,
                  "instances"_a = stats.instances, "triangles"_a = stats.triangles, "clusters"_a = stats.clusters,
                  "draw_ms"_a = stats.draw_ms, "gpu_ms"_a = stats.gpu_ms, "streamed_bytes"_a = stats.streamed_bytes,
                  "cameras"_a = stats.cameras, "blended_layers"_a = stats.blended_layers,
                  "samples_with_more_layers"_a = stats.samples_with_more_layers, "shadow_ms"_a = stats.shadow_ms);
}

std::vector<py::dict> scenes_of(const scree::File& file) {
  return listed(file.info().scenes, [&](uint32_t i) {
    const scree_scene_info info = file.scene(i);
    return py::dict("name"_a = text_of(info.name), "triangles"_a = info.triangles, "instances"_a = info.instances,
                    "cameras"_a = info.cameras);
  });
}

std::vector<py::dict> meshes_of(const scree::File& file) {
  return listed(file.info().meshes, [&](uint32_t i) {
    const scree_mesh_info info = file.mesh(i);
    return py::dict("name"_a = text_of(info.name), "triangles"_a = info.triangles, "vertices"_a = info.vertices,
                    "box_min"_a = array_of(info.box_min), "box_max"_a = array_of(info.box_max),
                    "max_position_error"_a = info.max_position_error, "material"_a = info.material,
                    "has_uv"_a = (info.attributes & 1) != 0, "has_color"_a = (info.attributes & 2) != 0,
                    "has_normal"_a = (info.attributes & 4) != 0);
  });
}

std::vector<py::dict> materials_of(const scree::File& file) {
  return listed(file.info().materials, [&](uint32_t i) {
    const scree_material_info info = file.material(i);
    return py::dict("name"_a = text_of(info.name), "base_color"_a = array_of(info.base_color),
                    "texture"_a = info.texture, "double_sided"_a = (info.flags & 1) != 0,
                    "unlit"_a = (info.flags & 2) != 0);
  });
}

std::vector<py::dict> cameras_of(const scree::File& file, uint32_t scene) {
  return listed(file.scene(scene).cameras, [&](uint32_t i) {
    const scree_camera_info info = file.camera(scene, i);
    py::array_t<double> world(std::vector<py::ssize_t>{3, 4});
    std::copy(info.world, info.world + 12, world.mutable_data());
    return py::dict("name"_a = text_of(info.name), "node_name"_a = text_of(info.node_name), "camera"_a = info.camera,
                    "orthographic"_a = info.orthographic != 0, "fov"_a = info.fov_degrees,
                    "half_height"_a = info.half_height, "z_near"_a = info.z_near, "z_far"_a = info.z_far,
                    "world"_a = world);
  });
}

}  // namespace scree_python
