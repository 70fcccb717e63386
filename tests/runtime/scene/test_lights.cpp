// The lights of a file, placed by its nodes.
#include <cmath>

#include "runtime/scene/scene.h"
#include "tests/runtime/load_scene.h"

namespace scree::tests {

TEST_CASE("a directional light whose node has a scale of 0 is left out with a warning", "[scene]") {
  SmallScene small;
  small.change = [](format::TableSet& tables) {
    format::NodeRecord flat = SmallScene::node(tables, "Flat", 0, format::kNone, format::kNone);
    flat.local[9] = 0;
    tables.nodes.push_back(flat);
    for (const uint32_t node : {static_cast<uint32_t>(tables.nodes.size() - 1), 0u})
      for (const format::LightKind kind : {format::LightKind::kDirectional, format::LightKind::kPoint})
        tables.lights.push_back({.node = node, .kind = kind, .color = {1, 1, 1}, .intensity = 1});
  };
  const runtime::Scene scene = must_load(small);
  REQUIRE(scene.view().light_count == 3);
  for (uint32_t i = 0; i < 3; ++i) {
    const kernels::PlacedLight& light = scene.view().lights[i];
    const bool aims = std::hypot(light.direction[0], light.direction[1], light.direction[2]) > 0.9f;
    CHECK((aims || light.kind == format::LightKind::kPoint));
  }
  REQUIRE(scene.warnings().size() == 1);
  CHECK(scene.warnings()[0].find("without a direction, because of a scale of 0: 1 left out") != std::string::npos);
}

}  // namespace scree::tests
