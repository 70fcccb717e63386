// For the tests of misuse: the outputs of calls, their valid arguments, and the check of their error.
#pragma once

#include <algorithm>
#include <array>
#include <cstring>
#include <fstream>
#include <limits>
#include <set>
#include <string>

#include "tests/library/handles.h"

namespace scree::tests {

inline constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
inline constexpr double kInfinity = std::numeric_limits<double>::infinity();
inline constexpr double kHuge = std::numeric_limits<double>::max();

inline const scree_camera default_camera = sized<scree_camera>();

/// Checks that the call failed with this code and text.
inline void failed(scree_status status, scree_status expected, const std::string& part) {
  const std::string text = scree_error();
  INFO(scree_status_name(status) << ": " << text);
  CHECK(status == expected);
  CHECK(text.find(part) != std::string::npos);
  CHECK(std::none_of(text.begin(), text.end(), [](char c) { return c >= 0 && c < ' '; }));
}

/// The outputs of calls.
struct Outputs {
  scree_file* file;
  scree_scene* scene;
  scree_view* view;
  scree_memory* memory;
  scree_file_info file_info;
  scree_scene_info scene_info;
  scree_mesh_info mesh_info;
  scree_material_info material_info;
  scree_camera_info camera_info;
  scree_scene_stats scene_stats;
  scree_instance_info instance_info;
  scree_array array;
  scree_pick_info pick_info;
  scree_frame_stats frame_stats;
  scree_convert_report report;
  scree_path_info path_info;
  std::array<scree_camera, 2> cameras;
  alignas(16) std::array<unsigned char, 1024> buffer;

  Outputs() {
    std::memset(static_cast<void*>(this), 0x55, sizeof *this);
    const auto set = [](auto&... structs) { ((structs.size = sizeof structs), ...); };
    set(file_info, scene_info, mesh_info, material_info, camera_info, scene_stats, instance_info, array, pick_info,
        frame_stats, report, path_info, cameras[0]);
  }
  std::string bytes() const { return {reinterpret_cast<const char*>(this), sizeof *this}; }
};

/// Valid arguments: a scene of one cube, a view with a frame of 10 x 7 pixels, and a view without a frame.
struct Subjects {
  TempFolder folder;
  std::string path = packed(folder);
  Opened opened;
  scree_view* empty = nullptr;
  std::string film =
      folder.write("film.json", R"({"format": "scree camera path", "version": 1, "keys": [{"t": 0, "eye": [3, 2, 4],
        "target": [0, 0, 0]}, {"t": 0.1, "eye": [3, 3, 4], "target": [0, 0, 0]}]})");
  std::string source = data_path("textured_cube.glb").string();
  std::string made = folder.file("made.scree");
  Outputs out;

  explicit Subjects(scree_backend backend) : opened(path, backend) {
    must(scree_view_create(opened.scene, &empty));
    draw(opened.view, draw_options(10, 7));
  }
  ~Subjects() { (void)scree_view_destroy(empty); }
};

/// The names of library/abi.txt; `kind`: "function" or "struct".
inline std::set<std::string> listed(const std::string& kind) {
  std::ifstream list(std::string(kDataFolder) + "/../../library/abi.txt");
  REQUIRE(list.good());
  std::set<std::string> names;
  for (std::string word, name; list >> word;)
    if (word == kind && list >> name) names.insert(name);
  return names;
}

}  // namespace scree::tests
