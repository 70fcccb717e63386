// Properties on which existing programs rely: names (check_symbols.cmake), sizes of structures, numbers.
#include <fstream>
#include <map>
#include <string>

#include "tests/library/handles.h"

using namespace scree::tests;

TEST_CASE("structures have the sizes that library/abi.txt lists", "[library][abi]") {
  std::map<std::string, size_t> sizes;
#define ADD(type) sizes[#type] = sizeof(type)
  ADD(scree_file_info);
  ADD(scree_scene_info);
  ADD(scree_mesh_info);
  ADD(scree_material_info);
  ADD(scree_camera_info);
  ADD(scree_load_options);
  ADD(scree_scene_stats);
  ADD(scree_instance_info);
  ADD(scree_camera);
  ADD(scree_draw_options);
  ADD(scree_array);
  ADD(scree_path_info);
  ADD(scree_pick_info);
  ADD(scree_frame_stats);
  ADD(scree_target);
  ADD(scree_convert_options);
  ADD(scree_convert_report);
#undef ADD
  std::ifstream list(std::string(kDataFolder) + "/../../library/abi.txt");
  REQUIRE(list.good());
  std::string kind, name;
  size_t found = 0;
  while (list >> kind >> name) {
    if (kind != "struct") continue;
    size_t bytes = 0;
    list >> bytes;
    INFO(name);
    REQUIRE(sizes.count(name) == 1);
    CHECK(sizes[name] == bytes);
    ++found;
  }
  CHECK(found == sizes.size());
}

TEST_CASE("numbers of the interface do not change", "[library][abi]") {
  CHECK(scree_api_version() == SCREE_API_VERSION);
  CHECK(std::string(scree_version()).find('.') != std::string::npos);
  CHECK(SCREE_ERROR_INTERNAL == 10);
  CHECK(SCREE_SHOW_DEPTH == 8);
  CHECK(SCREE_SAMPLES == 4);
  CHECK(SCREE_CAMERA_MATRICES == 3);
  CHECK(SCREE_LINEAR == 7);
  CHECK(SCREE_LIGHT_SCENE == 3);
  CHECK(SCREE_SHADOWS == 16);
  CHECK(SCREE_READ_DIRECT == 3);
  CHECK(SCREE_CONVERT_BEST == 2048);
  CHECK(offsetof(scree_camera, projection) == 240);
  CHECK(offsetof(scree_array, shape) == 32);
  // In programs of older versions the structures end here.
  CHECK(offsetof(scree_load_options, texture_memory) == 104);
  CHECK(offsetof(scree_scene_stats, lights) == 120);
  CHECK(offsetof(scree_camera, turn_degrees) == 376);
  CHECK(offsetof(scree_draw_options, exposure) == 56);
  CHECK(offsetof(scree_camera, clips) == 392);
  CHECK(offsetof(scree_draw_options, shadow_size) == 72);
  CHECK(offsetof(scree_load_options, max_shadow_size) == 136);
  CHECK(offsetof(scree_frame_stats, shadow_ms) == 88);
}
