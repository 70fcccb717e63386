// The GPU against the CPU: visibility buffers are equal bit for bit, twice in a row, and pictures are equal to one
// level.
#include "runtime/draw/device_scene.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <tuple>
#include <vector>

#include "runtime/scene/camera.h"
#include "tests/gpu.h"
#include "tests/kernels/omitted_cases.h"
#include "tests/models.h"
#include "tests/runtime/frame.h"
#include "tests/runtime/load_scene.h"
#include "tests/runtime/paged_scene.h"
#include "tools/convert/convert.h"

#ifdef SCREE_HAS_CUDA
#include "kernels/cuda/common/check.h"
#endif

using namespace scree;
using namespace scree::runtime;
using namespace scree::tests;
using scree::kernels::Show;
using scree::kernels::View;

namespace {

/// The textured cube of the tests' models, packed into `folder`.
Scene load_cube(const scree::tests::TempFolder& folder) {
  scree::convert::ConvertOptions convert;
  convert.input = scree::tests::data_path("textured_cube.glb").string();
  convert.output = folder.file("scene.scree");
  REQUIRE(scree::convert::convert(convert));
  return must_load(convert.output);
}

void compare_pictures(const Frame& cpu, const Frame& gpu, const scree::kernels::ShadeOptions& options) {
  const std::vector<uint8_t> on_cpu = must(cpu.shade(options, 2)), on_gpu = must(gpu.shade(options, 2));
  INFO("show " << static_cast<int>(options.show) << ", ssao " << options.ssao << ", edl " << options.edl);
  CHECK(differing(on_cpu, on_gpu) <= on_cpu.size() / 10000);
}

void compare(const Scene& scene, DeviceScene& device, const View& view, uint32_t samples_per_side) {
  Frame cpu = must_draw(scene, view, samples_per_side);
  Frame gpu = must_draw(scene, view, samples_per_side, &device);
  REQUIRE(gpu.read_samples());
  Frame again = must_draw(scene, view, samples_per_side, &device);
  REQUIRE(again.read_samples());
  CHECK(std::ranges::equal(cpu.samples(), gpu.samples()));
  CHECK(std::ranges::equal(gpu.samples(), again.samples()));
  scree::kernels::ShadeOptions options;
  for (const Show show : {Show::kTexture, Show::kColor, Show::kUv, Show::kNormal, Show::kTriangle, Show::kCluster,
                          Show::kMesh, Show::kStage, Show::kDepth}) {
    if (scree::tests::kEmulatesGpu && (show == Show::kColor || show == Show::kCluster || show == Show::kMesh)) continue;
    options.show = show;
    compare_pictures(cpu, again, options);
  }
  options.show = Show::kTexture;
  options.background[1] = 0.5f;
  options.background[3] = 1;
  for (const int occlusion : {1, 2, 3}) {
    if (scree::tests::kEmulatesGpu && occlusion != 3) continue;
    options.ssao = (occlusion & 1) != 0;
    options.edl = (occlusion & 2) != 0;
    compare_pictures(cpu, again, options);
  }
}

}  // namespace

