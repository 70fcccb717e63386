// Batches of views on the GPU: depths and ids equal those that the CPU makes of each view alone, bit for bit.
#include <cmath>
#include <random>
#include <vector>

#include "kernels/cuda/frame/view_batch.h"
#include "tests/gpu.h"
#include "tests/kernels/cuda/device_copy.h"
#include "tests/kernels/omitted_cases.h"
#include "tests/kernels/raster/mask_cases.h"

using namespace scree;
using namespace scree::tests;
using kernels::CudaViewBatch;
using kernels::View;

namespace {

/// The layers of a batch, view by view.
struct Layers {
  std::vector<float> depth;
  std::vector<int64_t> triangle;
  std::vector<int32_t> instance;

  explicit Layers(size_t pixels) : depth(pixels), triangle(pixels), instance(pixels) {}

  kernels::LayerTargets targets(size_t first) {
    return {depth.data() + first, triangle.data() + first, instance.data() + first, nullptr, nullptr};
  }
  bool operator==(const Layers&) const = default;
};

Layers layers_on_cpu(const kernels::SceneView& scene, const std::vector<View>& views, uint32_t samples_per_side) {
  const size_t pixels = size_t{views[0].width / samples_per_side} * (views[0].height / samples_per_side);
  Layers out(views.size() * pixels);
  for (size_t i = 0; i < views.size(); ++i)
    REQUIRE(
        kernels::layers_cpu(scene, views[i], samples_per_side, draw(scene, views[i], 2), out.targets(i * pixels), 1));
  return out;
}

class DeviceBatch {
 public:
  DeviceBatch(const kernels::SceneView& host, const DeviceCopy& copy, uint64_t most_samples)
      : batch_(must(CudaViewBatch::create(host, copy.view(), most_samples))) {}

  Layers draw(const std::vector<View>& views, uint32_t samples_per_side, kernels::FrameStats* stats = nullptr) {
    const size_t pixels = views.size() * (views[0].width / samples_per_side) * (views[0].height / samples_per_side);
    kernels::DeviceBuffer depth = must(kernels::DeviceBuffer::allocate(pixels * sizeof(float), "depths"));
    kernels::DeviceBuffer triangle = must(kernels::DeviceBuffer::allocate(pixels * sizeof(int64_t), "triangles"));
    kernels::DeviceBuffer instance = must(kernels::DeviceBuffer::allocate(pixels * sizeof(int32_t), "instances"));
    const kernels::FrameStats drawn =
        must(batch_.draw(views, samples_per_side,
                         {reinterpret_cast<float*>(depth.data()), reinterpret_cast<int64_t*>(triangle.data()),
                          reinterpret_cast<int32_t*>(instance.data()), nullptr, nullptr}));
    if (stats != nullptr) *stats = drawn;
    Layers out(pixels);
    const auto read = [](auto& to, const kernels::DeviceBuffer& from) {
      REQUIRE(cudaMemcpy(to.data(), from.data(), from.bytes(), cudaMemcpyDeviceToHost) == cudaSuccess);
    };
    read(out.depth, depth);
    read(out.triangle, triangle);
    read(out.instance, instance);
    return out;
  }

 private:
  CudaViewBatch batch_;
};

/// Views of one size from far away, near and inside. In many of them the near plane cuts triangles.
std::vector<View> random_views(size_t count, uint32_t width, uint32_t height, uint32_t seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> unit(-1, 1);
  std::vector<View> views;
  for (size_t i = 0; i < count; ++i) {
    const double away = i % 3 == 0 ? 2.5 : i % 3 == 1 ? 0.7 : 0.15;
    const std::array<double, 3> eye{away * unit(random), 0.1 + away * std::abs(unit(random)), away * unit(random)};
    const double z_near = i % 4 == 0 ? 0.3 : i % 4 == 1 ? 0.001 : 0.05;
    views.push_back(look_at(eye, {0.5 * unit(random), 0.1 * unit(random), 0.5 * unit(random)}, width, height, z_near));
  }
  return views;
}

/// Small and large triangles, several instances of each mesh, one of them mirrored. The last mesh is so small that its
/// lattice is farther from the eye than 2^31 steps.
void add_meshes(SceneBuilder& builder) {
  const Encoding encoding{.chunk_triangles = 700, .clusters = Clusters::kClustered};
  Encoding open = encoding;
  open.material = builder.material(format::kMaterialDoubleSided);
  Encoding fine = open;
  fine.exponent = -22;
  const uint32_t meshes[] = {builder.mesh(grid(40, 0.2), encoding), builder.mesh(sphere(20, 0.1), encoding),
                             builder.mesh(grid(1, 0), open), builder.mesh(grid(5, 0.3), open)};
  place_all(builder, meshes, {80, 0, 0, 0.2, 0, 80, 0, -0.7, 0, 0, 80, 0.3});
  builder.instance(builder.mesh(sphere(6, 0), fine), builder.matrix({3e-3, 0, 0, 0, 0, 3e-3, 0, 0.1, 0, 0, 3e-3, 0}));
}

/// Draws the views in one part and in several, and compares layers and counts.
void compare_batch(SceneBuilder& builder, const std::vector<View>& views, uint32_t samples_per_side = 1) {
  const kernels::SceneView scene = builder.view();
  REQUIRE(CudaViewBatch::takes(scene));
  const Layers expected = layers_on_cpu(scene, views, samples_per_side);
  const auto background = static_cast<size_t>(std::count(expected.triangle.begin(), expected.triangle.end(), -1));
  CHECK(background < expected.triangle.size());
  if (!has_gpu()) return;
  const DeviceCopy device(scene, builder.pages);
  kernels::FrameStats stats{};
  DeviceBatch whole(scene, device, CudaViewBatch::kMostSamples);
  CHECK((whole.draw(views, samples_per_side, &stats) == expected));
  CHECK((whole.draw(views, samples_per_side) == expected));
  const uint64_t samples = uint64_t{views[0].width} * views[0].height;
  DeviceBatch parts(scene, device, 3 * samples - 1);
  CHECK((parts.draw(views, samples_per_side) == expected));
  kernels::FrameStats sum{};
  for (const View& view : views) sum += device.stats(view, {}, {});
  CHECK(stats.instances_drawn == sum.instances_drawn);
  CHECK(stats.draws == sum.draws);
  CHECK(stats.triangles == sum.triangles);
  CHECK(stats.groups_tested == sum.groups_tested);
  CHECK(stats.clusters_tested == sum.clusters_tested);
  CHECK(stats.clusters_drawn == sum.clusters_drawn);
  // Whether a triangle counts as small, medium or large depends on its neighbours.
  const auto drawn = [](const kernels::FrameStats& of) {
    return of.triangles_small + of.triangles_medium + of.triangles_large;
  };
  CHECK(drawn(stats) == drawn(sum));
}

constexpr size_t kViews = kEmulatesGpu ? 7 : 200;

}  // namespace

