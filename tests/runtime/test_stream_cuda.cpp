// Scenes that a GPU's budget does not hold, against the CPU's frames of the whole scene.
#include <algorithm>
#include <cstring>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "kernels/frame_cuda.h"
#include "runtime/camera.h"
#include "runtime/chunk_source.h"
#include "runtime/cuda_upload.h"
#include "runtime/device_scene.h"
#include "runtime/renderer.h"
#include "tests/catch.h"
#include "tests/runtime/paged_scene.h"
#include "tests/tools/temp_folder.h"

using scree::Result;
using scree::kernels::ShadeOptions;
using scree::kernels::Show;
using scree::kernels::View;
using scree::runtime::CudaScene;
using scree::runtime::DeviceScene;
using scree::runtime::Frame;
using scree::runtime::Picture;
using scree::runtime::Reading;
using scree::runtime::Scene;
using scree::runtime::SceneFile;
using scree::tests::Encoding;
using scree::tests::PagedScene;
using scree::tests::Soup;
using scree::tests::TempFolder;

namespace kernels = scree::kernels;
namespace runtime = scree::runtime;

namespace {

Scene must_load(const std::string& path, bool pages) {
  Result<SceneFile> file = SceneFile::open(path);
  REQUIRE(file);
  Result<Scene> scene = Scene::load(std::move(*file), 0, {.threads = 2, .pages = pages});
  REQUIRE(scene);
  return std::move(*scene);
}

Soup triangles_around(uint32_t count, std::mt19937& random) {
  std::uniform_real_distribution<double> unit(-1, 1);
  Soup soup;
  for (uint32_t i = 0; i < count; ++i) {
    const double place[3] = {unit(random), unit(random), 3 * unit(random)};
    uint32_t corner[3];
    for (uint32_t& c : corner)
      c = soup.add(place[0] + 0.2 * unit(random), place[1] + 0.2 * unit(random), place[2] + 0.2 * unit(random));
    soup.triangle(corner[0], corner[1], corner[2]);
  }
  return soup;
}

}  // namespace

TEST_CASE("a scene over the device's budget is streamed with the same samples", "[cuda]") {
  if (!runtime::find_device()) {
    WARN("skipped: no GPU");
    return;
  }
  std::mt19937 random(11);
  std::vector<std::pair<Soup, Encoding>> meshes;
  for (int i = 0; i < 9; ++i) {
    Encoding encoding;
    encoding.float32 = i % 3 == 0;
    if (i % 3 == 1) encoding.clusters = scree::tests::Clusters::kClustered;
    meshes.emplace_back(triangles_around(1500, random), encoding);
  }
  const TempFolder folder;
  PagedScene paged;
  paged.drawn_twice = true;
  paged.write(folder.file("soup.scree"), meshes);
  const Scene whole = must_load(folder.file("soup.scree"), true);
  const Scene scene = must_load(folder.file("soup.scree"), false);

  uint64_t all = 0;
  uint64_t largest = 0;
  for (const uint64_t bytes : runtime::ChunkSource(scene).chunk_bytes()) {
    all += bytes;
    largest = std::max(largest, bytes);
  }
  const uint64_t beside =
      CudaScene::device_bytes(scene, &scene.view(), 0) + kernels::CudaFrames::device_bytes(scene.view());
  for (const uint64_t pool : {3 * largest, all / 4 + largest, all / 2 + largest}) {
    for (const uint64_t host_memory : {uint64_t{0}, all / 2, 2 * all}) {
      CAPTURE(pool, host_memory);
      Result<DeviceScene> device = DeviceScene::upload(scene, beside + pool, 2, Reading::kAuto, 0, host_memory);
      if (!device) FAIL(device.error().message);
      for (int i = 0; i < 6; ++i) {
        runtime::CameraOptions camera;
        camera.width = 211;
        camera.height = 140;
        const double turn = i / 2;  // every view twice
        camera.eye = runtime::Vec3{4 - 3 * turn, 1 - turn, 6 - 2 * turn};
        camera.target = runtime::Vec3{0, 0, 0};
        Result<View> view = runtime::make_view(whole.container(), 0, whole.view(), camera);
        REQUIRE(view);
        ShadeOptions shade;
        shade.show = i % 3 == 2 ? Show::kNormal : Show::kColor;
        shade.ssao = i == 3;
        const uint32_t side = i == 4 ? 2 : 1;
        const Result<Frame> expected = Frame::draw(whole, *view, side, 2);
        REQUIRE(expected);
        Result<Frame> frame = Frame::draw(scene, *view, side, 2, &*device, &shade);
        if (!frame) FAIL(frame.error().message);
        REQUIRE(device->stream_stats());
        const Result<Picture> picture = frame->shade(shade, 2);
        const Result<Picture> reference = expected->shade(shade, 2);
        REQUIRE(frame->read_samples());
        REQUIRE(std::equal(frame->samples().begin(), frame->samples().end(), expected->samples().begin(),
                           expected->samples().end()));
        REQUIRE(picture);
        REQUIRE(reference);
        REQUIRE(picture->pixels.size() == reference->pixels.size());
        // Shading's floats are not held to the bit between the two.
        for (size_t p = 0; p < picture->pixels.size(); ++p)
          REQUIRE(std::abs(picture->pixels[p] - reference->pixels[p]) <= 1);
      }
    }
  }
  // The same scene whole on the device: streamed pictures are its pictures, byte for byte.
  Result<DeviceScene> resident = DeviceScene::upload(scene, 0, 2);
  Result<DeviceScene> streamed = DeviceScene::upload(scene, beside + all / 4 + largest, 2, Reading::kAuto, 0);
  REQUIRE(resident);
  REQUIRE(streamed);
  runtime::CameraOptions camera;
  camera.eye = runtime::Vec3{3, 1, 5};
  camera.target = runtime::Vec3{0, 0, 0};
  const Result<View> view = runtime::make_view(whole.container(), 0, whole.view(), camera);
  REQUIRE(view);
  const ShadeOptions shade;
  Result<Frame> a = Frame::draw(scene, *view, 2, 2, &*resident);
  Result<Frame> b = Frame::draw(scene, *view, 2, 2, &*streamed, &shade);
  REQUIRE(a);
  REQUIRE(b);
  const Result<Picture> from_resident = a->shade(shade, 2);
  const Result<Picture> from_streamed = b->shade(shade, 2);
  REQUIRE(from_resident);
  REQUIRE(from_streamed);
  CHECK_FALSE(resident->stream_stats());
  CHECK(from_resident->pixels == from_streamed->pixels);
}
