// Views that leave out instances: the picture and its layers are those of a scene without these instances.
#include <algorithm>
#include <vector>

#include "tests/kernels/omitted_cases.h"
#include "tests/kernels/raster/blend_cases.h"

using namespace scree;
using namespace scree::tests;
using kernels::View;

TEST_CASE("a view that omits instances equals a view of a scene without them", "[raster][omitted]") {
  const bool is_blended = GENERATE(false, true);
  SceneBuilder builder;
  if (is_blended) {
    add_blended_meshes(builder, false);
  } else {
    add_masked_meshes(builder, false);
  }
  const kernels::SceneView scene = builder.view(1000);
  size_t changed = 0;
  uint32_t seed = 0;
  for (const View& view : masked_views()) {
    const std::vector<uint32_t> bits = random_omitted(scene.instance_count, ++seed);
    const View omits = omitting(view, bits.data());
    const RemainingScene remaining(scene, bits);
    const std::vector<uint64_t> found = draw(scene, omits, 1 + seed % 2);
    CHECK((found == remaining.in_whole(draw(remaining.view(), view, 2))));
    changed += found != draw(scene, view, 2) ? 1 : 0;
    if (!is_blended) continue;
    DrawnLayers expected = draw_layers(remaining.view(), view);
    for (std::vector<uint64_t>& layer : expected.samples) layer = remaining.in_whole(std::move(layer));
    const DrawnLayers layers = draw_layers(scene, omits);
    CHECK((layers == expected));
    CHECK(layers.counts.layers > 0);
    CHECK_FALSE((layers == draw_layers(scene, view)));
  }
  CHECK(changed == seed);

  const std::vector<uint32_t> all((scene.instance_count + 31) / 32, ~0u);
  const std::vector<uint64_t> nothing = draw(scene, omitting(masked_views()[0], all.data()), 2);
  CHECK(std::all_of(nothing.begin(), nothing.end(), [](uint64_t sample) { return sample == kernels::kBackground; }));
}
