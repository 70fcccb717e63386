// Pictures with the sun's shadows: when their map is drawn anew, and that they are the same on every device.
#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "runtime/draw/shadow_map.h"
#include "tests/gpu.h"
#include "tests/models.h"
#include "tests/runtime/frame.h"
#include "tests/runtime/load_scene.h"
#include "tests/tools/convert/convert_fixture.h"

using namespace scree;
using namespace scree::runtime;
using namespace scree::tests;
using namespace kernels;

namespace {

constexpr uint32_t kMapSide = 256;

/// The view of the map that contains everything visible.
View last_map(const SunShadow& sun) {
  return sun.maps[sun.map_count - 1].view;
}

Scene converted(const TempFolder& folder, const char* name) {
  convert::ConvertOptions options = options_of(folder, data_path(name));
  options.normals = convert::Normals::kAuto;
  must_convert(options);
  return must_load(options.output, {.threads = 2, .lighting = kernels::Lighting::kScene});
}

std::vector<uint8_t> shadowed(const Scene& scene, ShadowMap& map, const View& camera, DeviceScene* device,
                              bool casts = true) {
  ShadeOptions options{.lighting = kernels::Lighting::kScene};
  if (casts) options.sun = must(map.draw(camera, kMapSide, 2));
  return must_picture(scene, camera, 1, device, options);
}

double mean(const std::vector<uint8_t>& picture) {
  double sum = 0;
  for (const uint8_t value : picture) sum += value;
  return sum / static_cast<double>(picture.size());
}

}  // namespace

TEST_CASE("a scene without a sun has no shadows", "[shadow]") {
  const TempFolder folder;
  const Scene scene = converted(folder, "textured_cube.glb");
  CHECK(!find_sun(scene.view()));
  check_refusal(ShadowMap(scene, nullptr).draw(must_view(scene, {}), kMapSide, 2),
                {ErrorCode::kUsage, "the scene has no directional light"});
}

TEST_CASE("a shadow map is drawn anew only where a picture needs another one", "[shadow]") {
  const TempFolder folder;
  const Scene scene = converted(folder, "sun.glb");
  ShadowMap map(scene, nullptr);
  CameraOptions options{.turn_degrees = 30, .rise_degrees = 25, .fov_degrees = 20, .width = 96, .height = 64};
  size_t drawn = 0;
  const auto draw = [&](const View& camera, ShadowFit fit, uint32_t side = kMapSide) {
    const SunShadow* const sun = must(map.draw(camera, side, 2, fit));
    REQUIRE(sun != nullptr);
    drawn += map.draw_time().wall_ms > 0 ? 1 : 0;
    return last_map(*sun);
  };
  View camera = must_view(scene, options);
  const View exact = draw(camera, ShadowFit::kExact);
  CHECK(drawn == 1);
  camera.width *= 4;
  camera.height *= 4;
  CHECK(draw(camera, ShadowFit::kExact) == exact);
  CHECK(draw(camera, ShadowFit::kMoving) == exact);  // the map that is kept is finer than a moving camera's own
  CHECK(drawn == 1);
  draw(camera, ShadowFit::kExact, kMapSide / 2);
  CHECK(drawn == 2);
  map.forget();
  draw(camera, ShadowFit::kExact, kMapSide / 2);
  CHECK(drawn == 3);

  // A moving camera's surfaces all lie in the map that it uses, with room for the samples that shading reads.
  drawn = 0;
  constexpr int kPictures = 60;
  for (int i = 0; i < kPictures; ++i) {
    const double turn = 0.02 * i;
    options = {.eye = Vec3{5 * std::cos(turn), 2.5, 5 * std::sin(turn)},
               .target = Vec3{0, 0.5, 0},
               .fov_degrees = 25,
               .width = 96,
               .height = 64};
    camera = must_view(scene, options);
    const View kept = draw(camera, ShadowFit::kMoving);
    const Frame frame = must_draw(scene, camera);
    const std::vector<float> depths = must(frame.layer<float>(Layer::kDepth, 2));
    size_t outside = 0, seen = 0;
    for (uint32_t pixel = 0; pixel < 96 * 64; ++pixel) {
      const double depth = static_cast<double>(depths[pixel]);
      if (!std::isfinite(depth)) continue;
      ++seen;
      const double x = (2 * (pixel % 96 + 0.5) / 96 - 1) * camera.half_width * depth;
      const double y = (1 - 2 * (pixel / 96 + 0.5) / 64) * camera.half_height * depth;
      double across = 0, along = 0, ahead = 0;
      for (size_t k = 0; k < 3; ++k) {
        const double place = camera.eye[k] + depth * camera.forward[k] + x * camera.right[k] + y * camera.up[k];
        across += (place - kept.eye[k]) * kept.right[k];
        along += (place - kept.eye[k]) * kept.up[k];
        ahead += (place - kept.eye[k]) * kept.forward[k];
      }
      const double room = 1.5 * 2 * kept.half_width / kept.width;
      outside += std::abs(across) + room > kept.half_width || std::abs(along) + room > kept.half_height || ahead < 0 ||
                         ahead > kept.z_far
                     ? 1
                     : 0;
    }
    CAPTURE(i);
    CHECK(seen > 1000);
    CHECK(outside == 0);
  }
  CAPTURE(drawn);
  CHECK((drawn >= 1 && drawn <= 20));  // mostly near maps, which have a quarter of the samples
  // At rest the map is the exact one again.
  CHECK(draw(camera, ShadowFit::kExact) == last_map(must(sun_of(scene.view(), scene.box(), camera, kMapSide))));
  // From nearby, the samples of the kept map become too coarse, and other parts of the scene need another map.
  draw(must_view(scene, {.width = 96, .height = 64}), ShadowFit::kMoving);  // shows the whole scene
  drawn = 0;
  camera =
      must_view(scene, {.eye = Vec3{1, 8, 1}, .target = Vec3{1, 0, 1.01}, .fov_degrees = 1, .width = 96, .height = 64});
  draw(camera, ShadowFit::kMoving);
  CHECK(drawn == 1);
  camera.clips = true;
  std::copy_n(scene.box().min.begin(), 3, camera.clip_min);
  std::copy_n(scene.box().max.begin(), 3, camera.clip_max);
  draw(camera, ShadowFit::kMoving);
  CHECK(drawn == 2);
  const std::vector<uint32_t> none((scene.view().instance_count + 31) / 32, 0);
  camera.omitted = none.data();
  draw(camera, ShadowFit::kMoving);
  CHECK(drawn == 3);
  draw(camera, ShadowFit::kMoving);
  CHECK(drawn == 3);
}

