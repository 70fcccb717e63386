// Blended surfaces on the GPU: the layers and their alphas equal the CPU's bit for bit, for every encoding, camera and
// stage, with queues that are large enough and queues that have to grow.
#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "kernels/cuda/blend.h"
#include "kernels/cuda/resolve.h"
#include "tests/catch.h"
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
    Result<kernels::CudaFrames> opaque = kernels::CudaFrames::create(host, device_, sizes);
    Result<kernels::CudaFrames> layers = kernels::CudaFrames::create(kernels::blended_view(host), blended_, sizes);
    REQUIRE(opaque);
    REQUIRE(layers);
    opaque_.emplace(std::move(*opaque));
    layers_.emplace(std::move(*layers));
  }

  /// As draw_layers().
  DrawnLayers draw(const View& view, uint32_t most = 64) {
    DrawnLayers out;
    const std::vector<uint64_t> opaque = draw_opaque(view);
    const kernels::LayerSource source{
        [&](const kernels::BlendTargets& at, const uint64_t* peeled) -> Result<void> {
          Result<void> done = draw_pass(view, at, peeled);
          if (done) done = resolver_.shade_layers(blended_, view, at, nullptr, layers_->transforms(), {}, nullptr);
          if (done) out.add(read(at.drawn, opaque.size()), opaque, read(at.shaded, 4 * opaque.size()));
          return done;
        },
        {}};
    blend(view, most, source, out);
    out.end();
    return out;
  }

  /// As draw_layers_together().
  DrawnLayers draw_together(const View& view, uint32_t per_pass, const DrawnLayers& expected, uint32_t most = 64) {
    DrawnLayers out;
    draw_opaque(view);
    kernels::LayerSource source{
        [&](const kernels::BlendTargets& at, const uint64_t* peeled) { return draw_pass(view, at, peeled); },
        [&](const kernels::BlendTargets& at, const kernels::BlendPass& pass) {
          const size_t tiles = size_t{(view.width + 7) / 8} * ((view.height + 3) / 4);
          CHECK(expected.has_drawn(read(at.drawn, size_t{at.layers} * at.sample_count), read(at.further, tiles),
                                   pass.before, view.width));
          return resolver_.shade_layers(blended_, view, at, &pass, layers_->transforms(), {}, nullptr);
        }};
    source.layers_per_pass = per_pass;
    blend(view, most, source, out);
    return out;
  }

 private:
  std::vector<uint64_t> draw_opaque(const View& view) {
    const size_t count = size_t{view.width} * view.height;
    REQUIRE(samples_.reserve(count * sizeof(uint64_t), "allocating"));
    REQUIRE(opaque_->draw(view, opaque()));
    return read(opaque(), count);
  }
  Result<void> draw_pass(const View& view, const kernels::BlendTargets& at, const uint64_t* peeled) {
    kernels::DrawOptions options;
    options.part = kernels::FramePart::kPart;
    options.peeled = peeled;
    options.layers = at.layers;
    const Result<kernels::FrameStats> drawn = layers_->draw(view, kernels::last_layer(at), options);
    return drawn ? Result<void>() : drawn.error();
  }
  void blend(const View& view, uint32_t most, const kernels::LayerSource& source, DrawnLayers& out) {
    const Result<const float*> over = blend_.blend(view, opaque(), most, source, out.counts);
    REQUIRE(over);
    out.over = read(*over, size_t{4} * view.width * view.height);
  }
  uint64_t* opaque() const { return reinterpret_cast<uint64_t*>(samples_.data()); }

  kernels::SceneView device_;
  kernels::SceneView blended_;
  std::optional<kernels::CudaFrames> opaque_;
  std::optional<kernels::CudaFrames> layers_;
  kernels::CudaResolver resolver_;
  kernels::CudaBlend blend_;
  kernels::DeviceBuffer samples_;
};

/// The layers in passes of several, compared with one after the other: on this GPU to the bit, and with the CPU's in
/// all but colours.
void check_passes(GpuLayers& gpu, const View& view, const DrawnLayers& expected, uint32_t per_pass,
                  uint32_t most = 64) {
  const DrawnLayers each = gpu.draw(view, most);
  CHECK((each == expected));
  const DrawnLayers together = gpu.draw_together(view, per_pass, expected, most);
  CHECK(together.is_as_deep(expected));
  CHECK((together.over == each.over));
  REQUIRE(together.over.size() == expected.over.size());
  float largest = 0;
  for (size_t i = 0; i < together.over.size(); ++i)
    largest = std::max(largest, std::abs(together.over[i] - expected.over[i]));
  CHECK(largest < 1e-3f);
}

}  // namespace

TEST_CASE("layers of blended surfaces are drawn alike on the GPU", "[cuda][blend]") {
  const bool is_clustered = GENERATE(false, true);
  SceneBuilder builder;
  add_blended_meshes(builder, is_clustered);
  const kernels::SceneView scene = builder.view();
  std::vector<View> views;
  for (View view : masked_views()) {
    if (kEmulatesGpu) view.width /= 2, view.height /= 2;
    views.push_back(view);
  }
  // The emulator is slow.
  for (int step = 0; step < (kEmulatesGpu ? 1 : 40); ++step) {
    const double turn = 0.16 * step;
    views.push_back(look_at({2 * std::cos(turn), 0.3 + 0.01 * step, 2 * std::sin(turn)}, {0, 0, 0}, 96, 64, 0.2));
  }
  std::vector<DrawnLayers> expected;
  for (const View& view : views) expected.push_back(draw_layers(scene, view));
  if (!has_gpu()) return;
  const DeviceCopy device(scene, builder.pages);
  kernels::CudaQueueSizes two_passes;
  two_passes.two_pass_groups = two_passes.round_groups = 1;
  const kernels::CudaQueueSizes no_room{1, 1, 1, 1, 1, 1, 1, 1};
  for (const kernels::CudaQueueSizes& sizes : {kernels::CudaQueueSizes(), two_passes, no_room}) {
    GpuLayers gpu(scene, device, sizes);
    for (size_t i = 0; i < views.size(); ++i) check_passes(gpu, views[i], expected[i], kernels::kLayersPerPass);
  }
}

TEST_CASE("passes of several layers end alike on the GPU", "[cuda][blend]") {
  SceneBuilder builder;
  add_blended_meshes(builder, true);
  const kernels::SceneView scene = builder.view();
  View view = masked_views()[0];
  view.width = 45;  // tiles at its right and lower ends are cut
  view.height = 29;
  const DrawnLayers all = draw_layers(scene, view);
  const uint32_t count = all.counts.layers;
  REQUIRE(count > 5);
  if (!has_gpu()) return;
  const DeviceCopy device(scene, builder.pages);
  GpuLayers gpu(scene, device, {});
  for (const uint32_t per_pass : {1u, 2u, 3u, count - 1, count, count + 1}) check_passes(gpu, view, all, per_pass);
  for (const uint32_t most : {0u, 1u, 4u, 5u, count}) check_passes(gpu, view, draw_layers(scene, view, most), 4, most);
}

TEST_CASE("layers of omitted instances are left out alike on the GPU, and come back", "[cuda][blend][omitted]") {
  const bool is_clustered = GENERATE(false, true);
  SceneBuilder builder;
  add_blended_meshes(builder, is_clustered);
  const kernels::SceneView scene = builder.view();
  View view = masked_views()[0];
  if (kEmulatesGpu) view.width /= 2, view.height /= 2;
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
