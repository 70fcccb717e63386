// Opens files and returns the contents of their records.
#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "library/handles.h"
#include "library/structs.h"
#include "runtime/scene/camera.h"

namespace scree::library {
namespace {

int32_t number_or_none(uint32_t number) {
  return number == format::kNone ? -1 : static_cast<int32_t>(number);
}

/// The strings of the file end with a zero byte, as those of C.
const char* name_of(const format::Container& container, uint32_t name) {
  return container.string(name).data();
}

scree_status check_index(uint64_t index, uint64_t count, const char* what) {
  if (index < count) return SCREE_OK;
  return fail(SCREE_ERROR_ARGUMENT,
              std::string("no ") + what + " " + std::to_string(index) + ", there are " + std::to_string(count));
}

/// The functions that fill in an Info for a record by index. `count`: count(container), the number of records. `fill`:
/// fill(file, info).
template <class Info, class Count, class Fill>
scree_status get(scree_file* file, uint64_t index, Info* info, const char* type, const char* what, const Count& count,
                 const Fill& fill) {
  return with<Files>(file, "scree_file", [&](const File& opened) {
    SCREE_CHECK(check_output(info, type));
    const format::Container& container = opened.file.container();
    SCREE_CHECK(check_index(index, count(container), what));
    Info out{};
    SCREE_CHECK(fill(opened, out));
    give(info, out);
    return SCREE_OK;
  });
}

scree_camera_info describe(const format::Container& container, const runtime::PlacedCamera& placed) {
  const format::CameraRecord& record = container.cameras()[placed.camera];
  scree_camera_info info{};
  info.name = name_of(container, record.name);
  info.node_name = name_of(container, container.nodes()[placed.node].name);
  info.camera = placed.camera;
  info.orthographic = record.kind == format::CameraKind::kOrthographic;
  if (info.orthographic) {
    info.half_height = record.y;
  } else {
    info.fov_degrees = record.y * 180 / 3.14159265358979323846;
  }
  info.z_near = record.z_near;
  info.z_far = record.z_far;
  for (size_t i = 0; i < 12; ++i) info.world[i] = placed.world[i / 4][i % 4];
  return info;
}

}  // namespace
}  // namespace scree::library

using namespace scree::library;
using scree::format::Container;

extern "C" {

scree_status scree_open(const char* path, scree_file** file) {
  return guarded([&] {
    SCREE_CHECK(check_path(path, "scree_open: path"));
    if (file == nullptr) return fail(SCREE_ERROR_ARGUMENT, "scree_open: file is null");
    scree::Result<scree::runtime::SceneFile> opened = scree::runtime::SceneFile::open(path);
    if (!opened) return fail(opened.error(), Subject::kData);
    *file = Files::all().add(std::make_shared<File>(std::move(*opened)));
    return SCREE_OK;
  });
}

scree_status scree_close(scree_file* file) {
  return end<Files>(file, "scree_file");
}

scree_status scree_get_file_info(scree_file* file, scree_file_info* info) {
  return with<Files>(file, "scree_file", [&](const File& opened) {
    SCREE_CHECK(check_output(info, "scree_file_info"));
    const Container& container = opened.file.container();
    scree_file_info out{};
    out.bytes = opened.file.map().size();
    const auto meshes = container.meshes();
    for (uint64_t i = 0; i < meshes.size(); ++i) out.triangles += meshes[i].triangle_count;
    const auto scenes = container.scenes();
    out.scenes = static_cast<uint32_t>(scenes.size());
    for (uint32_t i = 0; i < out.scenes; ++i)
      if (scenes[i].flags & 1) out.default_scene = i;
    out.meshes = static_cast<uint32_t>(meshes.size());
    out.materials = static_cast<uint32_t>(container.materials().size());
    out.textures = static_cast<uint32_t>(container.textures().size());
    out.nodes = static_cast<uint32_t>(container.nodes().size());
    give(info, out);
    return SCREE_OK;
  });
}

scree_status scree_get_scene_info(scree_file* file, uint32_t index, scree_scene_info* info) {
  return get(
      file, index, info, "scree_scene_info", "scene", [](const Container& c) { return c.scenes().size(); },
      [&](const File& opened, scree_scene_info& out) {
        const Container& container = opened.file.container();
        const scree::format::SceneRecord& record = container.scenes()[index];
        out.name = name_of(container, record.name);
        out.triangles = record.triangle_count;
        out.instances = record.instance_count;
        out.cameras = static_cast<uint32_t>(opened.cameras(index).size());
        return SCREE_OK;
      });
}

scree_status scree_get_mesh_info(scree_file* file, uint32_t index, scree_mesh_info* info) {
  return get(
      file, index, info, "scree_mesh_info", "mesh", [](const Container& c) { return c.meshes().size(); },
      [&](const File& opened, scree_mesh_info& out) {
        const Container& container = opened.file.container();
        const scree::format::MeshRecord& record = container.meshes()[index];
        out.name = name_of(container, container.groups()[record.group].name);
        out.triangles = record.triangle_count;
        out.vertices = record.vertex_count;
        std::copy_n(record.bounds_min, 3, out.box_min);
        std::copy_n(record.bounds_max, 3, out.box_max);
        out.max_position_error = record.max_position_error;
        out.material = number_or_none(record.material);
        out.attributes = record.attributes;
        return SCREE_OK;
      });
}

scree_status scree_get_material_info(scree_file* file, uint32_t index, scree_material_info* info) {
  return get(
      file, index, info, "scree_material_info", "material", [](const Container& c) { return c.materials().size(); },
      [&](const File& opened, scree_material_info& out) {
        const Container& container = opened.file.container();
        const scree::format::MaterialRecord& record = container.materials()[index];
        out.name = name_of(container, record.name);
        std::copy_n(record.base_color, 4, out.base_color);
        out.texture = number_or_none(record.texture);
        out.flags = record.flags;
        return SCREE_OK;
      });
}

scree_status scree_get_camera_info(scree_file* file, uint32_t scene, uint32_t index, scree_camera_info* info) {
  return get(
      file, scene, info, "scree_camera_info", "scene", [](const Container& c) { return c.scenes().size(); },
      [&](const File& opened, scree_camera_info& out) {
        const std::vector<scree::runtime::PlacedCamera>& cameras = opened.cameras(scene);
        SCREE_CHECK(check_index(index, cameras.size(), "camera"));
        out = describe(opened.file.container(), cameras[index]);
        return SCREE_OK;
      });
}

}  // extern "C"