TEST_CASE("the GPU draws the same as the CPU", "[cuda]") {
  if (!scree::tests::has_gpu()) return;
  using Encoding = scree::convert::Encoding;
  for (const Encoding encoding : {Encoding::kIndexed, Encoding::kClustered})
    for (const auto& entry : std::filesystem::directory_iterator(scree::tests::kDataFolder)) {
      const std::filesystem::path source = entry.path();
      if (source.extension() != ".glb" && source.extension() != ".gltf") continue;
      INFO(source.filename().string());
      const scree::tests::TempFolder folder;
      scree::convert::ConvertOptions convert;
      convert.input = source.string();
      convert.output = folder.file("scene.scree");
      convert.encoding = encoding;
      if (!scree::convert::convert(convert)) continue;
      const Scene scene = must_load(convert.output);
      DeviceScene device = must(DeviceScene::upload(scene, 0, 2));
      const scree::runtime::CameraOptions camera{.width = scree::tests::kEmulatesGpu ? 101 : 321,
                                                 .height = scree::tests::kEmulatesGpu ? 61 : 123};
      const View view = must(scree::runtime::make_view(scene, camera));
      for (const uint32_t samples : {1u, 2u, 4u})
        if (samples == 2 || !scree::tests::kEmulatesGpu) compare(scene, device, view, samples);
      if (scree::tests::kEmulatesGpu && encoding == Encoding::kIndexed) continue;
      View flat = view;  // the same camera, orthographic
      flat.orthographic = true;
      double height = 0;
      for (size_t i = 0; i < 3; ++i) height = std::max(height, std::abs(flat.eye[i]));
      flat.half_height = std::max(height, 1.0);
      flat.half_width = flat.half_height * flat.width / flat.height;
      flat.z_far = flat.z_near + 100 * flat.half_height;
      compare(scene, device, flat, 2);
    }
}

TEST_CASE("pages that only the GPU has are drawn and picked as on the CPU", "[cuda]") {
  if (!scree::tests::has_gpu()) return;
  const scree::tests::TempFolder folder;
  for (const int level : {0, 3}) {
    scree::convert::ConvertOptions convert;
    convert.input = scree::tests::data_path("textured_cube.glb").string();
    convert.output = folder.file("scene.scree");
    convert.source_ids = true;
    convert.zstd_level = level;
    REQUIRE(scree::convert::convert(convert));
    scree::tests::Encoding floats{.float32 = true};
    const std::string paged = folder.file("paged.scree");
    scree::tests::PagedScene{}.write(paged,
                                     {{scree::tests::grid(90, 0.2), {}}, {scree::tests::sphere(40, 0.1), floats}});
    for (const std::string& path : {convert.output, paged}) {
      const Scene whole = must_load(path), scene = must_load(path, {.threads = 2, .pages = false});
      DeviceScene device = must(DeviceScene::upload(scene, 0, 3));
      CHECK(device.stats().counts.pages == scene.drawn_pages().size());
      const View view = must(scree::runtime::make_view(whole, {.width = 333, .height = 222}));
      const Frame cpu = must_draw(whole, view);
      Frame gpu = must_draw(scene, view, 1, &device);
      REQUIRE(gpu.read_samples());
      CHECK(std::ranges::equal(cpu.samples(), gpu.samples()));
      const auto on_cpu = must(cpu.pick(166, 111));
      const auto on_gpu = must(gpu.pick(166, 111));
      REQUIRE(on_cpu.has_value());
      REQUIRE(on_gpu.has_value());
      CHECK(on_cpu->source_triangle == on_gpu->source_triangle);
      CHECK(on_cpu->mesh_triangle == on_gpu->mesh_triangle);
    }
  }
}

