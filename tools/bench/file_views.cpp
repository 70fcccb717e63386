#include "tools/bench/file_views.h"

#include <string_view>

#include "runtime/scene/camera.h"
#include "tools/common/output/text_table.h"

namespace scree::bench {

Result<std::vector<FileView>> file_views(runtime::Scene& scene, const std::string& file,
                                         const std::vector<std::string>& names, tools::ImageSize size,
                                         uint32_t threads) {
  struct Choice {
    std::string camera;  // a value for CameraOptions::camera
    std::string name;
  };
  std::vector<Choice> choices;
  for (const std::string& name : names) choices.push_back({name, name});
  if (choices.empty()) {
    const format::Container& container = scene.container();
    for (const runtime::PlacedCamera& placed : runtime::placed_cameras(container, scene.scene_index())) {
      const std::string number = std::to_string(placed.camera);
      const std::string_view name = container.string(container.cameras()[placed.camera].name);
      choices.push_back({number, name.empty() ? number : inspect::printable(name)});
    }
  }
  if (choices.empty()) choices.push_back({"", "default"});
  std::vector<FileView> views;
  for (const Choice& choice : choices) {
    runtime::CameraOptions camera;
    camera.camera = choice.camera;
    camera.width = size.width;
    camera.height = size.height;
    if (runtime::view_reads_vertices(scene.view(), camera)) SCREE_TRY(scene.load_pages(threads));
    const kernels::View view = SCREE_TRY_AT(file, runtime::make_view(scene, camera));
    views.push_back({choice.name, view});
  }
  return views;
}

}  // namespace scree::bench
