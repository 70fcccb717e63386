// Scenes that exceed a GPU's budget, compared with the CPU's frames of the whole scene.
#include <algorithm>
#include <iterator>
#include <numeric>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "kernels/cuda/common/device_copies.h"
#include "kernels/cuda/frame/frame.h"
#include "runtime/draw/cuda_upload.h"
#include "runtime/draw/device_scene.h"
#include "runtime/draw/stream_cuda.h"
#include "runtime/scene/camera.h"
#include "runtime/stream/chunk_source.h"
#include "tests/gpu.h"
#include "tests/kernels/omitted_cases.h"
#include "tests/models.h"
#include "tests/runtime/frame.h"
#include "tests/runtime/paged_scene.h"
#include "tests/runtime/soup.h"
#include "tests/runtime/stream/visible_chunks.h"
#include "tests/tools/convert/convert_fixture.h"
#include "tests/tools/jpeg_model.h"

using namespace scree;
using namespace scree::runtime;
using namespace scree::tests;
using namespace scree::kernels;

namespace {

/// Nine meshes drawn twice, of all encodings.
void write_soup(const std::string& path) {
  PagedScene{.drawn_twice = true}.write(path, mixed_soups(9, 1500, 11));
}

}  // namespace

TEST_CASE("a GPU lists and culls the same chunks as the host", "[cuda]") {
  // A wall, and small clouds of triangles around and behind it.
  std::mt19937 random(5);
  std::uniform_real_distribution<double> unit(-1, 1);
  std::vector<std::pair<Soup, Encoding>> meshes;
  Soup wall;
  const uint32_t corner[4] = {wall.add(-1, -1, 0), wall.add(1, -1, 0), wall.add(1, 1, 0), wall.add(-1, 1, 0)};
  wall.triangle(corner[0], corner[1], corner[2]);
  wall.triangle(corner[0], corner[2], corner[3]);
  meshes.emplace_back(wall, Encoding{});
  for (int i = 0; i < 40; ++i) {
    const double middle[3] = {3 * unit(random), 3 * unit(random), 3 * unit(random)};
    Soup cloud;
    for (int t = 0; t < 20; ++t) add_triangle(cloud, middle, 0.1, random);
    meshes.emplace_back(cloud, encoding_of(i));
  }
  const TempFolder folder;
  PagedScene paged;
  paged.write(folder.file("wall.scree"), meshes);
  const Scene scene = must_load(folder.file("wall.scree"));
  const bool has_gpu = scree::tests::has_gpu();
  std::optional<CudaScene> device;
  kernels::CudaVisibleChunks on_device;
  if (has_gpu) {
    device.emplace(must(CudaScene::upload(scene, 0, 0, 2, Reading::kAuto, 0)));
    REQUIRE(on_device.open(scene.view(), device->view()));
  } else {
    WARN("skipped: no GPU; the host's part alone");
  }

  size_t hidden = 0, outside = 0, cut = 0;
  for (int i = 0; i < 40; ++i) {
    View view = must_view(scene, {.eye = runtime::Vec3{0.4 * unit(random), 0.4 * unit(random), 1.6 + unit(random)},
                                  .target = runtime::Vec3{0.4 * unit(random), 0.4 * unit(random), -1},
                                  .width = 320,
                                  .height = 200});
    if (i % 4 == 3) {
      view.orthographic = true;
      view.half_width = 1.6;
      view.half_height = 1;
      view.z_far = view.z_near + 20;
    }
    if (i % 5 == 2) {  // chunks outside a clipping box are not loaded
      const size_t whole = tests::VisibleChunks(scene.view(), view, 2).near_to_far().size();
      view.clips = true;
      for (int k = 0; k < 3; ++k) view.clip_min[k] = -5, view.clip_max[k] = k == 0 ? 0.1 * unit(random) : 5;
      cut += whole - tests::VisibleChunks(scene.view(), view, 2).near_to_far().size();
    }
    const tests::VisibleChunks on_host(scene.view(), view, 2);
    std::vector<uint64_t> samples(uint64_t{view.width} * view.height);
    REQUIRE(kernels::draw_cpu(scene.view(), view, samples, 2));
    kernels::DepthPyramid pyramid;
    std::vector<uint32_t> codes(
        kernels::lay_out(pyramid, static_cast<int32_t>(view.width), static_cast<int32_t>(view.height)));
    pyramid.codes = codes.data();
    kernels::build_pyramid(pyramid, samples.data());
    std::vector<uint32_t> expected(scene.view().chunk_count, runtime::kNotInView);
    for (const uint32_t chunk : on_host.near_to_far()) {
      expected[chunk] = on_host.nearest_shown(chunk, pyramid, kernels::CudaVisibleChunks::kFirstLevel);
      REQUIRE(expected[chunk] >= on_host.nearest(chunk));
      hidden += expected[chunk] == runtime::kNotInView ? 1 : 0;
    }
    outside += expected.size() - on_host.near_to_far().size();
    if (!has_gpu) continue;

    const std::span<const uint32_t> nearest = must(on_device.find_nearest(view));
    const std::vector<uint32_t> order = runtime::order_by_depth(nearest);
    REQUIRE(std::ranges::equal(order, on_host.near_to_far()));
    kernels::DeviceBuffer copy = must(kernels::DeviceBuffer::allocate(samples.size() * sizeof(uint64_t), "a test"));
    REQUIRE(cudaMemcpy(copy.data(), samples.data(), copy.bytes(), cudaMemcpyHostToDevice) == cudaSuccess);
    REQUIRE(on_device.start_finding_shown(reinterpret_cast<const uint64_t*>(copy.data())));
    REQUIRE(cudaDeviceSynchronize() == cudaSuccess);
    const std::span<const uint32_t> shown = on_device.shown();
    REQUIRE(std::ranges::equal(shown, expected));
  }
  CHECK(hidden > 40);
  CHECK(outside > 40);
  CHECK(cut > 10);
}