TEST_CASE("all views of a scene on a GPU leave out omitted instances, one by one and in batches", "[cuda][omitted]") {
  const scree::tests::TempFolder folder;
  const scree::tests::Encoding clustered{.clusters = scree::tests::Clusters::kClustered};
  const scree::tests::PagedScene paged{.drawn_twice = true};
  paged.write(folder.file("paged.scree"), {{scree::tests::grid(9, 0.2), clustered},
                                           {scree::tests::sphere(12, 0.1), clustered},
                                           {scree::tests::grid(3, 0.5), clustered}});
  const Scene scene = must_load(folder.file("paged.scree"));
  const std::vector<std::vector<uint32_t>> bits{{0x15u}, {0x2au}};  // one instance of each mesh, then the other
  std::vector<View> views;
  std::vector<int64_t> expected;
  std::vector<uint64_t> first;  // samples of the first view
  for (uint32_t i = 0; i < 5; ++i) {
    views.push_back(scree::tests::must_view(scene, {.eye = scree::runtime::Vec3{2.0 - 0.5 * i, 1.5, 2},
                                                    .target = scree::runtime::Vec3{0, 0, 0},
                                                    .width = 64,
                                                    .height = 48}));
    const Frame frame = must_draw(scene, scree::tests::omitting(views[i], bits[0].data()));
    const std::vector<int64_t> ids = must(frame.layer<int64_t>(scree::runtime::Layer::kTriangle, 2));
    expected.insert(expected.end(), ids.begin(), ids.end());
    if (i == 0) first.assign(frame.samples().begin(), frame.samples().end());
  }
  const Frame whole = must_draw(scene, views[0]);
  const Frame other = must_draw(scene, scree::tests::omitting(views[0], bits[1].data()));
  CHECK_FALSE(std::ranges::equal(first, whole.samples()));
  CHECK_FALSE(std::ranges::equal(first, other.samples()));
  if (!scree::tests::has_gpu()) return;

  DeviceScene device = must(DeviceScene::upload(scene, 0, 2));
  CHECK(device.set_omitted(std::vector<uint32_t>(2)).error().code == scree::ErrorCode::kRange);
  CHECK(device.set_omitted({}).value() == nullptr);
  std::vector<scree::runtime::DeviceView> both;
  for (int i = 0; i < 2; ++i) both.push_back(must(device.add_view(scene)));
  std::vector<uint64_t> samples(first.size());
  for (const size_t set : {0u, 1u, 2u, 0u}) {
    const uint32_t* const brought = must(device.set_omitted(set == 2 ? std::vector<uint32_t>() : bits[set]));
    for (scree::runtime::DeviceView& view : both) {
      REQUIRE(view.draw(scree::tests::omitting(views[0], brought)));
      REQUIRE(view.read_samples(samples));
      CHECK(std::ranges::equal(samples, set == 2 ? whole.samples() : set == 1 ? other.samples() : first));
    }
  }
  const uint32_t* const brought = must(device.set_omitted(bits[0]));
  for (View& view : views) view.omitted = brought;
  const uint64_t bytes = first.size() * sizeof(int64_t);
  std::byte* const block = must(both[1].reserve_block(0, views.size() * bytes));
  const auto target = [&](size_t i) {
    return scree::runtime::target_of(scree::runtime::Layer::kTriangle, block + i * bytes);
  };
  std::vector<int64_t> ids(expected.size());
  REQUIRE(
      both[1].draw_batch(scene, views, nullptr, [&](size_t i) { return both[1].make_layers(views[i], 1, target(i)); }));
  REQUIRE(both[1].read(block, std::as_writable_bytes(std::span(ids))));
  CHECK(ids == expected);
  ids.assign(ids.size(), 0);
  REQUIRE(must(both[1].draw_together(scene, views, 1, target(0))).has_value());
  REQUIRE(both[1].read(block, std::as_writable_bytes(std::span(ids))));
  CHECK(ids == expected);
}

