// GPUs of one machine that draw a scene together. Each has a part of the pages and draws it. Their samples are joined
// over the links between them, so the picture is that of one GPU. The first GPU shades, and reads the others' pages for
// that. Only in programs that are built with CUDA.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "format/result.h"
#include "kernels/cuda/check.h"
#include "kernels/cuda/frame.h"
#include "kernels/cuda/least_samples.h"
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

  GpuTeam() = default;
  GpuTeam(const GpuTeam&) = delete;
  GpuTeam& operator=(const GpuTeam&) = delete;
  ~GpuTeam();

  /// Lets every GPU read and write the others' memory, and uploads its share of `scene` to each, to all at the same
  /// time. `gpus`: 2 to kMostGpus, by CUDA's numbers; the first is the current device, before and after. Returns the
  /// scene of the first GPU: all records and textures, and all pages, which it can read. Errors kDevice: two GPUs that
  /// cannot read each other's memory; and the errors of CudaScene::upload(), with the GPU named.
  Result<CudaScene> open(const Scene& scene, std::span<const int> gpus, const Options& options);

  /// As CudaFrames::draw() of a whole frame, on all GPUs, into `samples` of the first. Each draws the clusters that
  /// were visible last time. After joining, the samples of all GPUs hide clusters on every GPU. Errors kRange, kDevice.
  Result<kernels::FrameStats> draw(const kernels::View& view, uint64_t* samples);

  uint32_t size() const { return static_cast<uint32_t>(members_.size()); }
  /// On the first GPU: CudaFrames::transforms() of the last frame.
  const kernels::Transform* transforms() const { return members_[0].frames->transforms(); }
  /// The sums of all GPUs' counts, and the time until the last upload ended.
  const UploadStats& stats() const { return stats_; }

 private:
  struct Member {
    int gpu = 0;
    CudaScene scene;  // of the others; the first's belongs to the caller
    std::optional<kernels::CudaFrames> frames;
    kernels::DeviceBuffer samples;  // of the others
    cudaEvent_t joined = nullptr;   // the GPU has joined its part of the samples
  };

  Result<void> connect() const;
  Result<void> make_current(const Member& member) const;
  Result<void> start_frame(const kernels::View& view, uint64_t* samples);
  Result<kernels::FrameStats> draw_part(const kernels::View& view, kernels::FramePart part);
  Result<void> join(uint64_t count);

  std::vector<Member> members_;
  std::optional<Workers> workers_;  // a thread per GPU
  kernels::SampleBuffers buffers_{};
  UploadStats stats_;
};

}  // namespace scree::runtime
