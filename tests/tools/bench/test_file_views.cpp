// The views that are measured: every camera of a file, whatever its name.
#include "tools/bench/file_views.h"

#include <cmath>

#include "tests/runtime/load_scene.h"
#include "tests/tools/temp_folder.h"

namespace scree::tests {

TEST_CASE("cameras with equal names, or with the numbers of others as names, are measured", "[bench]") {
  SmallScene small;
  small.change = [](format::TableSet& tables) {
    for (const char* const name : {"1", "0", "twice"})
      tables.cameras.push_back({tables.strings.add(name), format::CameraKind::kPerspective, 1.0, 0, 0.25, 0});
    double distance = 2;
    for (const uint32_t camera : {0u, 1u, 2u, 2u}) {
      const char* const name = camera == 2 && distance > 4 ? "" : "Tripod";
      format::NodeRecord node = SmallScene::node(tables, name, 0, format::kNone, camera);
      node.local[2] = distance++;
      tables.nodes.push_back(node);
    }
    for (uint64_t i = 0; i < 3; ++i) tables.cameras[i].y = 0.5 + 0.25 * static_cast<double>(i);
  };
  runtime::Scene scene = must_load(small);
  const auto views = must(bench::file_views(scene, "a.scree", {}, {64, 48}, 1));
  const auto nodes = scene.container().nodes().size();
  REQUIRE(views.size() == 4);
  CHECK(views[0].name == "1");
  CHECK(views[1].name == "0");
  CHECK(views[2].name == "twice of node Tripod");
  CHECK(views[3].name == "twice of node " + std::to_string(nodes - 1));
  const double first = views[0].view.eye[2];
  for (size_t i = 0; i < 4; ++i) CHECK(views[i].view.eye[2] == Approx(first + static_cast<double>(i)));
  CHECK(views[0].view.half_height == Approx(std::tan(0.25)));
  CHECK(must(bench::file_views(scene, "a.scree", {"1"}, {64, 48}, 1))[0].view.eye[2] == Approx(first));  // by name
}

}  // namespace scree::tests
