// Blended surfaces on the GPU: the layers and their alphas equal the CPU's bit for bit, for every encoding, camera and
// stage, with queues that are large enough and queues that have to grow.
#include <algorithm>
#include <optional>
#include <utility>
#include <vector>

#include "kernels/cuda/shade/blend.h"
#include "kernels/cuda/shade/resolve.h"
#include "tests/gpu.h"
#include "tests/kernels/cuda/device_copy.h"
#include "tests/kernels/omitted_cases.h"
#include "tests/kernels/raster/blend_cases.h"

using namespace scree;
using namespace scree::tests;
using kernels::View;

namespace {

template <class T>
std::vector<T> read(const T* device, size_t count) {
  std::vector<T> values(count);
  REQUIRE(kernels::cuda_check(cudaMemcpy(values.data(), device, count * sizeof(T), cudaMemcpyDeviceToHost), "reading"));
  return values;
}

class GpuLayers {
 public:
  GpuLayers(const kernels::SceneView& host, const DeviceCopy& device, const kernels::CudaQueueSizes& sizes)
      : device_(device.view()), blended_(kernels::blended_view(device_)) {
    kernels::CudaFrames opaque = must(kernels::CudaFrames::create(host, device_, sizes));
    kernels::CudaFrames layers = must(kernels::CudaFrames::create(kernels::blended_view(host), blended_, sizes));
    opaque_.emplace(std::move(opaque));
    layers_.emplace(std::move(layers));
  }

  DrawnLayers draw(const View& view) {
    DrawnLayers out;
    blend(view, 64, nullptr, &out, out.counts);
    return out;
  }

  /// BlendTargets::over. `slots`: fragments per sample that are drawn at once; 0: layers are drawn one by one.
  std::vector<float> over(const View& view, uint32_t most, uint32_t slots, kernels::BlendCounts& counts) {
    const uint64_t samples = uint64_t{view.width} * view.height;
    kernels::CudaBlend at_once(slots == 0 ? 0 : (4 + 12 * slots) * samples + 1024);
    return blend(view, most, &at_once, nullptr, counts);
  }

 private:
  /// `at_once`: draws all fragments at once, or null. `out`: receives the layers, or null.
  std::vector<float> blend(const View& view, uint32_t most, kernels::CudaBlend* at_once, DrawnLayers* out,
                           kernels::BlendCounts& counts) {
    const size_t count = size_t{view.width} * view.height;
    kernels::DeviceBuffer samples = must(kernels::DeviceBuffer::allocate(count * sizeof(uint64_t), "allocating"));
    auto* const opaque = reinterpret_cast<uint64_t*>(samples.data());
    REQUIRE(opaque_->draw(view, opaque));
    const std::vector<uint64_t> before = read(opaque, count);
    const auto draw = [&](uint64_t* to, const uint64_t* peeled, const kernels::FragmentSlots& slots) -> Result<void> {
      const Result<kernels::FrameStats> drawn =
          layers_->draw(view, to, {.part = kernels::FramePart::kPart, .peeled = peeled, .fragments = slots});
      return drawn ? Result<void>() : drawn.error();
    };
    const auto shade = [&](const uint64_t* layer, float* colors) {
      return resolver_.shade_part(blended_, view, layer, layers_->transforms(), {}, colors, nullptr);
    };
    const kernels::LayerSource source{
        [&](const kernels::BlendTargets& at, const uint64_t* peeled) { return draw(at.drawn, peeled, {}); },
        [&](const kernels::BlendTargets& at) -> Result<void> {
          Result<void> done = shade(at.layer, at.colors);
          if (done)
            done = kernels::start_finding_alphas(blended_, view, at.layer, layers_->transforms(), at.alphas, nullptr);
          if (done && out != nullptr) out->add(read(at.layer, count), read(at.alphas, count));
          return done;
        }};
    const kernels::FragmentSource fragments{blended_,
                                            [&](const kernels::FragmentSlots& to) { return draw(opaque, nullptr, to); },
                                            shade, [&] { return layers_->transforms(); }};
    kernels::CudaBlend& used = at_once != nullptr ? *at_once : blend_;
    const float* const over = must(used.blend(view, opaque, most, source, counts, at_once ? &fragments : nullptr));
    CHECK((read(opaque, count) == before));
    return read(over, 4 * count);
  }