TEST_CASE("pieces of any size are copied within a GPU's memory", "[cuda]") {
  if (!scree::tests::has_gpu()) return;
  std::mt19937 random(5);
  constexpr uint64_t kUnit = 16;
  const uint64_t sizes[] = {0, 1, kUnit, 1000, (1 << 20) - 1, 1 << 20, (1 << 20) + 1, 5 << 20};
  std::vector<uint64_t> pieces;
  uint64_t all = 0;
  for (int i = 0; i < 600; ++i) {
    pieces.push_back(i < 500 ? random() % 3000 : sizes[random() % std::size(sizes)]);
    all += (pieces.back() + kUnit - 1) / kUnit * kUnit;
  }
  std::vector<std::byte> bytes(all);
  for (std::byte& byte : bytes) byte = static_cast<std::byte>(random());
  // Moves from an ordered layout to a random one.
  Result<kernels::DeviceBuffer> from = kernels::DeviceBuffer::allocate(all, "a test");
  Result<kernels::DeviceBuffer> to = kernels::DeviceBuffer::allocate(all, "a test");
  REQUIRE((from && to));
  REQUIRE(cudaMemcpy(from->data(), bytes.data(), all, cudaMemcpyHostToDevice) == cudaSuccess);
  std::vector<uint32_t> order(pieces.size());
  std::iota(order.begin(), order.end(), 0u);
  std::shuffle(order.begin(), order.end(), random);
  std::vector<uint64_t> begins;
  for (uint64_t at = 0; const uint64_t piece : pieces) {
    begins.push_back(at);
    at += (piece + kUnit - 1) / kUnit * kUnit;
  }
  std::vector<kernels::DeviceCopy> copies;
  std::vector<std::byte> expected;
  for (const uint32_t i : order) {
    copies.push_back({from->data() + begins[i], to->data() + expected.size(), pieces[i]});
    const auto begin = bytes.begin() + static_cast<ptrdiff_t>(begins[i]);
    expected.insert(expected.end(), begin, begin + static_cast<ptrdiff_t>((pieces[i] + kUnit - 1) / kUnit * kUnit));
  }
  REQUIRE(kernels::copy_on_device(copies, nullptr, "a test"));
  std::vector<std::byte> copied(all);
  REQUIRE(cudaMemcpy(copied.data(), to->data(), all, cudaMemcpyDeviceToHost) == cudaSuccess);
  REQUIRE(copied == expected);
}

