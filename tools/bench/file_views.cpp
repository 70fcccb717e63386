#include "tools/bench/file_views.h"

#include <map>
#include <optional>
#include <string_view>

#include "runtime/scene/camera.h"
#include "tools/common/output/text_table.h"

namespace scree::bench {
namespace {

struct Choice {
  std::string name;
  std::string camera;                             // a value for CameraOptions::camera
  std::optional<runtime::PlacedCamera> placed{};  // instead of it: names may repeat, or look like numbers
};

/// All cameras of the scene. Equal names are followed by the names or numbers of the cameras' nodes.
std::vector<Choice> placed_choices(const runtime::Scene& scene) {
  const format::Container& container = scene.container();
  std::vector<Choice> choices;
  std::map<std::string, uint32_t> count;
  for (const runtime::PlacedCamera& placed : runtime::placed_cameras(container, scene.scene_index())) {
    const std::string_view name = container.string(container.cameras()[placed.camera].name);
    choices.push_back({name.empty() ? std::to_string(placed.camera) : inspect::printable(name), "", placed});
    ++count[choices.back().name];
  }
  for (Choice& choice : choices) {
    if (count[choice.name] == 1) continue;
    const uint32_t node = choice.placed->node;
    const std::string_view name = container.string(container.nodes()[node].name);
    choice.name += " of node " + (name.empty() ? std::to_string(node) : inspect::printable(name));
  }
  return choices;
}

}  // namespace

Result<std::vector<FileView>> file_views(runtime::Scene& scene, const std::string& file,
                                         const std::vector<std::string>& names, tools::ImageSize size,
                                         uint32_t threads) {
  std::vector<Choice> choices;
  for (const std::string& name : names) choices.push_back({name, name});
  if (choices.empty()) choices = placed_choices(scene);
  if (choices.empty()) choices.push_back({"default", ""});
  std::vector<FileView> views;
  for (const Choice& choice : choices) {
    runtime::CameraOptions camera;
    camera.camera = choice.camera;
    camera.width = size.width;
    camera.height = size.height;
    if (!choice.placed && runtime::view_reads_vertices(scene.view(), camera)) SCREE_TRY(scene.load_pages(threads));
    const kernels::View view = SCREE_TRY_AT(
        file, choice.placed ? runtime::make_view(scene, *choice.placed, camera) : runtime::make_view(scene, camera));
    views.push_back({choice.name, view});
  }
  return views;
}

}  // namespace scree::bench
