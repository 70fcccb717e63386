#include "kernels/cuda/blend.h"

#include <cuda_runtime.h>

#include "kernels/cuda/device_array.h"
#include "kernels/cuda/pixels.cuh"
#include "kernels/shade/blend.h"

namespace scree::kernels {
namespace {

/// The warp that shades pixels, with the counting of EndLayer.
struct BlendTeam : PixelTeam {
  __device__ static void add(uint64_t* counter, uint64_t value) {
    atomicAdd(reinterpret_cast<unsigned long long*>(counter), static_cast<unsigned long long>(value));
  }
};

template <class Pass>
__global__ void __launch_bounds__(kPixelThreads) run_blend(const __grid_constant__ Pass pass, uint32_t count) {
  const uint32_t item = (blockIdx.x * kPixelThreads + threadIdx.x) / 32;
  if (item < count) pass(item, BlendTeam{});
}

template <class Pass>
Result<void> start(const Pass& pass, uint32_t count, cudaStream_t stream) {
  constexpr uint32_t kItemsPerBlock = kPixelThreads / 32;
  run_blend<Pass><<<(count + kItemsPerBlock - 1) / kItemsPerBlock, kPixelThreads, 0, stream>>>(pass, count);
  return cuda_check(cudaGetLastError(), "starting a pass of blending");
}

}  // namespace

struct CudaBlend::Impl {
  DeviceArray<uint64_t> samples;  // BlendTargets::drawn, layer, and the count of EndLayer
  DeviceArray<float> floats;      // BlendTargets::colors, alphas, over
  BlendTargets at{};

  Result<void> fit(const View& view, const uint64_t* opaque) {
    const uint64_t count = uint64_t{view.width} * view.height;
    Result<void> done = samples.grow(2 * count + 1, "allocating the layers of blended surfaces");
    if (done) done = floats.grow(8 * count, "allocating the layers of blended surfaces");
    at = {static_cast<uint32_t>(count),
          opaque,
          samples.data() + 1,
          samples.data() + 1 + count,
          floats.data() + 4 * count,
          floats.data() + 7 * count,
          floats.data()};
    return done;
  }

  Result<uint64_t> end_layer(bool is_first) {
    uint64_t* const count = samples.data();
    uint64_t shown = 0;
    Result<void> done = cuda_check(cudaMemsetAsync(count, 0, sizeof shown, nullptr), "clearing a layer's count");
    if (done) done = start(EndLayer{at, is_first, count}, blend_items(at.sample_count), nullptr);
    if (done) done = cuda_check(cudaMemcpy(&shown, count, sizeof shown, cudaMemcpyDeviceToHost), "drawing a layer");
    if (!done) return done.error();
    return shown;
  }
};

CudaBlend::CudaBlend() : impl_(std::make_unique<Impl>()) {}
CudaBlend::CudaBlend(CudaBlend&&) noexcept = default;
CudaBlend& CudaBlend::operator=(CudaBlend&&) noexcept = default;
CudaBlend::~CudaBlend() = default;

float* CudaBlend::colors() const {
  return impl_->at.colors;
}

Result<const float*> CudaBlend::blend(const View& view, const uint64_t* samples, uint32_t most,
                                      const LayerSource& source, BlendCounts& counts) {
  if (Result<void> checked = check_frame(view, 0); !checked) return checked.error();
  if (Result<void> done = impl_->fit(view, samples); !done) return done.error();
  const BlendTargets& at = impl_->at;
  const uint32_t items = blend_items(at.sample_count);
  const Result<void> done = draw_layers(
      at, most, source, counts,
      [&](bool is_first) {
        return start(BeginLayer{at, is_first}, items, nullptr);
      },
      [&](bool is_first) { return impl_->end_layer(is_first); }, [&] { return start(LayUnder{at}, items, nullptr); });
  if (!done) return done.error();
  return static_cast<const float*>(at.over);
}

Result<void> start_finding_alphas(const SceneView& scene, const View& view, const uint64_t* samples,
                                  const Transform* transforms, float* alphas, cudaStream_t stream) {
  const PixelTiles tiles{view.width, 0, view.height};
  const ShadeInputs in = make_shade_inputs(scene, view, ShadeOptions{}, transforms, nullptr, nullptr);
  return view.orthographic ? start(FindAlphas<true>{in, tiles, samples, alphas}, tiles.count(), stream)
                           : start(FindAlphas<false>{in, tiles, samples, alphas}, tiles.count(), stream);
}

}  // namespace scree::kernels
