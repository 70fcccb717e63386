// Culling on the CPU never removes visible parts of the measured scenes: A to D as packed by convert, with a share of
// their triangles.
#include <random>

#include "tests/kernels/draw_counted.h"
#include "tests/runtime/load_scene.h"
#include "tests/sanitized.h"
#include "tests/tools/convert/convert_fixture.h"
#include "tests/tools/render/random_view.h"
#include "tools/synth/scenes.h"
#include "tools/synth/synth.h"

using namespace scree;

namespace {

constexpr int kCameras = tests::kIsSanitized ? 3 : 25;  // 200 pictures of four scenes in two encodings

struct Share {
  const char* name;
  double scale;
  synth::Scene scene;
};

}  // namespace

TEST_CASE("culling: pictures of scenes A to D equal pictures of all triangles", "[raster][clusters]") {
  const synth::MeshOrder order = synth::MeshOrder::kRow;
  const Share shares[] = {{"A", 0.0005, synth::terrain_scene(order, 0.0005)},
                          {"B", 0.0002, synth::lantern_scene(order, 0.0002)},
                          {"C", 0.00002, synth::zorahlike_scene(order, 0.00002)},
                          {"D", 1, synth::sponzalike_scene(1)}};
  for (const Share& share : shares) {
    const tests::TempFolder folder;
    REQUIRE(synth::synthesize(
        {.scene = share.name, .output = folder.file("in.gltf"), .scale = share.scale, .order = order}));
    for (const convert::Encoding encoding : {convert::Encoding::kClustered, convert::Encoding::kIndexed}) {
      convert::ConvertOptions options = tests::options_of(folder, "in.gltf");
      options.encoding = encoding;
      options.chunk_triangles = 4096;
      tests::must_convert(options);
      const runtime::Scene scene = tests::must_load(options.output);
      std::mt19937 random(7);
      uint64_t left = 0, all = 0;
      for (int i = 0; i < kCameras; ++i) {
        INFO(share.name << ", camera " << i << (encoding == convert::Encoding::kIndexed ? ", indexed" : ""));
        const kernels::View view = tests::random_view(share.scene, random, i, {160, 90}, {91, 133});
        const tests::Drawn whole = tests::draw_counted(scene.view(), view, tests::nothing_left_out(), 2);
        const tests::Drawn culled = tests::draw_counted(scene.view(), view, {}, 2);
        CHECK((culled.samples == whole.samples));
        all += whole.stats.triangles_small;
        left += culled.stats.triangles_small;
      }
      CHECK(left <= all);
      CHECK(all > 0);
    }
  }
}