TEST_CASE("a scene larger than its limit of device memory is streamed to the same samples", "[cuda]") {
  if (!scree::tests::has_gpu()) return;
  const TempFolder folder;
  write_soup(folder.file("soup.scree"));
  const Scene whole = must_load(folder.file("soup.scree")),
              scene = must_load(folder.file("soup.scree"), {.threads = 2, .pages = false});

  const std::vector<uint32_t> omitted = scree::tests::random_omitted(scene.view().instance_count, 4);

  uint64_t all = 0, largest = 0;
  for (const uint64_t bytes : runtime::ChunkSource(scene).chunk_bytes()) {
    all += bytes;
    largest = std::max(largest, bytes);
  }
  const uint64_t beside = CudaScene::device_bytes(scene, &scene.view(), 0) +
                          kernels::CudaFrames::device_bytes(scene.view()) +
                          runtime::CudaStream::device_bytes(scene.view());
  for (const uint64_t pool : {3 * largest, all / 4 + largest, all / 2 + largest}) {
    // The pools keep no chunks, some, or all. Batches and lists take memory too.
    const uint64_t lists = runtime::CudaStream::pinned_list_bytes(scene.view());
    const uint64_t some = lists + 4 * runtime::CudaStream::kStagings * largest + all / 2;
    for (const uint64_t host_memory : {uint64_t{0}, some, lists + 2 * all}) {
      CAPTURE(pool, host_memory);
      if (scree::tests::kEmulatesGpu && (pool != 3 * largest || host_memory != some)) continue;
      DeviceScene device = must(DeviceScene::upload(scene, beside + pool, 2, Reading::kAuto, 0, host_memory));
      for (int i = 0; i < 6; ++i) {
        runtime::CameraOptions camera{.width = 211, .height = 140};
        const double turn = i / 2;  // every view comes twice
        camera.eye = runtime::Vec3{4 - 3 * turn, 1 - turn, 6 - 2 * turn};
        camera.target = runtime::Vec3{0, 0, 0};
        View view = must_view(whole, camera);
        View on_device = view;
        if (i == 3) {
          view.omitted = omitted.data();
          on_device.omitted = must(device.set_omitted(omitted));
        }
        ShadeOptions shade{.show = i % 3 == 2 ? Show::kNormal : Show::kColor, .ssao = i == 3};
        const uint32_t side = i == 4 ? 2 : 1;
        const Frame expected = must_draw(whole, view, side);
        Frame frame = must_draw(scene, on_device, side, &device, &shade);
        REQUIRE(device.stream_stats());
        // Shading uses floats, which need not be equal bit for bit on the CPU and the GPU.
        REQUIRE(differing(must(frame.shade(shade, 2)), must(expected.shade(shade, 2))) == 0);
        REQUIRE(frame.read_samples());
        REQUIRE(std::ranges::equal(frame.samples(), expected.samples()));
      }
    }
  }
  // The same scene resident on the GPU: its pictures equal the streamed ones byte for byte.
  DeviceScene resident = must(DeviceScene::upload(scene, 0, 2));
  DeviceScene streamed = must(DeviceScene::upload(scene, beside + all / 4 + largest, 2, Reading::kAuto, 0));
  runtime::CameraOptions camera;
  if (scree::tests::kEmulatesGpu) {
    camera.width = 120;
    camera.height = 80;
  }
  camera.eye = runtime::Vec3{3, 1, 5};
  camera.target = runtime::Vec3{0, 0, 0};
  const View view = must_view(whole, camera);
  CHECK(must_picture(scene, view, 2, &resident) == must_picture(scene, view, 2, &streamed));
  CHECK_FALSE(resident.stream_stats());
}

