// Converted scenes with blended surfaces, on the CPU and the GPU: equally many layers with bit-equal transmittance, and
// colours within the tolerance of shading.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "kernels/blend.h"
#include "runtime/draw/device_scene.h"
#include "tests/gpu.h"
#include "tests/models.h"
#include "tests/tools/convert/convert_fixture.h"
#include "tests/tools/jpeg_model.h"
#include "tools/synth/synth.h"

using namespace scree;
using namespace scree::runtime;
using namespace scree::tests;
using namespace kernels;

namespace {

constexpr int kCameras = tests::kEmulatesGpu ? 2 : 40;
constexpr uint32_t kWidth = tests::kEmulatesGpu ? 45 : 200;
constexpr uint32_t kHeight = tests::kEmulatesGpu ? 30 : 120;

/// Camera `number` of a series all around a scene. Every third one is orthographic.
View camera(const Scene& scene, int number, uint32_t width, uint32_t height) {
  View view = tests::must_view(
      scene,
      {.turn_degrees = 47.0 * number, .rise_degrees = 85 * std::sin(0.7 * number), .width = width, .height = height});
  if (number % 3 != 2) return view;
  const runtime::WorldBox box = runtime::scene_box(scene.view());
  double size = 0;
  for (size_t i = 0; i < 3; ++i) size = std::max(size, box.max[i] - box.min[i]);
  view.orthographic = true;
  view.half_height = 0.4 * size;
  view.half_width = view.half_height * width / height;
  view.z_far = view.z_near + 8 * size;
  return view;
}

/// Compares pictures of `cameras` cameras. Returns the largest number of layers; 0 if nothing blends.
uint32_t compare(const Scene& scene, int cameras, uint32_t width, uint32_t height, const ShadeOptions& options = {}) {
  if (scene.view().blend_masks == nullptr || !tests::has_gpu()) return 0;
  DeviceScene device = must(DeviceScene::upload(scene, 0, 2));
  uint32_t layers = 0;
  for (int i = 0; i < cameras; ++i) {
    INFO("camera " << i);
    const View view = camera(scene, i, width, height);
    const size_t count = size_t{width} * height;
    std::vector<uint64_t> samples(count);
    REQUIRE(kernels::draw_cpu(scene.view(), view, samples, 2));
    BlendCounts counts;
    const std::vector<float> expected = must(kernels::blend_cpu(scene.view(), view, samples, options, 2, counts));
    std::vector<float> over(4 * count);
    REQUIRE(device.draw(view));
    REQUIRE(device.read_over(view, options, over));
    CHECK(device.blended().layers == counts.layers);
    CHECK(device.blended().samples_left_out == counts.samples_left_out);
    size_t other_shares = 0;
    size_t far_colors = 0;  // normals at grazing angles, and footprints between two levels
    for (size_t s = 0; s < over.size(); ++s) {
      if (s % 4 == 3)
        other_shares += over[s] == expected[s] ? 0 : 1;
      else
        far_colors += std::abs(over[s] - expected[s]) <= 0.01f * (1 + std::abs(expected[s])) ? 0 : 1;
    }
    CHECK(other_shares == 0);
    CHECK(far_colors <= over.size() / 500);
    layers = std::max(layers, counts.layers);
  }
  return layers;
}

Scene converted(const TempFolder& folder, const std::string& input) {
  convert::ConvertOptions options = tests::options_of(folder);
  options.input = input;
  tests::must_convert(options);
  return must_load(options.output);
}

}  // namespace

TEST_CASE("blended scenes are equal on the CPU and the GPU", "[cuda][blend]") {
  const TempFolder folder;
  for (const char* name : {"glass.glb", "materials.gltf"})
    compare(converted(folder, tests::data_path(name).string()), kCameras, kWidth, kHeight);

  tests::make_jpeg_model(folder.file("in.gltf"), 2, 0.5);
  const Scene jpegs = converted(folder, folder.file("in.gltf"));
  if (tests::has_gpu()) CHECK(compare(jpegs, kCameras, kWidth, kHeight) >= 2);
}

TEST_CASE("panes of glass are equal on the CPU and the GPU", "[cuda][blend]") {
  if (!tests::has_gpu()) return;
  const TempFolder folder;
  synth::SynthOptions panes;
  panes.scene = GENERATE("panes", "panes-textured");
  panes.output = folder.file("panes.gltf");
  panes.scale = 5.0 / 8;
  panes.texture_size = panes.scene == "panes" ? std::nullopt : std::optional<uint32_t>(64);
  REQUIRE(synth::synthesize(panes));
  const Scene scene = converted(folder, panes.output);
  CHECK(compare(scene, kCameras, kWidth, kHeight) >= 5);
  // The scene has no lights, so the full materials are dark.
  const ShadeOptions options{.lighting = kernels::Lighting::kScene, .blend_layers = 4};
  CHECK(compare(scene, 1, kWidth, kHeight, options) == 4);
}

TEST_CASE("blended models are equal on the CPU and the GPU from 200 cameras", "[cuda][blend][hard]") {
  std::vector<std::filesystem::path> files = tests::model_files(tests::real_models("scenes"));
  const std::vector<std::filesystem::path> more = tests::model_files(tests::real_models("scenes-material"));
  files.insert(files.end(), more.begin(), more.end());
  if (files.empty()) return;
  if (!tests::has_gpu()) return;
  const TempFolder folder;
  uint32_t blended = 0;
  for (const std::filesystem::path& path : files) {
    INFO(path.string());
    convert::ConvertOptions options = tests::options_of(folder);
    options.input = path.string();
    options.source_ids = false;
    if (!convert::convert(options)) continue;  // test_models.cpp lists the models that may fail
    const Scene scene = must_load(options.output);
    if (compare(scene, 200, 320, 200) != 0) ++blended;
  }
  CHECK(blended >= 5);
}
