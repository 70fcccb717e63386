// Blended surfaces: layers equal all fragments sorted one by one, colours equal numbers worked out by hand, and the
// order of triangles changes nothing.
#include <algorithm>
#include <random>
#include <vector>

#include "kernels/cull/cull.h"
#include "tests/kernels/raster/blend_cases.h"

using namespace scree;
using namespace scree::tests;
using kernels::kBackground;
using namespace kernels;

namespace {

/// The nearest fragments of instance `i` alone. `scene`: blended_view().
std::vector<uint64_t> draw_instance(SceneView scene, const View& view, uint64_t i) {
  std::vector<uint64_t> samples(size_t{view.width} * view.height, kBackground);
  scene.instances += i;
  scene.instance_base += i;
  scene.instance_count = 1;
  REQUIRE(kernels::draw_layer_cpu(
      scene, view, {.sample_count = static_cast<uint32_t>(samples.size()), .drawn = samples.data()}, nullptr, 1));
  return samples;
}

std::vector<uint8_t> picture(const SceneView& scene, const View& view, const ShadeOptions& options,
                             kernels::BlendCounts* counts = nullptr, uint32_t side = 1) {
  View in_samples = view;
  in_samples.width *= side;
  in_samples.height *= side;
  const std::vector<uint64_t> samples = draw(scene, in_samples, 2);
  std::vector<uint8_t> pixels(size_t{4} * view.width * view.height);
  REQUIRE(kernels::resolve_cpu(scene, in_samples, side, samples, options, 4, pixels, 2, counts));
  return pixels;
}

/// Flat squares of 2 x 2 units, one above the other, seen from above. The first one is on top.
struct Stack {
  SceneBuilder builder;
  void add(uint32_t material, double height) {
    builder.instance(builder.mesh(grid(1, 0), {.material = material}),
                     builder.matrix({1, 0, 0, 0, 0, 1, 0, height, 0, 0, 1, 0}));
  }
  uint32_t color(float alpha, float red, float green, float blue) {
    const uint32_t material = builder.blended_material(alpha);
    float* const color = builder.materials[material].base_color;
    color[0] = red;
    color[1] = green;
    color[2] = blue;
    return material;
  }
};
const View kAbove = orthographic(look_at({0, 5, 0}, {0, 0, 0}, 8, 8), 0.5, 0.1, 20);

}  // namespace

TEST_CASE("layers hold all fragments of blended surfaces in order", "[blend]") {
  const bool is_clustered = GENERATE(false, true);
  SceneBuilder builder;
  add_blended_meshes(builder, is_clustered);
  const SceneView scene = builder.view();
  const SceneView blended = kernels::blended_view(scene);
  uint64_t compared = 0;
  for (const View& view : masked_views()) {
    const std::vector<uint64_t> opaque = draw(scene, view, 2);
    const DrawnLayers layers = draw_layers(scene, view);
    CHECK(layers.counts.samples_left_out == 0);
    CHECK(layers.samples.size() == layers.counts.layers);
    // The nearest fragment of each instance has to be in some layer, unless an opaque fragment is in front of it.
    for (uint64_t i = 0; i < scene.instance_count; ++i) {
      const std::vector<uint64_t> own = draw_instance(blended, view, i);
      for (size_t s = 0; s < own.size(); ++s) {
        if (own[s] >= opaque[s]) continue;
        bool is_there = false, is_covered = false;
        for (size_t l = 0; l < layers.samples.size() && !is_there && !is_covered; ++l) {
          is_there = layers.samples[l][s] == own[s];
          is_covered = layers.samples[l][s] < own[s] && layers.alphas[l][s] >= 1;
        }
        REQUIRE((is_there || is_covered));
        ++compared;
      }
    }
    for (size_t s = 0; s < opaque.size(); ++s) {
      uint64_t last = 0;
      for (size_t l = 0; l < layers.samples.size(); ++l) {
        const uint64_t sample = layers.samples[l][s];
        if (sample == kBackground) {
          last = kBackground;
          continue;
        }
        REQUIRE((l == 0 || sample > last));
        REQUIRE(sample < opaque[s]);
        last = sample;
      }
    }
  }
  CHECK(compared > 100000);
}

TEST_CASE("blended layers do not depend on threads or on the number of drawn layers", "[blend]") {
  SceneBuilder builder;
  add_blended_meshes(builder, false);
  const SceneView scene = builder.view();
  const View view = masked_views()[0];
  const DrawnLayers all = draw_layers(scene, view);
  REQUIRE(all.counts.layers > 4);
  CHECK(draw_layers(scene, view, 64, 1) == all);
  CHECK(draw_layers(scene, view, 64, 7) == all);
  const DrawnLayers some = draw_layers(scene, view, 3);
  CHECK(some.counts.layers == 3);
  const auto left_out = std::count_if(all.samples[3].begin(), all.samples[3].end(),
                                      [](uint64_t sample) { return sample != kBackground; });
  CHECK(some.counts.samples_left_out == static_cast<uint64_t>(left_out));
  CHECK(std::equal(some.samples.begin(), some.samples.end(), all.samples.begin()));
}