TEST_CASE("a view shades and reads a picture while it draws the next one", "[cuda]") {
  if (!scree::tests::has_gpu()) return;
  using scree::runtime::Layer;
  const scree::tests::TempFolder folder;
  const Scene scene = load_cube(folder);
  DeviceScene device = must(DeviceScene::upload(scene, 0, 2));
  scree::runtime::DeviceView drawn = must(device.add_view(scene));
  const scree::kernels::ShadeOptions options;
  const auto outputs = [&](const View& view) {
    const uint64_t pixels = uint64_t{view.width} * view.height;
    std::vector<uint64_t> samples(pixels);
    std::vector<uint32_t> rgba(pixels), joined(pixels);
    std::vector<float> depths(pixels);
    REQUIRE(drawn.read_samples(samples));
    REQUIRE(drawn.resolve(view, 1, options, rgba));
    REQUIRE(drawn.make_colors(view, options));
    REQUIRE(drawn.read(must(drawn.resolve_colors(view, 1, options)), std::as_writable_bytes(std::span(joined))));
    REQUIRE(drawn.read(must(drawn.make_layer(view, 1, Layer::kDepth)), std::as_writable_bytes(std::span(depths))));
    return std::tuple(samples, rgba, joined, depths);
  };
  std::vector<View> views;
  std::vector<decltype(outputs(views[0]))> expected;
  for (uint32_t i = 0; i < 4; ++i) {
    const scree::runtime::CameraOptions camera{.eye = scree::runtime::Vec3{2.0 - 0.9 * i, 1.5, 2},
                                               .target = scree::runtime::Vec3{0, 0, 0},
                                               .width = 60 + 20 * i,
                                               .height = 50};
    views.push_back(scree::tests::must_view(scene, camera));
    REQUIRE(drawn.draw(views[i]));
    expected.push_back(outputs(views[i]));
    if (i > 0) CHECK(std::get<0>(expected[i]) != std::get<0>(expected[i - 1]));
  }
  REQUIRE(drawn.draw(views[0]));
  for (size_t i = 0; i < views.size(); ++i) {
    INFO("picture " << i);
    uint64_t* joined = nullptr;  // the scene has one pass, whose end completes all samples
    const auto join = [&](uint64_t* samples, void*) -> Result<void> {
      CHECK(joined == nullptr);
      joined = samples;
      return {};
    };
    if (i == 1) REQUIRE(drawn.start(views[i + 1], join));
    if (i != 1 && i + 1 < views.size()) REQUIRE(drawn.start(views[i + 1]));
    CHECK(drawn.has_started() == (i + 1 < views.size()));
    CHECK((outputs(views[i]) == expected[i]));
    CHECK(static_cast<bool>(drawn.make_layer(views[i], 1, Layer::kNormal)) == !drawn.has_started());
    if (!drawn.has_started()) continue;
    const bool finished = must(drawn.finish());
    CHECK((i != 1 || finished));
    CHECK((i == 1) == (joined == drawn.samples().value()));
  }
  REQUIRE(drawn.start(views[1]));  // and not finish()
}

TEST_CASE("a scene larger than its limit of device memory is refused with both sizes", "[cuda]") {
  if (!scree::tests::has_gpu()) return;
  const scree::tests::TempFolder folder;
  check_refusal(DeviceScene::upload(load_cube(folder), 16, 1), scree::ErrorCode::kDevice, "16 are allowed");
}

#ifdef SCREE_HAS_CUDA
TEST_CASE("queues that are too small grow, and the frame is drawn again", "[cuda]") {
  if (!scree::tests::has_gpu()) return;
  const scree::tests::TempFolder folder;
  const Scene scene = load_cube(folder);
  DeviceScene device = must(DeviceScene::upload(scene, 0, 2));
  // A cube that fills the picture: large triangles, many tiles, and medium triangles in the smaller picture.
  for (const uint32_t width : {700u, 60u}) {
    const View view = must(scree::runtime::make_view(scene, {.width = width, .height = width}));
    const Frame cpu = must_draw(scene, view);
    scree::kernels::CudaFrames frames =
        must(scree::kernels::CudaFrames::create(scene.view(), device.device_view(), {1, 1, 1}));
    std::vector<uint64_t> samples(size_t{width} * width);
    scree::kernels::DeviceBuffer buffer =
        must(scree::kernels::DeviceBuffer::allocate(samples.size() * sizeof(uint64_t), "allocating the picture"));
    // The picture is also the same if no triangle is dropped before its projection.
    for (const bool filters : {true, false}) {
      const auto stats = must(frames.draw(view, reinterpret_cast<uint64_t*>(buffer.data()), {filters}));
      if (filters) CHECK(stats.triangles_medium + stats.triangles_large > 1);
      REQUIRE(scree::kernels::cuda_check(
          cudaMemcpy(samples.data(), buffer.data(), buffer.bytes(), cudaMemcpyDeviceToHost), "reading the picture"));
      CHECK(std::ranges::equal(samples, cpu.samples()));
    }
  }
}
#endif
