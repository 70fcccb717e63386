#include "kernels/cuda/blend.h"

#include <cuda_runtime.h>

#include "kernels/cuda/device_array.h"
#include "kernels/cuda/pixels.cuh"
#include "kernels/shade/blend.h"

#pragma nv_diag_suppress 2810  // nvcc 13 takes the assignment of a nodiscard class for an ignored result

namespace scree::kernels {
namespace {

template <class Pass>
__global__ void __launch_bounds__(kPixelThreads) run_blend(const __grid_constant__ Pass pass, uint32_t count) {
  const uint32_t item = (blockIdx.x * kPixelThreads + threadIdx.x) / 32;
  if (item < count) pass(item, PixelTeam{});
}

template <class Pass>
Result<void> start(const Pass& pass, uint32_t count) {
  constexpr uint32_t kItemsPerBlock = kPixelThreads / 32;
  run_blend<Pass><<<(count + kItemsPerBlock - 1) / kItemsPerBlock, kPixelThreads, 0, nullptr>>>(pass, count);
  return cuda_check(cudaGetLastError(), "starting a pass of blending");
}

constexpr const char* kAllocating = "allocating the layers of blended surfaces";

}  // namespace

struct CudaBlend::Impl {
  DeviceArray<uint64_t> samples;  // BlendTargets::drawn, peeled
  DeviceArray<float> floats;      // BlendTargets::over, shaded
  DeviceArray<uint32_t> tiles;    // BlendTargets::progress, further
  BlendTargets at{};
  static constexpr uint64_t kProgressWords = sizeof(BlendProgress) / sizeof(uint32_t);

  Result<void> fit(const View& view, const uint64_t* opaque, const LayerSource& source) {
    const uint64_t count = uint64_t{view.width} * view.height;
    const uint32_t layers = source.layers();
    const uint32_t tile_count = PixelTiles{view.width, 0, view.height}.count();
    Result<void> done = samples.grow((layers + 1) * count, kAllocating);
    if (done) done = floats.grow((source.blend ? 4 : 8) * count, kAllocating);
    if (done) done = tiles.grow(kProgressWords + tile_count, kAllocating);
    at = {static_cast<uint32_t>(count),
          layers,
          opaque,
          samples.data(),
          samples.data() + layers * count,
          floats.data(),
          source.blend ? nullptr : floats.data() + 4 * count,
          tiles.data() + kProgressWords,
          reinterpret_cast<BlendProgress*>(tiles.data())};
    return done;
  }

  Result<void> begin(const View& view) {
    const char* const what = "beginning the layers of blended surfaces";
    const uint64_t tile_count = PixelTiles{view.width, 0, view.height}.count();
    Result<void> done = cuda_check(cudaMemsetAsync(at.progress, 0, sizeof *at.progress, nullptr), what);
    if (done) done = cuda_check(cudaMemsetAsync(at.further, 0xff, tile_count * sizeof(uint32_t), nullptr), what);
    return done ? start(BeginLayers{at}, blend_items(at.sample_count)) : done;
  }

  Result<BlendProgress> read() {
    BlendProgress found{};
    Result<void> done = cuda_check(cudaMemcpy(&found, at.progress, sizeof found, cudaMemcpyDeviceToHost),
                                   "drawing layers of blended surfaces");
    if (done && found.goes_on != 0)
      done = cuda_check(cudaMemsetAsync(&at.progress->goes_on, 0, sizeof found.goes_on, nullptr), "clearing a flag");
    if (!done) return done.error();
    return found;
  }
};

CudaBlend::CudaBlend() : impl_(std::make_unique<Impl>()) {}
CudaBlend::CudaBlend(CudaBlend&&) noexcept = default;
CudaBlend& CudaBlend::operator=(CudaBlend&&) noexcept = default;
CudaBlend::~CudaBlend() = default;

uint64_t CudaBlend::device_bytes(uint64_t width, uint64_t height, bool in_parts) {
  const uint64_t tiles = PixelTiles{static_cast<uint32_t>(width), 0, static_cast<uint32_t>(height)}.count();
  const uint64_t per_sample =
      in_parts ? 2 * sizeof(uint64_t) + 8 * sizeof(float) : (kLayersPerPass + 1) * sizeof(uint64_t) + 4 * sizeof(float);
  return width * height * per_sample + tiles * sizeof(uint32_t) + sizeof(BlendProgress);
}

float* CudaBlend::colors() const {
  static_assert(2 * sizeof(uint64_t) >= 3 * sizeof(float));  // `peeled` lies behind one layer at least
  return reinterpret_cast<float*>(impl_->at.drawn);
}

Result<const float*> CudaBlend::blend(const View& view, const uint64_t* samples, uint32_t most,
                                      const LayerSource& source, BlendCounts& counts) {
  if (Result<void> checked = check_frame(view, 0); !checked) return checked.error();
  Impl& impl = *impl_;
  if (Result<void> done = impl.fit(view, samples, source); !done) return done.error();
  const PixelTiles tiles{view.width, 0, view.height};
  const ShadeInputs in = make_shade_inputs(SceneView{}, view, ShadeOptions{}, nullptr, nullptr, nullptr);
  const Result<void> done = draw_layers(
      impl.at, most, source, counts, [&] { return impl.begin(view); },
      [&](const BlendPass& pass) {
        return start(BlendLayers<ShadedLayer>{{in, impl.at.shaded}, tiles, impl.at, pass, false}, tiles.count());
      },
      [&] { return impl.read(); });
  if (!done) return done.error();
  return static_cast<const float*>(impl.at.over);
}

}  // namespace scree::kernels