TEST_CASE("blended colours are laid over the colours behind them", "[blend]") {
  Stack stack;
  stack.add(stack.color(0.5f, 1, 0, 0), 2);
  stack.add(stack.color(0.25f, 0, 1, 0), 1);
  const uint32_t blue = stack.builder.material(0);
  stack.builder.materials[blue].base_color[0] = stack.builder.materials[blue].base_color[1] = 0;
  ShadeOptions options{.light = false};
  std::fill_n(options.background, 4, 1.0f);
  const auto code = [](double light) {
    const double srgb = light <= 0.0031308 ? 12.92 * light : 1.055 * std::pow(light, 1 / 2.4) - 0.055;
    return static_cast<uint8_t>(std::lround(255 * srgb));
  };
  const auto first = [](const std::vector<uint8_t>& pixels) {
    return std::vector<uint8_t>(pixels.begin() + 4 * (8 * 4 + 4), pixels.begin() + 4 * (8 * 4 + 5));
  };
  const uint32_t side = GENERATE(1u, 2u, 4u);
  kernels::BlendCounts counts;
  // Over white: 0.5 red, 0.125 green, and 0.375 white.
  CHECK(first(picture(stack.builder.view(), kAbove, options, &counts, side)) ==
        (std::vector<uint8_t>{code(0.875), code(0.5), code(0.375), 255}));
  CHECK(counts.layers == 2);
  CHECK(counts.samples_left_out == 0);
  // Over an empty background the result has an alpha of 0.625.
  std::fill_n(options.background, 4, 0.0f);
  CHECK(first(picture(stack.builder.view(), kAbove, options, nullptr, side)) ==
        (std::vector<uint8_t>{code(0.8), code(0.2), 0, 159}));
  // One layer alone, and none.
  std::fill_n(options.background, 4, 1.0f);
  options.blend_layers = 1;
  CHECK(first(picture(stack.builder.view(), kAbove, options, &counts, side)) ==
        (std::vector<uint8_t>{255, code(0.5), code(0.5), 255}));
  CHECK(counts.layers == 1);
  CHECK(counts.samples_left_out == uint64_t{64} * side * side);
  options.blend_layers = 0;
  CHECK(first(picture(stack.builder.view(), kAbove, options, &counts, side)) == std::vector<uint8_t>(4, 255));
  // An opaque surface hides a layer behind it, and is visible through the layers in front of it.
  options.blend_layers = 16;
  stack.add(blue, 1.5);
  CHECK(first(picture(stack.builder.view(), kAbove, options, &counts, side)) ==
        (std::vector<uint8_t>{code(0.5), 0, code(0.5), 255}));
  CHECK(counts.layers == 1);
}

TEST_CASE("the picture does not depend on the order of blended triangles", "[blend]") {
  // Squares at different heights, drawn in any order.
  std::vector<size_t> order{0, 1, 2, 3, 4, 5, 6, 7, 8, 9};
  ShadeOptions options;
  std::vector<uint8_t> expected;
  for (int turn = 0; turn < 4; ++turn) {
    Stack stack;
    for (const size_t i : order) {
      const auto part = static_cast<float>(i) / 9;
      stack.add(stack.color(0.2f + 0.05f * part, part, 1 - part, 0.3f), 0.2 * static_cast<double>(i));
    }
    kernels::BlendCounts counts;
    const std::vector<uint8_t> pixels = picture(stack.builder.view(), kAbove, options, &counts);
    CHECK(counts.layers == 10);
    if (expected.empty()) expected = pixels;
    CHECK((pixels == expected));
    std::shuffle(order.begin(), order.end(), std::mt19937(static_cast<uint32_t>(turn)));
  }
}

TEST_CASE("blended surfaces of alpha 1 are in the opaque picture, and those of alpha 0 in no layer", "[blend]") {
  Stack stack;
  const kernels::MaskView texture = mask_view(16, 16, 1, 0);
  const uint32_t code = GENERATE(0u, 254u, 255u);
  const std::vector<uint8_t> levels(256, static_cast<uint8_t>(code));
  stack.builder.instance(
      stack.builder.mesh(with_uvs(grid(1, 0), 1), {.material = stack.builder.blended_material(1, texture, levels)}),
      stack.builder.identity());
  const SceneView scene = stack.builder.view();
  const std::vector<uint64_t> opaque = draw(scene, kAbove);
  CHECK((opaque[0] != kBackground) == (code == 255));
  CHECK(draw_layers(scene, kAbove).counts.layers == (code == 254 ? 1 : 0));
}
