// GPUs of one machine that draw a scene together, so that the picture is that of one GPU. If every GPU's memory holds
// all pages, each draws and shades rows of its own. Otherwise each has and draws a part of the pages, and their samples
// are joined over the links between them. Then each shades a part of the picture, for which it reads the others' pages.
// Each has all textures, with a texture cache and a room for their pages of its own. Only in programs that are built
// with CUDA.
#pragma once

#include <cuda_runtime_api.h>

#include <barrier>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "format/result.h"
#include "kernels/cuda/common/check.h"
#include "kernels/cuda/frame/frame.h"
#include "kernels/cuda/frame/least_samples.h"
#include "kernels/cuda/shade/resolve.h"
#include "kernels/frame.h"
#include "runtime/draw/cuda_upload.h"
#include "runtime/draw/row_shares.h"
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

  /// Lets every GPU read and write the others' memory, and uploads to each its share of `scene`, to all at the same
  /// time. `gpus`: 2 to kMostGpus, by CUDA's numbers; the first is the current device, before and after. Returns the
  /// scene of the first GPU, which outlives this. It has all records, and all pages, which this GPU can read. Errors
  /// kDevice: two GPUs that cannot read each other's memory; kMemory: no thread for each GPU; and the errors of
  /// CudaScene::upload(), with the GPU named.
  Result<CudaScene> open(const Scene& scene, std::span<const int> gpus, const Options& options);

  /// As CudaFrames::draw() of a whole frame, on all GPUs, into `samples` of the first.
  /// - If the GPUs divide the picture, each draws its rows, and gather() brings them together. Chunks that reach into
  ///   rows of several GPUs count for each.
  /// - Otherwise each draws the clusters that were visible last time. After joining, the samples of all GPUs hide
  ///   clusters on every GPU.
  /// Errors kRange, kDevice.
  Result<kernels::FrameStats> draw(const kernels::View& view, uint64_t* samples);

  /// Makes the `samples` of draw() whole. Waits. Error kDevice.
  Result<void> gather() { return gather_at(0); }

  /// As CudaResolver::resolve() of the picture that draw() made last, into `pixels` of the first GPU, with the work of
  /// all GPUs ordered with its default stream. `times`: null, or filled in by the host's clock after waiting. Errors as
  /// CudaResolver::resolve().
  Result<void> resolve(const kernels::View& view, uint32_t samples_per_side, const kernels::ShadeOptions& options,
                       uint32_t* pixels, kernels::ResolveTimes* times);

  /// As CudaScene::block_pager() of GPU `index`.
  DeviceBlockPager* block_pager(size_t index) const { return members_[index].pager; }

  uint32_t size() const { return static_cast<uint32_t>(members_.size()); }
  /// Whether every GPU has all pages and draws rows of its own.
  bool divides_picture() const { return divides_picture_; }
  /// The rows that GPU `index` drew last, if the GPUs divide the picture.
  kernels::RowRange rows(size_t index) const { return shares_.rows(index); }
  /// On the first GPU: CudaFrames::transforms() of the last frame.
  const kernels::Transform* transforms() const { return members_[0].frames->transforms(); }
  /// The sums of all GPUs' counts, and the time until the last upload ended.
  const UploadStats& stats() const { return stats_; }

 private:
  /// If the GPUs share the pages, each shades this many bands of rows; the bands of the GPUs alternate. With more bands
  /// the GPUs' shares take more equally long. With fewer bands fewer chunks show in bands of two GPUs, where one GPU
  /// reads them over a slow link.
  static constexpr uint32_t kBandsPerGpu = 4;

  struct Member {
    int gpu = 0;
    CudaScene scene;                                // of the others; the first's belongs to the caller
    kernels::SceneView shaded{};                    // the scene with the pages of all
    kernels::CudaTextureCache* textures = nullptr;  // of the scene
    DeviceBlockPager* pager = nullptr;              // likewise
    std::optional<kernels::CudaFrames> frames;
    kernels::CudaResolver resolver;
    kernels::DeviceBuffer samples;  // of the others
    kernels::DeviceEvent drawn;     // the GPU has drawn the samples that are joined next
    kernels::DeviceEvent joined;    // it has joined its part of the samples
    kernels::DeviceEvent shaded_part;
    bool has_all_rows = false;  // of the last picture, by gather_at()
  };

  Result<void> connect() const;
  Result<void> make_current(const Member& member) const;
  Result<void> reserve(const kernels::View& view, uint64_t* samples);
  Result<kernels::CudaFrames::Finished> draw_rows(size_t index, const kernels::View& view);
  Result<void> gather_at(size_t index);
  Result<kernels::CudaFrames::Finished> draw_share(size_t index, const kernels::View& view, std::barrier<>& threads);
  Result<kernels::CudaFrames::Finished> draw_once(const kernels::View& view);
  Result<void> join(size_t index, uint64_t count, cudaStream_t stream, std::barrier<>& threads);
  std::span<const kernels::RowRange> shaded_rows(uint32_t index, uint32_t height, uint32_t samples_per_side,
                                                 std::span<kernels::RowRange, kBandsPerGpu> out) const;
  Result<void> start_resolve(const kernels::View& view, uint32_t samples_per_side, const kernels::ShadeOptions& options,
                             uint32_t* pixels, kernels::ResolveTimes* times);
  Result<void> shade_rows(uint32_t index, const kernels::View& view, uint32_t samples_per_side,
                          const kernels::ShadeOptions& options, uint32_t* pixels, kernels::ResolveTimes* times);
  void wait_for_all() const;

  std::vector<Member> members_;
  std::optional<Workers> workers_;  // a thread per GPU
  kernels::SampleBuffers buffers_{};
  bool divides_picture_ = false;
  RowShares shares_;
  std::vector<float> draw_ms_;  // of the last picture by each GPU, if they divide it
  uint32_t width_ = 0;          // of the last picture
  UploadStats stats_;
};

}  // namespace scree::runtime
