#include "lab/frames/frames.h"

#include <utility>

#include "kernels/cuda/frame/frame.h"
#include "kernels/cuda/shade/resolve.h"
#include "lab/setup/gpu_timer.h"
#include "runtime/threads/stopwatch.h"

namespace scree::lab {

using kernels::cuda_check;
using kernels::DeviceBuffer;

struct Frames::Impl {
  Impl(const ResidentScene& drawn, GpuTimer timing) : scene(&drawn), timer(std::move(timing)) {}

  const ResidentScene* scene;
  GpuTimer timer;
  std::unique_ptr<kernels::CudaFrames> frames;
  kernels::CudaResolver resolver;
  DeviceBuffer samples;
  DeviceBuffer pixels;
  uint64_t sample_count = 0;  // of the last frame
  uint64_t pixel_count = 0;

  uint64_t* device_samples() const { return reinterpret_cast<uint64_t*>(samples.data()); }
  uint32_t* device_pixels() const { return reinterpret_cast<uint32_t*>(pixels.data()); }

  Result<kernels::FrameStats> raster(const kernels::View& view, const FrameOptions& options, FrameMs& ms) {
    const kernels::DrawOptions draw{.sampleless_test = options.sampleless_test,
                                    .cluster_bounds = options.culling.bounds,
                                    .occlusion = options.culling.occlusion,
                                    .stage_times = options.stage_times};
    kernels::FrameTimes times{};
    const runtime::Stopwatch watch;
    Result<kernels::FrameStats> stats = frames->draw(view, device_samples(), draw, &times);
    ms.wall = static_cast<float>(watch.elapsed().wall_ms);
    if (times.has_stages) {
      ms.clear = times.clear_ms;
      ms.cull = times.cull_ms;
      ms.small = times.small_ms;
      ms.medium = times.medium_ms;
      ms.large = times.large_ms;
    }
    if (times.second_ms != 0) {
      ms.pyramid = times.pyramid_ms;
      ms.second = times.second_ms;
    }
    ms.raster = times.raster_ms;
    return stats;
  }
  const kernels::Transform* transforms() const { return frames->transforms(); }
};

Frames::Frames(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Frames::Frames(Frames&&) noexcept = default;
Frames& Frames::operator=(Frames&&) noexcept = default;
Frames::~Frames() = default;

Result<Frames> Frames::create(const ResidentScene& scene, const kernels::CudaQueueSizes& sizes) {
  GpuTimer timer = SCREE_TRY(GpuTimer::create());
  auto impl = std::make_unique<Impl>(scene, std::move(timer));
  kernels::CudaFrames frames = SCREE_TRY(kernels::CudaFrames::create(scene.host(), scene.device(), sizes));
  impl->frames = std::make_unique<kernels::CudaFrames>(std::move(frames));
  return Frames(std::move(impl));
}

Result<kernels::FrameStats> Frames::draw(const kernels::View& view, const FrameOptions& options, FrameMs& ms) {
  impl_->sample_count = uint64_t{view.width} * view.height;
  impl_->pixel_count = impl_->sample_count / (uint64_t{options.samples_per_side} * options.samples_per_side);
  SCREE_TRY(impl_->samples.reserve(impl_->sample_count * sizeof(uint64_t), "allocating a picture"));
  SCREE_TRY(impl_->pixels.reserve(impl_->pixel_count * sizeof(uint32_t), "allocating a picture"));
  SCREE_TRY(impl_->timer.start());
  ms = FrameMs{};
  const kernels::ShadeOptions shade{.ssao = options.effects.ssao, .edl = options.effects.edl};
  kernels::FrameStats stats = SCREE_TRY(impl_->raster(view, options, ms));
  kernels::ResolveTimes times;
  SCREE_TRY(impl_->resolver.resolve(impl_->scene->device(), view, options.samples_per_side, impl_->device_samples(),
                                    impl_->transforms(), shade, impl_->device_pixels(), nullptr, &times));
  ms.resolve = times.resolve_ms;
  if (shade.ssao || shade.edl) ms.occlusion = times.occlusion_ms;
  ms.frame = SCREE_TRY(impl_->timer.stop());
  return stats;
}

Result<std::vector<uint64_t>> Frames::samples() const {
  std::vector<uint64_t> samples(impl_->sample_count);
  SCREE_TRY(cuda_check(
      cudaMemcpy(samples.data(), impl_->device_samples(), samples.size() * sizeof(uint64_t), cudaMemcpyDeviceToHost),
      "reading the visibility buffer"));
  return samples;
}

Result<HostPicture> Frames::picture() const {
  std::vector<uint64_t> samples = SCREE_TRY(this->samples());
  HostPicture picture{std::move(samples), std::vector<uint8_t>(4 * impl_->pixel_count)};
  SCREE_TRY(cuda_check(
      cudaMemcpy(picture.pixels.data(), impl_->device_pixels(), picture.pixels.size(), cudaMemcpyDeviceToHost),
      "reading the picture"));
  return picture;
}

}  // namespace scree::lab
