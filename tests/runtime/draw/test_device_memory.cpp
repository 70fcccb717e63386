// The GPU memory and pinned memory of a scene, its frames and its pictures stay within the limits.
#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "kernels/cuda/common/check.h"
#include "runtime/draw/device_list.h"
#include "runtime/draw/device_scene.h"
#include "runtime/draw/loaded_scene.h"
#include "runtime/draw/view_renderer.h"
#include "runtime/scene/camera.h"
#include "tests/gpu.h"
#include "tests/models.h"
#include "tests/runtime/frame.h"
#include "tests/runtime/paged_scene.h"
#include "tests/tools/block_model.h"
#include "tests/tools/convert/convert_fixture.h"
#include "tests/tools/jpeg_model.h"
#include "tools/convert/convert.h"

#if defined(SCREE_EMULATED_CUDA)
#include "tests/emulator/machine.h"
#endif

namespace scree::tests {
namespace {

using namespace runtime;
using tests::Frame;

kernels::View view_of(const Scene& scene, uint32_t width, uint32_t height) {
  return tests::must_view(
      scene, {.eye = runtime::Vec3{0.3, 0.6, 2.5}, .target = runtime::Vec3{0, 0, 0}, .width = width, .height = height});
}

#if defined(SCREE_EMULATED_CUDA)
/// Writes spheres of so many chunks that together they take more memory than a streamed scene.
void write_spheres(const std::string& path) {
  std::vector<std::pair<Soup, Encoding>> meshes;
  for (int i = 0; i < 24; ++i) meshes.push_back({sphere(24, 0.1 + 0.01 * i), {}});
  PagedScene{}.write(path, meshes);
}
#endif

}  // namespace

TEST_CASE("a picture of another size than the drawn frame is not resolved", "[cuda]") {
  if (!has_gpu()) return;
  const TempFolder folder;
  PagedScene{}.write(folder.file("a.scree"), {{sphere(20, 0.1), {}}});
  const Scene scene = must_load(folder.file("a.scree"));
  DeviceScene device = must(DeviceScene::upload(scene, 0, 2));
  REQUIRE(device.draw(view_of(scene, 40, 20)));
  const kernels::ShadeOptions shade;
  std::vector<uint32_t> pixels(800);
  CHECK(device.resolve(view_of(scene, 40, 20), 1, shade, pixels));
  CHECK(refusal(device.resolve(view_of(scene, 20, 40), 1, shade, pixels)).code == ErrorCode::kRange);
}

TEST_CASE("textures that do not fit beside the queues are read page by page", "[cuda][textures]") {
  if (!has_gpu()) return;
  const TempFolder folder;
  make_block_model(folder.file("in.glb"), {make_ktx2({.width = 8192, .height = 8192, .levels = 14})});
  const convert::ConvertOptions options = options_of(folder);
  must_convert(options);  // 85 MiB of textures; the queues take 58
  for (const uint64_t budget : {110, 125, 140, 200}) {
    INFO(budget << " MiB");
    CHECK(
        LoadedScene::load(must(SceneFile::open(options.output)), {.on = DrawOn::kGpu, .device_memory = budget << 20}));
  }
}

#if defined(SCREE_EMULATED_CUDA)
TEST_CASE("a scene and its pictures stay within their limit of device memory", "[cuda]") {
  if (!has_gpu()) return;
  const TempFolder folder;
  std::vector<std::string> files;
  for (const bool clustered : {false, true}) {
    convert::ConvertOptions options;
    options.input = data_path("grid.glb").string();
    options.output = folder.file(clustered ? "clustered.scree" : "indexed.scree");
    options.encoding = clustered ? convert::Encoding::kClustered : convert::Encoding::kIndexed;
    options.chunk_triangles = 256;
    REQUIRE(convert::convert(options));
    files.push_back(options.output);
  }
  files.push_back(folder.file("spheres.scree"));
  write_spheres(files.back());
  make_jpeg_model(folder.file("in.glb"), 40);
  convert::ConvertOptions jpeg = options_of(folder);
  jpeg.chunk_triangles = 256;
  must_convert(jpeg);
  files.push_back(jpeg.output);

  uint32_t streamed = 0;  // number of budgets with which the scene is streamed
  struct Size {
    uint32_t width, height, samples;
    bool ssao;
  };
  const kernels::ShadeOptions plain;
  for (const std::string& file : files) {
    const Scene scene = must_load(file, {.threads = 2, .texture_cache = 1, .pages = false});
    for (const Size& size : {Size{64, 48, 1, false}, Size{33, 57, 2, true}, Size{150, 20, 4, false}}) {
      kernels::ShadeOptions shade = plain;
      shade.ssao = size.ssao;
      const PictureNeeds needs{size.width, size.height, size.samples, &shade};
      constexpr uint64_t kCache = uint64_t{1} << 16;
      const auto upload = [&](uint64_t budget) {
        return DeviceScene::upload(scene, budget, 2, Reading::kAuto, kCache, 0, needs);
      };
      // Without a limit, the scene takes the memory of a resident one. With one byte less it is streamed.
      const uint64_t least = least_device_memory(refusal(upload(1)).message);
      const uint64_t resident = must(upload(0)).stats().device_bytes;
      REQUIRE(resident > 0);
      std::vector<uint64_t> samples;
      for (const uint64_t budget : {resident, resident - 1, least, uint64_t{0}}) {
        if (budget != 0 && budget < least) continue;  // a small scene takes less memory whole than streamed
        CAPTURE(file, size.width, size.samples, budget, resident, least);
        REQUIRE(emulator::memory_of_gpu(0).now == 0);
        emulator::reset_peaks();
        DeviceScene device = must(upload(budget));
        const kernels::View view = view_of(scene, size.width, size.height);
        Frame frame = must_draw(scene, view, size.samples, &device, &shade);
        streamed += device.stream_stats().has_value() ? 1 : 0;
        CHECK(device.stream_stats().has_value() == (budget != 0 && budget < resident));
        REQUIRE(frame.shade(shade, 2));
        REQUIRE(frame.read_samples());
        CHECK(emulator::memory_of_gpu(0).peak <= (budget == 0 ? resident : budget));
        if (samples.empty()) samples.assign(frame.samples().begin(), frame.samples().end());
        CHECK(std::ranges::equal(samples, frame.samples()));
      }
    }
  }
  CHECK(streamed >= 4);
}

TEST_CASE("a streamed scene stays within its limit of pinned memory", "[cuda]") {
  if (!has_gpu()) return;
  const TempFolder folder;
  write_spheres(folder.file("a.scree"));
  const Scene scene = must_load(folder.file("a.scree"), {.threads = 2, .pages = false});
  const uint64_t least = least_device_memory(refusal(DeviceScene::upload(scene, 1, 2)).message);
  const auto upload = [&](uint64_t host) { return DeviceScene::upload(scene, least, 2, Reading::kAuto, 0, host); };
  const auto none = refusal(upload(1));
  CHECK(none.code == ErrorCode::kMemory);
  CAPTURE(none.message);
  const uint64_t least_host = least_device_memory(none.message);
  for (const uint64_t host : {least_host, least_host + 4096, 4 * least_host, uint64_t{64} << 20}) {
    CAPTURE(host, least_host);
    REQUIRE(emulator::pinned_memory().now == 0);
    emulator::reset_peaks();
    DeviceScene device = must(upload(host));
    must_draw(scene, view_of(scene, 64, 48), 1, &device);
    REQUIRE(device.stream_stats());
    CHECK(emulator::pinned_memory().peak <= host);
  }
}

TEST_CASE("a scene is loaded on the chosen GPU", "[cuda]") {
  if (!has_gpu()) return;
  const TempFolder folder;
  PagedScene{}.write(folder.file("a.scree"), {{sphere(20, 0.1), {}}});
  const Scene scene = must_load(folder.file("a.scree"));
  setenv("SCREE_EMULATED_GPU", "9.0,9.0", 1);
  REQUIRE(runtime::use_gpu("1"));
  emulator::reset_peaks();
  {
    DeviceScene device = must(DeviceScene::upload(scene, 0, 2));
    REQUIRE(Frame::draw(scene, view_of(scene, 40, 20), 1, 2, &device));
    CHECK(emulator::memory_of_gpu(0).now == 0);
    CHECK(emulator::memory_of_gpu(1).now > 0);
  }
  CHECK(emulator::memory_of_gpu(1).now == 0);
  REQUIRE(runtime::use_gpu("0"));
  setenv("SCREE_EMULATED_GPU", "1", 1);
}

TEST_CASE("views draw on their scene's GPU, and the caller's GPU stays current", "[cuda]") {
  if (!has_gpu()) return;
  const TempFolder folder;
  PagedScene{}.write(folder.file("a.scree"), {{sphere(20, 0.1), {}}});
  setenv("SCREE_EMULATED_GPU", "9.0,9.0", 1);
  REQUIRE(runtime::use_gpu("0"));
  emulator::reset_peaks();
  size_t heard = 0;
  runtime::JobProgress progress([&](const char*, uint64_t, uint64_t) { return ++heard != 0; });
  for (runtime::JobProgress* const listens : {static_cast<runtime::JobProgress*>(nullptr), &progress}) {
    const auto scene = must(runtime::LoadedScene::load(*runtime::SceneFile::open(folder.file("a.scree")),
                                                       {.on = runtime::DrawOn::kGpu, .gpu = "1", .progress = listens}));
    CHECK(runtime::current_gpu()->index == 0);
    for (int i = 0; i < 2; ++i) {  // the second view has its own buffers
      const auto first = must(runtime::ViewRenderer::create(scene));
      auto other = must(runtime::ViewRenderer::create(scene));
      CHECK(runtime::current_gpu()->index == 0);
      REQUIRE(other->draw(view_of(scene->scene(), 40, 20), 1, {}));
      REQUIRE(other->device_layer(runtime::Layer::kDepth, nullptr));
      REQUIRE(other->pick(0, 0));
      CHECK(runtime::current_gpu()->index == 0);
    }
  }
  CHECK(heard > 1);
  CHECK(emulator::memory_of_gpu(0).peak == 0);
  CHECK(emulator::memory_of_gpu(1).now == 0);
  setenv("SCREE_EMULATED_GPU", "1", 1);
}

TEST_CASE("the progress function of one scene's loading draws another scene", "[cuda]") {
  if (!has_gpu()) return;
  const TempFolder folder;
  PagedScene{}.write(folder.file("a.scree"), {{sphere(20, 0.1), {}}});
  const runtime::SceneFile file = *runtime::SceneFile::open(folder.file("a.scree"));
  runtime::LoadOptions options{.on = runtime::DrawOn::kGpu};
  const auto first = must(runtime::LoadedScene::load(file, options));
  std::vector<std::string> stages;
  bool draws = true;
  runtime::JobProgress progress([&](const char* stage, uint64_t, uint64_t) {
    stages.push_back(stage);
    const auto view = runtime::ViewRenderer::create(first);
    draws = draws && view && (*view)->draw(view_of(first->scene(), 16, 8), 1, {}) && (*view)->pick(0, 0);
    return true;
  });
  options.progress = &progress;
  REQUIRE(runtime::LoadedScene::load(file, options));
  CHECK(draws);
  CHECK(std::count(stages.begin(), stages.end(), "upload") >= 2);

  runtime::JobProgress stops([](const char* stage, uint64_t, uint64_t) { return std::string(stage) != "upload"; });
  options.progress = &stops;
  CHECK_FALSE(runtime::LoadedScene::load(file, options));
  CHECK(stops.is_stopped());
}
#endif

}  // namespace scree::tests