TEST_CASE("a scene that is loaded while it is drawn becomes resident on the GPU", "[cuda][stream]") {
  if (!scree::tests::has_gpu()) return;
  const TempFolder folder;
  const bool is_blended = GENERATE(false, true);  // false: all encodings, including float32
  std::string path = folder.file("soup.scree");
  if (is_blended) {
    scree::convert::ConvertOptions options =
        scree::tests::options_of(folder, scree::tests::data_path("materials.gltf"));
    options.chunk_triangles = 1;
    scree::tests::must_convert(options);
    path = options.output;
  } else {
    write_soup(path);
  }
  const Scene whole = must_load(path), scene = must_load(path, {.threads = 2, .pages = false});
  DeviceScene resident = must(DeviceScene::upload(scene, 0, 2));
  DeviceScene coming =
      must(DeviceScene::upload(scene, 0, 2, Reading::kAuto, runtime::kDeviceTextureCache, 0, {}, nullptr, 1, true));
  CHECK(coming.is_streamed());
  std::vector<runtime::DeviceView> views;
  for (int i = 0; i < 2; ++i) views.push_back(must(coming.add_view(scene)));
  const View view = must_view(whole, {.width = 90, .height = 60});
  const ShadeOptions shade;
  const auto picture_of = [&](DeviceScene& device) { return must_picture(scene, view, 1, &device, shade); };
  const std::vector<uint8_t> expected = picture_of(resident);
  // This picture does not wait, and draws fewer chunks.
  REQUIRE(coming.draw(view, nullptr, &shade, [] { return true; }));
  REQUIRE(coming.stream_stats());
  CHECK(coming.stream_stats()->left_bytes > 0);
  std::vector<uint32_t> pixels(size_t{view.width} * view.height);
  REQUIRE(coming.resolve(view, 1, shade, pixels));
  CHECK(std::all_of(pixels.begin(), pixels.end(), [](uint32_t pixel) { return pixel == 0; }));
  // A picture loads the chunks that are visible in it.
  CHECK(picture_of(coming) == expected);
  CHECK(coming.stream_stats()->left_bytes == 0);
  uint64_t left = UINT64_MAX;
  while (left != 0) {
    const uint64_t less = must(coming.load_rest([] { return true; }));
    REQUIRE((less < left || less == 0));
    left = less;
  }
  CHECK_FALSE(coming.is_streamed());
  CHECK(coming.load_rest().value() == 0);
  CHECK_FALSE(coming.resolve(view, 1, shade, pixels));  // its picture was streamed, so it cannot be shaded again
  for (int i = 0; i < 2; ++i) CHECK(picture_of(coming) == expected);
  CHECK_FALSE(coming.stream_stats());
  const Frame on_cpu = must_draw(whole, view);
  std::vector<uint64_t> samples(on_cpu.samples().size());
  const std::vector<View> two(2, view);
  for (runtime::DeviceView& drawn : views) {
    REQUIRE(drawn.draw(view));
    REQUIRE(drawn.read_samples(samples));
    CHECK(std::equal(samples.begin(), samples.end(), on_cpu.samples().begin()));
    REQUIRE(drawn.resolve(view, 1, shade, pixels));
    REQUIRE(drawn.draw_batch(scene, two, nullptr, [](size_t) { return Result<void>(); }));
    REQUIRE(drawn.read_samples(samples));
    CHECK(std::equal(samples.begin(), samples.end(), on_cpu.samples().begin()));
  }
}

TEST_CASE("a GPU decodes JPEG textures on demand while chunks are streamed", "[cuda][stream]") {
  if (!scree::tests::has_gpu()) return;
  const TempFolder folder;
  scree::tests::make_jpeg_model(folder.file("in.glb"), 40);
  scree::convert::ConvertOptions options = scree::tests::options_of(folder);
  options.encoding = GENERATE(scree::convert::Encoding::kIndexed, scree::convert::Encoding::kClustered);
  options.chunk_triangles = 256;
  scree::tests::must_convert(options);
  const Scene decoded = must_load(options.output, {.threads = 2});
  const Scene scene = must_load(options.output, {.threads = 2, .texture_cache = 1, .pages = false});
  const uint64_t slot_bytes = 4 * scene.jpeg_groups().pixels;
  REQUIRE(slot_bytes > 0);
  DeviceScene resident = must(DeviceScene::upload(decoded, 0, 2));
  const std::vector<uint64_t> chunks = runtime::ChunkSource(scene).chunk_bytes();
  const uint64_t largest = *std::max_element(chunks.begin(), chunks.end());
  for (const uint64_t cache : {uint64_t{1}, 9 * slot_bytes, uint64_t{1} << 20}) {
    if (scree::tests::kEmulatesGpu && cache == 9 * slot_bytes) continue;
    const uint64_t budget = CudaScene::device_bytes(scene, &scene.view(), cache) +
                            kernels::CudaFrames::device_bytes(scene.view()) +
                            runtime::CudaStream::device_bytes(scene.view()) + 6 * largest;
    DeviceScene streamed = must(DeviceScene::upload(scene, budget, 2, Reading::kAuto, cache));
    for (int i = 0; i < 3; ++i) {
      CAPTURE(cache, i);
      runtime::CameraOptions camera{.width = 60, .height = 40};
      if (i == 1) {
        camera.eye = runtime::Vec3{0.3, 0.4, 0.2};
        camera.target = runtime::Vec3{0.9, 0, 0.8};
      }
      const View view = must_view(decoded, camera);
      const uint32_t side = i == 0 ? 2 : 1;
      CHECK(must_picture(scene, view, side, &streamed) == must_picture(decoded, view, side, &resident));
      CHECK(must(streamed.stream_stats()).streamed_bytes > 0);
    }
  }
  // The least memory, which the error states, is enough for any requested cache.
  const uint64_t least = scree::tests::least_device_memory(
      refusal(DeviceScene::upload(scene, 1, 2, Reading::kAuto, uint64_t{1} << 20)).message);
  CHECK(DeviceScene::upload(scene, least, 2, Reading::kAuto, uint64_t{1} << 20));
  CHECK_FALSE(DeviceScene::upload(scene, least - 1, 2, Reading::kAuto, uint64_t{1} << 20));
}
