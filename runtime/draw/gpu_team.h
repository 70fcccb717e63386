// GPUs of one machine that draw a scene together. Each has a part of the pages and draws it. Their samples are joined
// over the links between them, so the picture is that of one GPU. Each shades a part of the picture, and reads the
// others' pages for that. Only in programs that are built with CUDA.
#pragma once

#include <cuda_runtime_api.h>

#include <barrier>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "format/result.h"
#include "kernels/cuda/check.h"
#include "kernels/cuda/frame.h"
#include "kernels/cuda/least_samples.h"
#include "kernels/cuda/resolve.h"
#include "kernels/frame.h"
#include "runtime/draw/cuda_upload.h"
#include "runtime/scene/scene.h"
#include "runtime/threads/workers.h"

namespace scree::runtime {

class GpuTeam {
 public:
  /// As the parameters of CudaScene::upload(), for each GPU. `beside`: the reserved bytes of the first GPU;
  /// `beside_others`: the reserved bytes of each other GPU.
  struct Options {
    uint64_t budget = 0;
    uint64_t beside = 0;
    uint64_t beside_others = 0;
    uint32_t threads = 1;
    Reading reading = Reading::kAuto;
    uint64_t texture_cache = kDeviceTextureCache;
    uint64_t host_memory = 0;
    JobProgress* progress = nullptr;
    kernels::CudaQueueSizes queues{};
  };

  /// Whether the budget holds the part of `scene` that each of `gpus` GPUs gets.
  static bool fits(const Scene& scene, uint32_t gpus, const Options& options);

  GpuTeam() = default;
  GpuTeam(const GpuTeam&) = delete;
  GpuTeam& operator=(const GpuTeam&) = delete;
  ~GpuTeam();

  /// Lets every GPU read and write the others' memory, and uploads its share of `scene` to each, to all at the same
  /// time. `gpus`: 2 to kMostGpus, by CUDA's numbers; the first is the current device, before and after. Returns the
  /// scene of the first GPU: all records and textures, and all pages, which it can read. It outlives this. Errors
  /// kDevice: two GPUs that cannot read each other's memory; kMemory: no thread for each GPU; and the errors of
  /// CudaScene::upload(), with the GPU named.
  Result<CudaScene> open(const Scene& scene, std::span<const int> gpus, const Options& options);

  /// As CudaFrames::draw() of a whole frame, on all GPUs, into `samples` of the first. Each draws the clusters that
  /// were visible last time. After joining, the samples of all GPUs hide clusters on every GPU. Errors kRange, kDevice.
  Result<kernels::FrameStats> draw(const kernels::View& view, uint64_t* samples);

  /// As CudaResolver::resolve() of the picture that draw() made last, into `pixels` of the first GPU, with the work of
  /// all GPUs ordered with its default stream. Not for textures that need a CudaTextureCache. `times`: null, or filled
  /// in by the host's clock after waiting. Errors kDevice.
  Result<void> resolve(const kernels::View& view, uint32_t samples_per_side, const kernels::ShadeOptions& options,
                       uint32_t* pixels, kernels::ResolveTimes* times);

  uint32_t size() const { return static_cast<uint32_t>(members_.size()); }
  /// On the first GPU: CudaFrames::transforms() of the last frame.
  const kernels::Transform* transforms() const { return members_[0].frames->transforms(); }
  /// The sums of all GPUs' counts, and the time until the last upload ended.
  const UploadStats& stats() const { return stats_; }

 private:
  struct Member {
    int gpu = 0;
    CudaScene scene;              // of the others; the first's belongs to the caller
    kernels::SceneView shaded{};  // the scene with the pages of all, and the first GPU's textures
    std::optional<kernels::CudaFrames> frames;
    kernels::CudaResolver resolver;
    kernels::DeviceBuffer samples;  // of the others
    cudaEvent_t drawn = nullptr;    // the GPU has drawn what is joined next
    cudaEvent_t joined = nullptr;   // it has joined its part of the samples
    cudaEvent_t shaded_part = nullptr;
  };

  Result<void> connect() const;
  Result<void> make_current(const Member& member) const;
  Result<void> reserve(const kernels::View& view, uint64_t* samples);
  Result<kernels::CudaFrames::Finished> draw_share(size_t index, const kernels::View& view, std::barrier<>& threads);
  Result<kernels::CudaFrames::Finished> draw_once(const kernels::View& view);
  Result<void> join(size_t index, uint64_t count, cudaStream_t stream, std::barrier<>& threads);
  Result<void> start_resolve(const kernels::View& view, uint32_t samples_per_side, const kernels::ShadeOptions& options,
                             uint32_t* pixels, kernels::ResolveTimes* times);
  void wait_for_all() const;

  std::vector<Member> members_;
  std::optional<Workers> workers_;  // a thread per GPU
  kernels::SampleBuffers buffers_{};
  UploadStats stats_;
};

}  // namespace scree::runtime
