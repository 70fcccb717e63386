// Several GPUs draw and shade one scene: samples equal the CPU's, pictures equal those of one GPU byte for byte, and
// each GPU has only a part of the pages.
#include "runtime/draw/gpu_team.h"

#include <algorithm>
#include <cstring>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "runtime/draw/device_list.h"
#include "runtime/draw/device_scene.h"
#include "runtime/scene/camera.h"
#include "tests/gpu.h"
#include "tests/kernels/omitted_cases.h"
#include "tests/models.h"
#include "tests/runtime/frame.h"
#include "tests/runtime/paged_scene.h"
#include "tests/runtime/soup.h"
#include "tests/tools/block_model.h"
#include "tests/tools/jpeg_model.h"
#include "tools/convert/convert.h"

namespace scree::tests {
namespace {

using kernels::View;
using namespace runtime;
using tests::Frame;

/// Writes meshes that are drawn twice, with clusters alone or in all encodings.
void write_soup(const std::string& path, bool all_clustered) {
  auto meshes = mixed_soups(6, 1200, 29);
  if (all_clustered)
    for (auto& [soup, encoding] : meshes) encoding = {.clusters = Clusters::kClustered};
  PagedScene{.drawn_twice = true}.write(path, meshes);
}

/// A camera that moves in every second frame.
View view_of(const Scene& scene, int frame) {
  const double turn = frame / 2;
  return must_view(scene, {.eye = runtime::Vec3{4 - 3 * turn, 1 - turn, 6 - 2 * turn},
                           .target = runtime::Vec3{0, 0, 0},
                           .width = 131,
                           .height = 77});
}

Result<DeviceScene> upload(const Scene& scene, uint32_t gpus, uint64_t budget = 0,
                           uint64_t texture_cache = runtime::kDeviceTextureCache) {
  return DeviceScene::upload(scene, budget, 2, Reading::kAuto, texture_cache, 0, {}, nullptr, gpus);
}

std::vector<uint8_t> picture(const Scene& scene, DeviceScene& device, const View& view,
                             const kernels::ShadeOptions& options, uint32_t samples_per_side = 2) {
  return must_picture(scene, view, samples_per_side, &device, options);
}

/// Draws `scene` on `team` and on one GPU: from afar, twice, and close. `whole`: the same scene with its pages in
/// memory.
void check_pictures(const Scene& whole, const Scene& scene, DeviceScene& alone, DeviceScene& team) {
  const runtime::CameraOptions far{.width = 90, .height = 58};
  runtime::CameraOptions close = far;
  close.eye = {0.5, 0.12, 0.5};
  close.target = {0.52, 0, 0.42};
  for (const runtime::CameraOptions& camera : {far, far, close}) {
    const View view = must_view(whole, camera);
    for (const uint32_t side : {1u, 2u}) {
      CAPTURE(camera.eye.has_value(), side);
      CHECK(picture(scene, team, view, {}, side) == picture(scene, alone, view, {}, side));
    }
    std::vector<std::byte> of_one(uint64_t{view.width} * view.height * runtime::bytes_of(runtime::Layer::kDepth));
    std::vector<std::byte> of_team(of_one.size());
    std::vector<uint64_t> samples(uint64_t{view.width} * view.height), samples_of_team = samples;
    for (DeviceScene* const device : {&alone, &team}) {
      const bool is_team = device == &team;
      REQUIRE(device->draw(view));
      REQUIRE(device->read_layer(view, 1, runtime::Layer::kDepth, is_team ? of_team : of_one));
      REQUIRE(device->read_samples(is_team ? samples_of_team : samples));
    }
    CHECK(of_team == of_one);
    CHECK(samples_of_team == samples);
  }
}

}  // namespace

TEST_CASE("GPUs that share a scene's pages draw the same as one GPU", "[cuda][gpus]") {
  if (!has_gpu()) return;
  const EmulatedGpus emulated("9.0,9.0,9.0");
  const TempFolder folder;
  write_soup(folder.file("soup.scree"), false);
  const Scene whole = must_load(folder.file("soup.scree")),
              scene = must_load(folder.file("soup.scree"), {.threads = 2, .pages = false});
  DeviceScene alone = must(upload(scene, 1));
  // Each of several GPUs needs memory for one draw list more than a single GPU. With one byte less they share the
  // pages.
  const uint64_t too_little_for_all = alone.stats().device_bytes + kernels::CudaFrames::device_bytes(scene.view()) - 1;
  uint64_t with_all_pages = 0;
  for (const auto& [count, budget] : {std::pair<uint32_t, uint64_t>{2, 0}, {2, too_little_for_all}, {3, 0}}) {
    if (!has_gpus(count)) continue;
    DeviceScene team = must(upload(scene, count, budget));
    CHECK(team.gpu_count() == count);
    CHECK(team.stats().counts.pages == alone.stats().counts.pages);
    if (budget == 0)
      with_all_pages = team.stats().device_bytes;
    else
      CHECK(team.stats().device_bytes < with_all_pages);
    for (int i = 0; i < 4; ++i) {
      CAPTURE(count, budget, i);
      // The last frame leaves out some instances, whose bits lie on the first GPU.
      const std::vector<uint32_t> omitted =
          i == 3 ? random_omitted(scene.view().instance_count, 5) : std::vector<uint32_t>();
      const View view = view_of(scene, i);
      const View on_team = omitting(view, team.set_omitted(omitted).value());
      const View on_one = omitting(view, alone.set_omitted(omitted).value());
      const Frame expected = must_draw(whole, omitting(view, i == 3 ? omitted.data() : nullptr));
      Frame drawn = must_draw(scene, on_team, 1, &team);
      REQUIRE(drawn.read_samples());
      REQUIRE(std::ranges::equal(drawn.samples(), expected.samples()));
      CHECK(drawn.stats().instances_drawn == expected.stats().instances_drawn);
      kernels::ShadeOptions options;
      const kernels::Show shows[] = {kernels::Show::kTexture, kernels::Show::kNormal, kernels::Show::kDepth};
      options.show = shows[i % 3];
      options.ssao = i == 0;
      options.edl = i == 3;
      CHECK(picture(scene, team, on_team, options) == picture(scene, alone, on_one, options));
    }
    const View view = view_of(scene, 0);
    REQUIRE(alone.draw(view));
    REQUIRE(team.draw(view));
    for (const runtime::Layer layer : {runtime::Layer::kDepth, runtime::Layer::kNormal}) {
      std::vector<std::byte> of_one(uint64_t{view.width} * view.height * runtime::bytes_of(layer));
      std::vector<std::byte> of_team(of_one.size());
      REQUIRE(alone.read_layer(view, 1, layer, of_one));
      REQUIRE(team.read_layer(view, 1, layer, of_team));
      CHECK(of_one == of_team);
    }
    // Hidden instances are left out on all GPUs.
    const uint32_t omitted[] = {0b1001};
    const uint32_t* const bits = must(team.set_omitted(omitted));
    View hiding = view;
    hiding.omitted = omitted;
    const Frame without = must_draw(whole, hiding);
    hiding.omitted = bits;
    REQUIRE(team.draw(hiding));
    std::vector<uint64_t> seen(uint64_t{view.width} * view.height);
    REQUIRE(team.read_samples(seen));
    CHECK(std::ranges::equal(seen, without.samples()));
    // The first GPU draws a batch alone, from the pages of all GPUs.
    runtime::DeviceView batch = must(team.add_view(scene));
    const View views[] = {view_of(scene, 0), view_of(scene, 2)};
    REQUIRE(batch.draw_batch(scene, views, nullptr, [](size_t) { return Result<void>(); }));
    std::vector<uint64_t> samples(uint64_t{view.width} * view.height);
    REQUIRE(batch.read_samples(samples));
    const Frame expected = must_draw(whole, views[1]);
    CHECK(std::ranges::equal(samples, expected.samples()));
  }
}

// With little memory the GPUs share the pages, and clusters that one GPU has drawn hide clusters of the others.
// Otherwise they divide the picture.
TEST_CASE("GPUs divide a picture or join their samples", "[cuda][gpus]") {
  if (!has_gpu()) return;
  const EmulatedGpus emulated("9.0,9.0");
  if (!has_gpus(2)) return;
  const TempFolder folder;
  write_soup(folder.file("soup.scree"), true);
  const Scene whole = must_load(folder.file("soup.scree")),
              scene = must_load(folder.file("soup.scree"), {.threads = 2, .pages = false});
  const std::vector<int> gpus = must(runtime::gpus_from(runtime::use_gpu()->index, 2));
  const uint64_t all_pages = CudaScene::device_bytes(scene, nullptr, runtime::kDeviceTextureCache);
  for (const uint64_t budget : {uint64_t{0}, all_pages, all_pages - 1}) {
    GpuTeam team;
    GpuTeam::Options options;
    options.budget = budget;
    options.threads = 2;
    options.queues.two_pass_groups = 1;  // hints also in a small scene
    options.queues.medium = 64;          // queues that grow
    const CudaScene first = must(team.open(scene, gpus, options));
    CHECK(team.divides_picture() == (budget != all_pages - 1));
    for (int i = 0; i < 6; ++i) {
      CAPTURE(budget, i);
      const View view = view_of(scene, i);
      const uint64_t count = uint64_t{view.width} * view.height;
      kernels::DeviceBuffer samples = must(kernels::DeviceBuffer::allocate(count * sizeof(uint64_t), "a test"));
      const Frame expected = must_draw(whole, view);
      const kernels::FrameStats drawn = must(team.draw(view, reinterpret_cast<uint64_t*>(samples.data())));
      CHECK(drawn.instances_drawn == expected.stats().instances_drawn);
      std::vector<uint64_t> read(count);
      const auto rows_are_equal = [&](uint32_t end) {
        REQUIRE(cudaMemcpy(read.data(), samples.data(), count * sizeof(uint64_t), cudaMemcpyDeviceToHost) ==
                cudaSuccess);
        return std::equal(read.begin(), read.begin() + uint64_t{end} * view.width, expected.samples().begin());
      };
      if (team.divides_picture()) {
        CHECK(team.rows(0).first == 0);
        CHECK(team.rows(0).end == team.rows(1).first);
        CHECK(team.rows(1).end == view.height);
        CHECK(rows_are_equal(team.rows(0).end));
      }
      REQUIRE(team.gather());
      CHECK(rows_are_equal(view.height));
    }
  }
}

TEST_CASE("scenes of one page, with masks, textures and blending, are drawn by several GPUs", "[cuda][gpus]") {
  if (!has_gpu()) return;
  const EmulatedGpus emulated("9.0,9.0");
  if (!has_gpus(2)) return;
  for (const char* const name : {"textured_cube.glb", "masked.glb", "materials.gltf", "glass.glb"}) {
    INFO(name);
    const TempFolder folder;
    convert::ConvertOptions convert;
    convert.input = data_path(name).string();
    convert.output = folder.file("scene.scree");
    REQUIRE(convert::convert(convert));
    const Scene scene = must_load(convert.output, {.threads = 2, .pages = false});
    DeviceScene alone = must(upload(scene, 1)), team = must(upload(scene, 2));
    const View view = must_view(must_load(convert.output), {.width = 96, .height = 64});
    const std::vector<uint8_t> expected = picture(scene, alone, view, {});
    CHECK(picture(scene, team, view, {}) == expected);
    // Views take turns, and each is shaded as its own picture.
    runtime::DeviceView one = must(team.add_view(scene)), other = must(team.add_view(scene));
    View seen = view;
    seen.width *= 2;
    seen.height *= 2;
    View elsewhere = seen;
    for (size_t i = 0; i < 3; ++i) elsewhere.eye[i] += 0.3 * seen.right[i] - 0.2 * seen.forward[i];
    REQUIRE(one.draw(seen));
    REQUIRE(other.draw(elsewhere));
    std::vector<uint64_t> samples(uint64_t{seen.width} * seen.height), samples_alone = samples;
    REQUIRE(alone.draw(seen));
    REQUIRE(alone.read_samples(samples_alone));
    REQUIRE(one.read_samples(samples));
    CHECK(samples == samples_alone);
    REQUIRE(other.draw(elsewhere));
    std::vector<uint32_t> pixels(uint64_t{view.width} * view.height);
    REQUIRE(one.resolve(seen, 2, {}, pixels));
    REQUIRE(expected.size() == 4 * pixels.size());
    CHECK(std::memcmp(pixels.data(), expected.data(), expected.size()) == 0);
  }
}

TEST_CASE("each of several GPUs shades with textures of its own", "[cuda][gpus][texel_pager]") {
  if (!has_gpu()) return;
  const EmulatedGpus emulated("9.0,9.0,9.0");
  const TempFolder folder;
  convert::ConvertOptions convert;
  convert.input = folder.file("in.glb");
  convert.output = folder.file("out.scree");
  convert.float32 = true;  // more bytes
  const std::string kind = GENERATE("JPEGs", "decoded JPEGs", "blocks");
  // Two or more pages of geometry per GPU.
  if (kind == "blocks")
    make_block_model(convert.input, large_block_files(3), kEmulatesGpu ? 30 : 160);
  else
    make_jpeg_model(convert.input, scree::tests::kEmulatesGpu ? 30 : 110);
  if (kind == "decoded JPEGs") convert.images.textures = convert::Textures::kRaw;
  REQUIRE(convert::convert(convert));
  const Scene whole = must_load(convert.output);
  for (const uint64_t room : {uint64_t{0}, uint64_t{5} << 18}) {
    if (room != 0 && kind == "decoded JPEGs") continue;
    const Scene scene = must_load(convert.output, {.threads = 2,
                                                   .texture_cache = kind == "decoded JPEGs" ? uint64_t{0} : 1,
                                                   .texture_memory = room,
                                                   .device_texture_memory = room,
                                                   .pages = false});
    CHECK((scene.block_pager() != nullptr) == (room != 0));
    const uint64_t cache = room != 0 ? uint64_t{100000} : runtime::kDeviceTextureCache;
    DeviceScene alone = must(upload(scene, 1, 0, cache));
    const uint64_t too_little_for_all =
        alone.stats().device_bytes + kernels::CudaFrames::device_bytes(scene.view()) - 1;
    uint64_t with_all_pages = 0;
    for (const auto& [count, budget] : {std::pair<uint32_t, uint64_t>{2, 0}, {2, too_little_for_all}, {3, 0}}) {
      // Emulated GPUs would draw for minutes. So only two cases are drawn: two GPUs with all pages, and three that each
      // read their own blocks.
      if (scree::tests::kEmulatesGpu && (budget != 0 || count != (room == 0 ? 2 : 3))) continue;
      if (!has_gpus(count)) continue;
      CAPTURE(kind, room, count, budget);
      DeviceScene team = must(upload(scene, count, budget, cache));
      REQUIRE(team.gpu_count() == count);
      if (budget == 0)
        with_all_pages = team.stats().device_bytes;
      else if (with_all_pages != 0)
        CHECK(team.stats().device_bytes < with_all_pages);  // they share the pages
      check_pictures(whole, scene, alone, team);
      const std::vector<runtime::BlockPager*> pagers = runtime::block_pagers(scene, &team);
      CHECK(pagers.size() == (room != 0 ? count : 0));
      for (const runtime::BlockPager* const pager : pagers) CHECK(pager->resident_bytes() <= room);
      // Every GPU takes coarser levels where it may not wait, and waits again afterwards.
      const View view = must_view(whole, {.width = 160, .height = 120});
      for (runtime::BlockPager* const pager : pagers) pager->set_patience([] { return true; });
      CHECK(picture(scene, team, view, {}, 1).size() == uint64_t{160} * 120 * 4);
      for (runtime::BlockPager* const pager : pagers) pager->set_patience({});
      CHECK(picture(scene, team, view, {}, 1) == picture(scene, alone, view, {}, 1));
    }
  }
}

TEST_CASE("GPUs that cannot draw together are refused", "[cuda][gpus]") {
  if (!has_gpu()) return;
  const TempFolder folder;
  write_soup(folder.file("soup.scree"), false);
  const Scene scene = must_load(folder.file("soup.scree"), {.threads = 2, .pages = false});
  const auto message = [&](uint32_t gpus, uint64_t budget) {
    REQUIRE(runtime::use_gpu());
    const auto device = refusal(upload(scene, gpus, budget));
    CHECK(device.code == ErrorCode::kDevice);
    return device.message;
  };
#if defined(SCREE_EMULATED_CUDA)
  {
    const EmulatedGpus emulated("9.0,9.0,6.1");
    CHECK(message(3, 0) == "3 GPUs were requested, but only 2 can be used");
    // A scene that exceeds the memory of all GPUs is streamed by one.
    const std::string too_small = message(2, 20000);
    CHECK(too_small.ends_with(" where its chunks are streamed, but 20000 are allowed"));
    DeviceScene streamed = must(upload(scene, 2, least_device_memory(too_small)));
    CHECK(streamed.gpu_count() == 1);
    CHECK(streamed.is_streamed());
    CHECK(must(upload(scene, runtime::kAllGpus)).gpu_count() == 2);
  }
  const EmulatedGpus emulated("9.0,8.0");
  CHECK(message(2, 0) ==
        "GPU 0 cannot read the memory of GPU 1 (no peer access), so they cannot draw one scene together");
#else
  CHECK(message(runtime::kMostGpus, 0).starts_with("16 GPUs were requested, but only "));
#endif
}

}  // namespace scree::tests
