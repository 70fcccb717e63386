// What the CPU leaves out of the measured scenes never shows: A to D as convert packs them, at a share of their
// triangles.
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include "runtime/scene.h"
#include "tests/catch.h"
#include "tests/kernels/scene_builder.h"
#include "tests/tools/convert_fixture.h"
#include "tools/bench/views.h"
#include "tools/synth/scenes.h"
#include "tools/synth/synth.h"

using namespace scree;
using kernels::QueueSizes;
using kernels::View;

namespace {

#if defined(__SANITIZE_ADDRESS__)
constexpr int kCameras = 3;
#else
constexpr int kCameras = 25;  // 200 pictures of four scenes in two encodings
#endif

struct Share {
  const char* name;
  double scale;
  synth::Scene scene;
};

/// From between a scene's first view and its last, somewhere about what those look at; every fifth is orthographic.
View random_view(const synth::Scene& scene, std::mt19937& random, int number) {
  std::uniform_real_distribution<double> share(0, 1);
  synth::SceneCamera camera = scene.cameras.front();
  const synth::SceneCamera& other = scene.cameras.back();
  const double t = share(random);
  double distance = 0;
  for (size_t axis = 0; axis < 3; ++axis) {
    camera.eye[axis] += t * (other.eye[axis] - camera.eye[axis]);
    camera.target[axis] += share(random) * (other.target[axis] - camera.target[axis]) +
                           (share(random) - 0.5) * (camera.eye[axis] - camera.target[axis]);
    distance += std::abs(camera.target[axis] - camera.eye[axis]);
  }
  View view = number % 9 == 4 ? bench::scene_view(camera, 91, 133) : bench::scene_view(camera, 160, 90);
  if (number % 5 != 3) return view;
  view.orthographic = true;
  view.half_height = 0.3 * distance;
  view.half_width = view.half_height * view.width / view.height;
  view.z_far = view.z_near + 4 * distance;
  return view;
}

}  // namespace

TEST_CASE("culling: cameras in scenes A to D see what all triangles give", "[raster][clusters]") {
  const synth::MeshOrder order = synth::MeshOrder::kRow;
  const Share shares[] = {{"A", 0.0005, synth::terrain_scene(order, 0.0005)},
                          {"B", 0.0002, synth::lantern_scene(order, 0.0002)},
                          {"C", 0.00002, synth::zorahlike_scene(order, 0.00002)},
                          {"D", 1, synth::sponzalike_scene(1)}};
  for (const Share& share : shares) {
    const tests::TempFolder folder;
    synth::SynthOptions written;
    written.scene = share.name;
    written.order = order;
    written.scale = share.scale;
    written.output = folder.file("in.gltf");
    REQUIRE(synth::synthesize(written));
    for (const convert::Encoding encoding : {convert::Encoding::kClustered, convert::Encoding::kIndexed}) {
      convert::ConvertOptions options = tests::options_of(folder, "in.gltf");
      options.encoding = encoding;
      options.chunk_triangles = 4096;
      tests::must_convert(options);
      const Result<runtime::Scene> scene = runtime::Scene::open(options.output, {});
      REQUIRE(scene);
      QueueSizes whole;
      whole.cluster_bounds = whole.occlusion = false;
      std::mt19937 random(7);
      uint64_t left = 0, all = 0;
      for (int i = 0; i < kCameras; ++i) {
        INFO(share.name << ", camera " << i << (encoding == convert::Encoding::kIndexed ? ", indexed" : ""));
        const View view = random_view(share.scene, random, i);
        const auto draw = [&](const QueueSizes& sizes, uint64_t& small) {
          std::vector<uint64_t> samples(size_t{view.width} * view.height);
          const auto stats =
              kernels::draw_cpu_with(scene->view(), view, samples, 2, kernels::best_instruction_set(), sizes);
          REQUIRE(stats);
          small += stats->triangles_small;
          return samples;
        };
        const std::vector<uint64_t> expected = draw(whole, all);
        CHECK((draw({}, left) == expected));
      }
      CHECK(left <= all);
      CHECK(all > 0);
    }
  }
}