TEST_CASE("pictures with shadows are equal on the CPU and the GPU", "[shadow][cuda]") {
  const TempFolder folder;
  const Scene scene = converted(folder, "sun.glb");
  ShadowMap on_cpu(scene, nullptr);
  // With a budget of 0 the scene is resident; with the least budget it is streamed.
  uint64_t budget = 0;
  for (int round = 0; round < (has_gpu() ? 2 : 1); ++round) {
    std::optional<DeviceScene> device;
    std::optional<ShadowMap> on_gpu;
    std::optional<DeviceView> own;
    if (has_gpu()) {
      ShadeOptions shade;
      const PictureNeeds pictures{96, 64, 1, &shade, false, kMapSide};
      device = must(DeviceScene::upload(scene, budget, 2, Reading::kAuto, kDeviceTextureCache, 0, pictures));
      CHECK(device->is_streamed() == (round == 1));
      own = must(device->add_view(scene));
      on_gpu.emplace(scene, &*device);
      budget = least_device_memory(
          refusal(DeviceScene::upload(scene, 1, 2, Reading::kAuto, kDeviceTextureCache, 0, pictures)).message);
    }
    for (int i = 0; i < (kEmulatesGpu ? 2 : 12); ++i) {
      CAPTURE(round, i);
      // From outside, with one map, and from within the scene's box, with several.
      CameraOptions options{.turn_degrees = 45.0 * i,
                            .rise_degrees = 10.0 + 5 * i,
                            .fov_degrees = i % 4 == 0 ? 45 : 20,
                            .width = 96,
                            .height = 64};
      if (i % 2 == 1) {
        options.eye = Vec3{3.1 * std::cos(1.6 + 0.3 * i), 1.9, 3.1 * std::sin(1.6 + 0.3 * i)};
        options.target = Vec3{0, 0.5, 0};
        options.fov_degrees = 60;
      }
      const View camera = must_view(scene, options);
      CHECK((must(sun_of(scene.view(), scene.box(), camera, kMapSide)).map_count > 1) == (i % 2 == 1));
      const std::vector<uint8_t> cpu = shadowed(scene, on_cpu, camera, nullptr);
      CHECK(mean(cpu) < mean(shadowed(scene, on_cpu, camera, nullptr, false)));
      if (!device) continue;
      CHECK(differing(cpu, shadowed(scene, *on_gpu, camera, &*device)) <= cpu.size() / 10000);
    }
  }
}