  kernels::SceneView device_, blended_;
  std::optional<kernels::CudaFrames> opaque_, layers_;
  kernels::CudaResolver resolver_;
  kernels::CudaBlend blend_;
};

}  // namespace

TEST_CASE("layers of blended surfaces are equal on the GPU", "[cuda][blend]") {
  const bool is_clustered = GENERATE(false, true);
  SceneBuilder builder;
  add_blended_meshes(builder, is_clustered);
  const kernels::SceneView scene = builder.view();
  std::vector<View> views = masked_views(kEmulatesGpu ? 5 : 1);
  // The emulator is slow.
  for (const View& view : walk(kEmulatesGpu ? 1 : 40, 0.16, 96, 64)) views.push_back(view);
  if (!has_gpu()) return;
  std::vector<DrawnLayers> expected;
  for (const View& view : views) expected.push_back(draw_layers(scene, view));
  const DeviceCopy device(scene, builder.pages);
  for (const kernels::CudaQueueSizes& sizes : {kernels::CudaQueueSizes(), in_two_passes(), kNoRoom}) {
    GpuLayers gpu(scene, device, sizes);
    for (size_t i = 0; i < views.size(); ++i) CHECK((gpu.draw(views[i]) == expected[i]));
  }
}

TEST_CASE("fragments drawn at once give the same layers as layers drawn one by one", "[cuda][blend]") {
  const bool is_clustered = GENERATE(false, true);
  if (kEmulatesGpu && !is_clustered) return;  // the emulator is slow
  SceneBuilder builder;
  add_blended_meshes(builder, is_clustered);
  const kernels::SceneView scene = builder.view();
  if (!has_gpu()) return;
  const DeviceCopy device(scene, builder.pages);
  uint32_t deepest = 0;
  for (const kernels::CudaQueueSizes& sizes : {kernels::CudaQueueSizes(), in_two_passes(), kNoRoom}) {
    GpuLayers gpu(scene, device, sizes);
    for (const View& view : masked_views(kEmulatesGpu ? 8 : 1)) {
      for (const uint32_t most : {64u, 2u}) {
        kernels::BlendCounts expected_counts;
        const std::vector<float> expected = gpu.over(view, most, 0, expected_counts);
        deepest = std::max(deepest, expected_counts.layers);
        for (const uint32_t slots : {1u, 2u, 4u, 8u}) {
          if (kEmulatesGpu && slots != 2) continue;
          INFO(most << " layers, " << slots << " slots");
          kernels::BlendCounts counts;
          CHECK((gpu.over(view, most, slots, counts) == expected));
          CHECK(counts.layers == expected_counts.layers);
          CHECK(counts.samples_left_out == expected_counts.samples_left_out);
        }
      }
    }
  }
  CHECK(deepest > 3);  // so that some samples have more fragments than 2 slots
}

TEST_CASE("layers of omitted instances are left out on the GPU as on the CPU, and come back",
          "[cuda][blend][omitted]") {
  const bool is_clustered = GENERATE(false, true);
  SceneBuilder builder;
  add_blended_meshes(builder, is_clustered);
  const kernels::SceneView scene = builder.view();
  const View view = masked_views(kEmulatesGpu ? 2 : 1)[0];
  const std::vector<uint32_t> bits = random_omitted(scene.instance_count, 3);
  const DrawnLayers all = draw_layers(scene, view);
  const DrawnLayers expected = draw_layers(scene, omitting(view, bits.data()));
  CHECK(expected.counts.layers > 0);
  CHECK_FALSE((expected == all));
  if (!has_gpu()) return;
  const DeviceCopy device(scene, builder.pages);
  const DeviceBits there(bits);
  GpuLayers gpu(scene, device, {});
  CHECK((gpu.draw(view) == all));
  CHECK((gpu.draw(omitting(view, there.data())) == expected));
  CHECK((gpu.draw(view) == all));
}