TEST_CASE("a batch of views equals each view alone", "[cuda][batch]") {
  SceneBuilder builder;
  add_meshes(builder);
  compare_batch(builder, random_views(kViews, 40, 27, 1));
  compare_batch(builder, random_views(kEmulatesGpu ? 4 : 30, 131, 90, 2));
  compare_batch(builder, random_views(4, 1, 1, 3));
}

TEST_CASE("a batch of views with several samples per pixel equals each view alone", "[cuda][batch]") {
  SceneBuilder builder;
  add_meshes(builder);
  compare_batch(builder, random_views(5, 32, 24, 4), 2);
  compare_batch(builder, random_views(4, 32, 24, 5), 4);
}

TEST_CASE("a batch of views of masked surfaces equals each view alone", "[cuda][batch][mask]") {
  SceneBuilder builder;
  add_masked_meshes(builder, true);
  compare_batch(builder, random_views(kViews, 45, 31, 6));
}

TEST_CASE("a batch of orthographic views equals each view alone", "[cuda][batch]") {
  const bool is_masked = GENERATE(false, true);
  SceneBuilder builder;
  if (is_masked) {
    add_masked_meshes(builder, true);
  } else {
    add_meshes(builder);
  }
  std::vector<View> views;
  for (const View& view : random_views(6, 37, 41, 7)) views.push_back(orthographic(view, 1.2, 0.05, 6));
  compare_batch(builder, views);
}

TEST_CASE("each view of a batch leaves out its own omitted instances", "[cuda][batch][omitted]") {
  SceneBuilder builder;
  add_meshes(builder);
  const kernels::SceneView scene = builder.view();
  std::vector<View> views = random_views(6, 40, 27, 8);
  const std::vector<std::vector<uint32_t>> bits{random_omitted(scene.instance_count, 1),
                                                random_omitted(scene.instance_count, 2)};
  const Layers all = layers_on_cpu(scene, views, 1);
  for (size_t i = 0; i < views.size(); ++i) views[i].omitted = i % 3 == 2 ? nullptr : bits[i % 3].data();
  const Layers expected = layers_on_cpu(scene, views, 1);
  CHECK_FALSE((expected == all));
  if (!has_gpu()) return;
  const DeviceCopy device(scene, builder.pages);
  const DeviceBits there[2]{DeviceBits(bits[0]), DeviceBits(bits[1])};
  std::vector<View> shown = views;
  for (size_t i = 0; i < views.size(); ++i) {
    views[i].omitted = i % 3 == 2 ? nullptr : there[i % 3].data();
    shown[i].omitted = nullptr;
  }
  DeviceBatch batch(scene, device, CudaViewBatch::kMostSamples);
  CHECK((batch.draw(views, 1) == expected));
  CHECK((batch.draw(shown, 1) == all));
}

TEST_CASE("the scenes and views that are drawn in a batch", "[batch]") {
  SceneBuilder clustered;
  add_meshes(clustered);
  CHECK(CudaViewBatch::takes(clustered.view()));
  SceneBuilder mixed;
  add_meshes(mixed);
  mixed.instance(mixed.mesh(grid(2, 0), {}), 0);
  CHECK(!CudaViewBatch::takes(mixed.view()));
  SceneBuilder empty;
  CHECK(!CudaViewBatch::takes(empty.view()));
  SceneBuilder many;
  add_meshes(many);
  const size_t instances = many.instances.size();
  for (size_t i = 0; i < 2048; ++i) many.instances.push_back(many.instances[i % instances]);
  CHECK(!CudaViewBatch::takes(many.view()));

  CHECK(!CudaViewBatch::pays({}));
  CHECK(!CudaViewBatch::pays(random_views(3, 8, 8, 1)));
  CHECK(CudaViewBatch::pays(random_views(4, 8, 8, 1)));
  CHECK(CudaViewBatch::pays(random_views(4, 512, 512, 1)));
  CHECK(!CudaViewBatch::pays(random_views(4, 512, 513, 1)));
  std::vector<View> views = random_views(5, 8, 8, 1);
  views[3] = orthographic(views[3], 1, 0.1, 10);
  CHECK(!CudaViewBatch::pays(views));
}
